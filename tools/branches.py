"""Which branches the tests take: a plugin of pytest (`python -m pytest -p tools.branches --branches`).

Modules of the packages that fly get a probe in every branch while they are imported: one assignment in the syntax tree.
A tracer would tell the same, but it is called for every line, and tests in virtual time are nothing but lines: they
took three times as long under one. Code of child processes is not seen.

Branches are those of `if`, `for`, `while` and `match`; a test that is a constant (`while True`) and `if TYPE_CHECKING`
decide nothing. At the end the share of each package is printed; one below `FLOOR` fails the run.
"""

from __future__ import annotations

import ast
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec, PathFinder, SourceFileLoader
from pathlib import Path
from types import CodeType, ModuleType
from typing import Any, Final, NoReturn

import pytest

import mkdaemon

PACKAGES: Final = ("bus", "control", "daemon", "link", "protocol", "replay", "translate")
"""Packages that fly, and the one that tells whether they fly as they did."""
FLOOR: Final = 0.95
"""Share of the branches of every package that the tests must take."""
PROBES: Final = "__branches_taken__"
"""Global of a module with a byte for every branch, 1 once it was taken."""
_SOURCE: Final = Path(mkdaemon.__file__).parent
_HANDED_OVER: Final = "branches"
"""Under which a worker process hands over what it saw."""

Branch = tuple[int, int]
"""Line that decides, and line to which it goes; 0 where nothing follows in its body."""


class _Probing:
    """Puts a probe into every branch; those in expressions are not counted.

    Attributes:
        branches: those found, in the order of their probes.
    """

    def __init__(self) -> None:
        self.branches: list[Branch] = []

    def visit(self, tree: ast.Module) -> None:
        """Put probes into what a module decides."""
        for node in list(ast.walk(tree)):
            match node:
                case ast.If() | ast.While():
                    if not _is_decided(node.test):
                        self._decide(node)
                case ast.For() | ast.AsyncFor():
                    self._decide(node)
                case ast.Match():
                    self._match(node)

    def _probe(self, deciding: ast.stmt, body: list[ast.stmt]) -> list[ast.stmt]:
        """A branch with a probe in front of what it does."""
        where = _place(body[0] if body else deciding)
        probe = ast.Subscript(
            ast.Name(PROBES, ast.Load(), **where), ast.Constant(len(self.branches), **where), ast.Store(), **where
        )
        self.branches.append((deciding.lineno, body[0].lineno if body else 0))
        return [ast.Assign([probe], ast.Constant(1, **where), **where), *body]

    def _decide(self, node: ast.If | ast.For | ast.AsyncFor | ast.While) -> None:
        node.body = self._probe(node, node.body)
        node.orelse = self._probe(node, node.orelse)

    def _match(self, node: ast.Match) -> None:
        last = node.cases[-1]
        for case in node.cases:
            case.body = self._probe(node, case.body)
        if last.guard is not None or not isinstance(last.pattern, ast.MatchAs) or last.pattern.pattern is not None:
            node.cases.append(ast.match_case(ast.MatchAs(**_place(node)), None, self._probe(node, [])))


def _is_decided(test: ast.expr) -> bool:
    return isinstance(test, ast.Constant) or (isinstance(test, ast.Name) and test.id == "TYPE_CHECKING")


def _place(node: ast.stmt) -> dict[str, Any]:
    return {name: getattr(node, name) for name in ("lineno", "col_offset", "end_lineno", "end_col_offset")}


def add_probes(source: str | bytes) -> tuple[ast.Module, list[Branch]]:
    """Return the syntax tree of a module with its probes, and its branches in the order of the probes."""
    probing = _Probing()
    tree = ast.parse(source)
    probing.visit(tree)
    return tree, probing.branches


class _Loader(SourceFileLoader):
    """Loads a module with its probes, always from its source."""

    def __init__(self, name: str, path: str, taken: dict[str, bytearray]) -> None:
        super().__init__(name, path)
        self._probes = taken.setdefault(path, bytearray())

    def path_stats(self, path: str) -> NoReturn:
        """Know nothing of compiled files: kept ones have no probes, and these are not to be kept.

        Raises:
            OSError: always.
        """
        raise OSError

    def source_to_code(self, data: Any, path: Any, *, _optimize: int = -1) -> CodeType:  # type: ignore[override]
        """Compile a module with its probes."""
        tree, branches = add_probes(data)
        self._probes.extend(bytes(len(branches) - len(self._probes)))
        return super().source_to_code(tree, path, _optimize=_optimize)

    def exec_module(self, module: ModuleType) -> None:
        """Run the module where its probes write to what is counted."""
        setattr(module, PROBES, self._probes)
        super().exec_module(module)


class Finder(MetaPathFinder):
    """Finds the modules of some packages before any other finder does.

    Attributes:
        taken: a byte for every branch of a file that was imported, by its path.
    """

    def __init__(self, packages: Iterable[str]) -> None:
        self.taken: dict[str, bytearray] = {}
        self._packages = frozenset(packages)

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """Return how to load a module with its probes; None where it needs none."""
        names = fullname.split(".")
        if not any(".".join(names[:count]) in self._packages for count in (1, 2)):
            return None
        spec = PathFinder.find_spec(fullname, path, target)
        if spec is not None and isinstance(spec.loader, SourceFileLoader):
            spec.loader = _Loader(fullname, spec.loader.path, self.taken)
        return spec


def missing_branches(taken: Mapping[str, bytearray], path: Path) -> tuple[int, list[Branch]]:
    """Return how many branches a file has, and those that were not taken: all of one that was never imported."""
    _, branches = add_probes(path.read_bytes())
    seen = taken.get(str(path)) or bytes(len(branches))
    return len(branches), sorted(branch for branch, was_taken in zip(branches, seen, strict=True) if not was_taken)


def shares(taken: Mapping[str, bytearray], source: Path = _SOURCE) -> Iterator[tuple[bool, str]]:
    """Yield of each package whether it keeps the floor, and its share in words; below it with the lines."""
    for package in PACKAGES:
        found = {path: missing_branches(taken, path) for path in sorted((source / package).rglob("*.py"))}
        count, left = (sum(counts) for counts in zip(*((n, len(lines)) for n, lines in found.values()), strict=True))
        share = 1.0 - left / count if count else 1.0
        words = f"{package:10} {100 * share:5.1f} % of {count} branches"
        if share < FLOOR:
            places = (f"{path.relative_to(source)} {lines}" for path, (_, lines) in found.items() if lines)
            words += f", {100 * FLOOR:g} % are needed; missing: {'; '.join(places)}"
        yield share >= FLOOR, words


class Measurement:
    """The plugin: gathers what this process and its worker processes took, and prints the shares.

    Attributes:
        finder: has what was taken.
    """

    def __init__(self, finder: Finder) -> None:
        self.finder = finder
        self._shares: list[tuple[bool, str]] = []

    @pytest.hookimpl(optionalhook=True)
    def pytest_testnodedown(self, node: Any, error: object) -> None:
        """Add what a worker process took."""
        for path, text in getattr(node, "workeroutput", {}).get(_HANDED_OVER, {}).items():
            seen = bytes.fromhex(text)
            known = self.finder.taken.setdefault(path, bytearray(len(seen)))
            known[:] = bytes(a | b for a, b in zip(known, seen, strict=True))

    def pytest_sessionfinish(self, session: pytest.Session) -> None:
        """Hand over, or compare with the floor."""
        output = getattr(session.config, "workeroutput", None)
        if output is not None:
            output[_HANDED_OVER] = {path: seen.hex() for path, seen in self.finder.taken.items()}
        elif session.config.getoption("branches"):
            self._shares = list(shares(self.finder.taken))
            if not all(holds for holds, _ in self._shares):
                session.exitstatus = session.exitstatus or pytest.ExitCode.TESTS_FAILED

    def pytest_terminal_summary(self, terminalreporter: pytest.TerminalReporter) -> None:
        """Print the shares."""
        for _, words in self._shares:
            terminalreporter.write_line(words)


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add `--branches`."""
    parser.addoption("--branches", action="store_true", help="print the share of branches taken, and hold the floor")


@pytest.hookimpl(tryfirst=True)
def pytest_load_initial_conftests(early_config: pytest.Config) -> None:
    """Begin before a conftest imports what is to be measured."""
    finder = Finder(f"mkdaemon.{package}" for package in PACKAGES)
    sys.meta_path.insert(0, finder)
    early_config.pluginmanager.register(Measurement(finder), "branches-taken")
