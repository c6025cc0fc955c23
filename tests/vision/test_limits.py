"""One place for thresholds: no other file of the eyes compares with a number of its own."""

from __future__ import annotations

import ast
from pathlib import Path

import mkdaemon.vision

ROOT = Path(mkdaemon.vision.__file__).parent
STRUCTURAL = range(5)
"""Signs, emptiness, dimensions, channels, corners; everything else is a threshold or deserves a name."""


def literals(source: Path) -> list[str]:
    """Comparisons with a numeric literal, named constants excepted."""
    found = []
    for node in ast.walk(ast.parse(source.read_text(encoding="utf-8"))):
        if not isinstance(node, ast.Compare):
            continue
        for part in ast.walk(node):
            if not isinstance(part, ast.Constant) or type(part.value) not in (int, float):
                continue
            if part.value not in (STRUCTURAL if isinstance(part.value, int) else range(3)):
                found.append(f"{source.name}:{node.lineno}: {ast.unparse(node)}")
                break
    return found


def test_no_file_compares_with_a_number_of_its_own():
    assert [(source, found) for source in sorted(ROOT.rglob("*.py")) if (found := literals(source))] == []
