"""Walks through the statements of a module, and past its expressions, which are most of a syntax tree."""

from __future__ import annotations

import ast
from collections.abc import Iterable, Iterator


def blocks_of(node: ast.AST) -> Iterator[Iterable[ast.AST]]:
    """Yield the blocks inside a statement in the order of the source; handlers and cases are parts like statements."""
    for name in ("body", "handlers", "cases", "orelse", "finalbody"):
        yield getattr(node, name, ())


def statements_of(block: Iterable[ast.AST]) -> Iterator[ast.AST]:
    """Yield every statement of a block and of the blocks inside it, the containing ones first."""
    for node in block:
        yield node
        for inner in blocks_of(node):
            yield from statements_of(inner)
