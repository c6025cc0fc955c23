"""`python -m lab mutants`: change the code that decides, one place at a time, and see whether a test notices."""

from __future__ import annotations

import functools
import hashlib
import importlib
import json
import os
import random
import re
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Final

import grimp
from cyclopts import Parameter

from lab.mutants.children import run_forked
from lab.mutants.operators import Module, Mutant
from lab.mutants.results import REASONS, Store, read_reasons, sum_up
from lab.mutants.sessions import Coverage, Server, Verdict, judge, serve, try_fresh
from lab.places import ROOT
from mkdaemon.cli.arguments import AsJson
from mkdaemon.errors import ConfigError, MkError

SUBJECTS: Final[Mapping[str, tuple[str, ...]]] = {
    "src/mkdaemon/control": ("tests/control", "tests/translate"),
    "src/mkdaemon/link/session/release.py": ("tests/link/test_release.py", "tests/link/test_steering.py"),
    "src/mkdaemon/guard.py": ("tests/guard", "tests/daemon/test_guard.py"),
}
"""What is mutated when nobody says what, and the tests that judge it."""
TELL_EVERY: Final = 10.0
"""Progress is written at most this often [s]."""


@dataclass(frozen=True, slots=True)
class Tree:
    """A source tree under test.

    Attributes:
        root: its folder.
        tests: files and folders of the tests that judge, from the root.
        modules: to mutate, by their paths from the root.
        keep: folder for what is kept between runs.
    """

    root: Path
    tests: tuple[str, ...]
    modules: Mapping[str, Module]
    keep: Path


def main(
    *files: Annotated[Path, Parameter(help="Files or folders; without any: control/, the release and the guard.")],
    sample: Annotated[int, Parameter(help="Mutants to try, drawn with the seed; 0: all.")] = 0,
    seed: int = 29,
    jobs: Annotated[int, Parameter(help="Processes.")] = 1,
    anew: Annotated[bool, Parameter(help="Forget what earlier runs found.")] = False,
    root: Annotated[Path, Parameter(help="Root of the source tree.")] = ROOT,
    as_json: AsJson = False,
) -> int:
    """Mutate the code that decides, and run the tests that come by; exit code 1 if a survivor has no reason.

    A mutant is killed when a test fails or takes too long. Reasons stand in `lab/mutants/survivors.toml`. A run that
    was stopped goes on where it was: verdicts are kept in `build/mutants`.
    """
    tree = plan_tree(root, files)
    mutants = draw([mutant for module in tree.modules.values() for mutant in module.mutants.values()], sample, seed)
    verdicts = judge_all(tree, mutants, jobs, anew=anew)
    summary = {"seed": seed, "sample": sample, **sum_up(mutants, verdicts, read_reasons(root / REASONS))}
    unexplained = [survivor for survivor in summary["survivors"] if not survivor["reason"]]
    if as_json:
        print(json.dumps(summary))
    else:
        for survivor in unexplained:
            print("{id} {scope}: {was} -> {becomes}".format(**survivor))
        shares = "{killed} of {mutants} killed ({timeouts} by time), {equivalent} equivalent: {share:.1%}"
        print(shares.format(**summary))
        print(f"{len(unexplained)} of {len(summary['survivors'])} survivors without a reason")
    return 1 if unexplained else 0


def plan_tree(root: Path, files: Sequence[Path]) -> Tree:
    """Find the modules to mutate, and their tests.

    Raises:
        ConfigError: nothing is there, or nobody said which tests judge it.
    """
    wanted = [(root / path).resolve().relative_to(root).as_posix() for path in files] or list(SUBJECTS)
    paths = sorted(
        {
            path.relative_to(root).as_posix()
            for name in wanted
            for path in ([root / name] if name.endswith(".py") else (root / name).rglob("*.py"))
            if path.is_file()
        }
    )
    if not paths:
        raise ConfigError(f"no Python file in {', '.join(wanted)}")
    tests = {test for path in paths for test in _tests_of(path)}
    modules = {path: Module(path, (root / path).read_text(encoding="utf-8")) for path in paths}
    return Tree(root, tuple(sorted(tests)), modules, root / "build" / "mutants")


def _tests_of(path: str) -> tuple[str, ...]:
    for subject, tests in SUBJECTS.items():
        if path == subject or path.startswith(f"{subject}/"):
            return tests
    package = path.removeprefix("src/").split("/")
    return (f"tests/{package[1].removesuffix('.py')}" if package[0] == "mkdaemon" else f"tests/{package[0]}",)


def draw(mutants: Sequence[Mutant], sample: int, seed: int) -> list[Mutant]:
    """Return all, or a sample that is the same for the same code; a larger one holds the smaller one."""
    if not 0 < sample < len(mutants):
        return list(mutants)
    names = sorted(mutant.id for mutant in mutants)
    random.Random(seed).shuffle(names)
    chosen = set(names[:sample])
    return [mutant for mutant in mutants if mutant.id in chosen]


def judge_all(tree: Tree, mutants: Sequence[Mutant], jobs: int, *, anew: bool = False) -> dict[str, Verdict]:
    """Judge every mutant that has no verdict yet.

    Returns:
        Verdicts by the mutants' ids.

    Raises:
        MkError: the tests cannot be run, or one fails without a mutant.
    """
    prints = _fingerprints(tree.root)
    store = Store(tree.keep / "verdicts.jsonl", prints, _digest("".join(sorted(prints.values()))))
    if anew:
        store.verdicts.clear()
    waiting = [mutant for mutant in mutants if mutant.id not in store.verdicts]
    progress = _Progress(len(waiting))
    if waiting:
        key = _digest(json.dumps([sorted(prints.items()), tree.tests, sorted(tree.modules)]))
        coverage = _read_coverage(tree.keep / f"coverage-{key}.json")
        swapped = [mutant for mutant in waiting if not mutant.at_import]
        unreached = {mutant.id for mutant in waiting if mutant.at_import}
        warm: list[str] = []
        for message in _serve_apart(tree, swapped, coverage, jobs):
            if "coverage" in message:
                coverage = Coverage(**message["coverage"])
                (tree.keep / f"coverage-{key}.json").write_text(json.dumps(message["coverage"]), encoding="utf-8")
            elif "modules" in message:
                warm = message["modules"]
            elif (verdict := Verdict(*message["verdict"])).outcome == "unreached":
                unreached.add(verdict.mutant)
            else:
                store.add(verdict)
                progress.add(verdict)
        assert coverage is not None
        for verdict in _judge_fresh(tree, [m for m in waiting if m.id in unreached], coverage, warm, jobs):
            store.add(verdict)
            progress.add(verdict)
    return {mutant.id: store.verdicts[mutant.id] for mutant in mutants}


def _serve_apart(
    tree: Tree, mutants: Sequence[Mutant], coverage: Coverage | None, jobs: int
) -> Iterator[dict[str, Any]]:
    """Run the warm session in a child, so that this process imports nothing that is mutated; give what it tells."""
    tree.keep.mkdir(parents=True, exist_ok=True)
    reading, writing = os.pipe()
    pid = os.fork()
    if not pid:
        try:
            os.close(reading)
            output = os.open(tree.keep / "pytest.log", os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
            for stream in (1, 2):
                os.dup2(output, stream)
            with os.fdopen(writing, "w", encoding="utf-8") as pipe:

                def report(message: dict[str, Any]) -> None:
                    pipe.write(json.dumps(message) + "\n")
                    pipe.flush()

                choose = functools.partial(choose_tests, tree)
                serve(Server(tree.root, tree.modules, mutants, coverage, jobs, choose, report), tree.root, tree.tests)
                report({"modules": [name for name in sys.modules if name.startswith(("mkdaemon.", "mksim."))]})
        except BaseException as error:  # noqa: BLE001 - the log says what it was
            print(repr(error), file=sys.stderr, flush=True)
            os._exit(1)
        os._exit(0)
    os.close(writing)
    with os.fdopen(reading, encoding="utf-8") as pipe:
        for line in pipe:
            yield json.loads(line)
    if os.waitpid(pid, 0)[1]:
        raise MkError(f"the tests could not be run; {tree.keep / 'pytest.log'} says why")


def _judge_fresh(
    tree: Tree, mutants: Sequence[Mutant], coverage: Coverage, warm: Sequence[str], jobs: int
) -> Iterator[Verdict]:
    """Judge mutants of what runs at import, each in a process that has not imported their module."""
    if not mutants:
        return
    _warm_up(tree.root, {mutant.path for mutant in mutants}, warm)
    names = {mutant.id: mutant for mutant in mutants}
    started: dict[str, float] = {}

    def work() -> Iterator[tuple[str, Callable[[], dict[str, Any]]]]:
        for mutant in mutants:
            tests = choose_tests(tree, mutant, coverage, Counter())
            started[mutant.id] = time.monotonic()
            module = tree.modules[mutant.path]
            yield mutant.id, functools.partial(try_fresh, tree.root, module, mutant, tests, coverage)

    for name, result in run_forked(work(), jobs):
        yield judge(names[name].id, result, time.monotonic() - started[name])


def _warm_up(root: Path, paths: set[str], warm: Sequence[str]) -> None:
    """Import what the tests import, unless it imports one of these files."""
    graph = grimp.build_graph("mkdaemon", "mksim", cache_dir=None)
    modules = {
        path.removeprefix("src/").removesuffix(".py").removesuffix("/__init__").replace("/", ".") for path in paths
    }
    touched = modules.union(*(graph.find_downstream_modules(module) for module in modules if module in graph.modules))
    for name in ("cv2", "numpy", "pydantic", "zenoh", "structlog", "hypothesis", *warm):
        if name not in touched:
            importlib.import_module(name)


def choose_tests(tree: Tree, mutant: Mutant, coverage: Coverage, killers: Counter[str]) -> list[str]:
    """Return the tests that come by a mutant: those that killed others first, then its own file's, then short ones.

    What runs at import is judged by the tests that run a line with one of its names, and by its own file's.
    """
    own = f"/test_{Path(mutant.path).stem}.py::"
    if mutant.at_import:
        chosen = {test for test in coverage.seconds if own in test} | _tests_with_names(tree, mutant, coverage)
    elif tree.modules[mutant.path].is_program:
        chosen = {test for test in coverage.seconds if test.startswith(_tests_of(mutant.path))}
    else:
        chosen = {test for test, lines in coverage.lines.items() if mutant.statement in lines.get(mutant.path, ())} or {
            test for test in coverage.seconds if own in test
        }
    return sorted(
        chosen - set(coverage.failing),
        key=lambda test: (-killers[test], own not in test, coverage.waited[test]),
    )


def _tests_with_names(tree: Tree, mutant: Mutant, coverage: Coverage) -> set[str]:
    """Tests that run a line in which a name of the mutant's statement stands, or whose file has it."""
    source = (tree.root / mutant.path).read_text(encoding="utf-8").splitlines()
    names = set(re.findall(r"[A-Za-z_]\w{2,}", source[mutant.statement - 1])[:1]) | set(mutant.scope.split(".")[-1:])
    pattern = re.compile(rf"\b({'|'.join(map(re.escape, names - {''}))})\b")
    lines_with = {
        path: {
            number
            for number, line in enumerate((tree.root / path).read_text(encoding="utf-8").splitlines(), 1)
            if pattern.search(line)
        }
        for path in tree.modules
    }
    files = {test.partition("::")[0] for test in coverage.seconds}
    naming = {file for file in files if pattern.search((tree.root / file).read_text(encoding="utf-8"))}
    return {
        test
        for test, lines in coverage.lines.items()
        if test.partition("::")[0] in naming
        or any(not lines_with[path].isdisjoint(numbers) for path, numbers in lines.items())
    }


def _fingerprints(root: Path) -> dict[str, str]:
    files = (path for folder in ("src", "tests", "lab") for path in (root / folder).rglob("*.py"))
    return {path.relative_to(root).as_posix(): _digest(path.read_text(encoding="utf-8")) for path in files}


def _digest(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def _read_coverage(file: Path) -> Coverage | None:
    return Coverage(**json.loads(file.read_text(encoding="utf-8"))) if file.is_file() else None


class _Progress:
    """How far a run is, on stderr."""

    def __init__(self, total: int) -> None:
        self._total = total
        self._counts: Counter[str] = Counter()
        self._start = self._shown_at = time.monotonic()

    def add(self, verdict: Verdict) -> None:
        """One more is judged."""
        self._counts[verdict.outcome] += 1
        now, done = time.monotonic(), self._counts.total()
        if now - self._shown_at >= TELL_EVERY or done == self._total:
            self._shown_at = now
            left = (now - self._start) * (self._total - done) / done
            counts = ", ".join(f"{count} {outcome}" for outcome, count in sorted(self._counts.items()))
            print(f"mutants: {done} of {self._total}, {counts}; {left / 60:.0f} min left", file=sys.stderr, flush=True)
