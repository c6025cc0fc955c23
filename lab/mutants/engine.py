"""Puts a mutant into modules that are imported already, and probes that tell which lines a test runs.

A function's code is exchanged inside the function object: every name that was bound to it, by whatever import, calls
the mutant. What ran while its module was imported (constants, default values, decorators) cannot be reached so; such a
module is imported anew (`lab.mutants.sessions.try_fresh`).
"""

from __future__ import annotations

import ast
import copy
import functools
import gc
from collections.abc import Iterable, Iterator
from types import CodeType, FunctionType
from typing import Any, Final

SEEN: Final = "__lines_seen__"
"""Global of a module with probes: the set of its lines that ran."""
_CACHED: Final = type(functools.cache(len))
"""What keeps results of a function."""
_Key = tuple[str, int]
"""Qualified name of a function, and its first line."""


class NotReachableError(Exception):
    """No living function has the code that was to be exchanged."""


class LiveFunctions:
    """The functions of some files, as they live in this process.

    Args:
        files: absolute paths.
    """

    def __init__(self, files: Iterable[str]) -> None:
        wanted = frozenset(files)
        self._functions: dict[str, dict[_Key, list[FunctionType]]] = {}
        self._caches: list[Any] = []
        gc.unfreeze()
        for found in gc.get_objects():
            if isinstance(found, FunctionType) and found.__code__.co_filename in wanted:
                by_key = self._functions.setdefault(found.__code__.co_filename, {})
                by_key.setdefault(_key(found.__code__), []).append(found)
            elif isinstance(found, _CACHED):
                self._caches.append(found)
        gc.freeze()

    def exchange(self, file: str, tree: ast.Module, mutated: ast.Module) -> None:
        """Let every function whose code differs between two trees of a file run that of the second.

        Raises:
            NotReachableError: none lives, or it cannot take the other code.
        """
        pairs = _changed_codes(compile_tree(tree, file), compile_tree(mutated, file))
        living = [(function, new) for key, new in pairs for function in self._functions.get(file, {}).get(key, [])]
        if not living:
            raise NotReachableError(f"{file}: {', '.join(name for (name, _), _ in pairs) or 'no function'}")
        try:
            for function, new in living:
                function.__code__ = new
        except ValueError as error:  # another number of variables of the surrounding function
            raise NotReachableError(f"{file}: {error}") from None
        for cache in self._caches:
            cache.cache_clear()

    def add_probes(self, file: str, tree: ast.Module) -> set[int]:
        """Let the functions of a file tell which lines they run, and return the set that they fill."""
        seen: set[int] = set()
        codes = dict(_unique_codes(compile_tree(_with_probes(tree), file)))
        for key, functions in self._functions.get(file, {}).items():
            for function in functions:
                if key in codes and codes[key].co_freevars == function.__code__.co_freevars:
                    function.__code__ = codes[key]
                    function.__globals__[SEEN] = seen
        return seen


def compile_tree(tree: ast.Module, file: str) -> CodeType:
    """Compile a module as an import does."""
    code = compile(tree, file, "exec", dont_inherit=True)
    assert isinstance(code, CodeType)
    return code


def _key(code: CodeType) -> _Key:
    return code.co_qualname, code.co_firstlineno


def _codes(code: CodeType) -> Iterator[CodeType]:
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield constant
            yield from _codes(constant)


def _unique_codes(module: CodeType) -> Iterator[tuple[_Key, CodeType]]:
    """Codes of functions; two of one name on one line (lambdas) cannot be told apart."""
    by_key: dict[_Key, list[CodeType]] = {}
    for code in _codes(module):
        by_key.setdefault(_key(code), []).append(code)
    return ((key, codes[0]) for key, codes in by_key.items() if len(codes) == 1)


def _changed_codes(before: CodeType, after: CodeType) -> list[tuple[_Key, CodeType]]:
    old = dict(_unique_codes(before))
    return [(key, code) for key, code in _unique_codes(after) if key in old and old[key] != code]


def _with_probes(tree: ast.Module) -> ast.Module:
    """A copy whose functions note the line of each statement before they run it."""
    copied = copy.deepcopy(tree)
    probed: set[int] = set()
    for function in ast.walk(copied):
        if isinstance(function, ast.FunctionDef | ast.AsyncFunctionDef):
            for node in ast.walk(function):
                for field in ("body", "orelse", "finalbody"):
                    body = getattr(node, field, None)
                    if isinstance(body, list) and id(body) not in probed:
                        body[:] = [statement for old in body for statement in (*_probe(old), old)]
                        probed.add(id(body))
    return ast.fix_missing_locations(copied)


def _probe(statement: ast.stmt) -> list[ast.stmt]:
    if isinstance(statement, ast.Nonlocal | ast.Global):
        return []
    probe = ast.parse(f"{SEEN}.add({statement.lineno})").body[0]
    for node in ast.walk(probe):
        ast.copy_location(node, statement)
    return [probe]
