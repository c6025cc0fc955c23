"""`python -m lab mutants`: change the code that decides, one place at a time, and see whether a test notices."""

from __future__ import annotations

import functools
import importlib
import json
import os
import random
import re
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Any, Final

import grimp
from cyclopts import Parameter

from lab.mutants.children import run_forked
from lab.mutants.operators import Module, Mutant
from lab.mutants.results import REASONS, Store, fingerprint, read_reasons, sum_up
from lab.mutants.sessions import PATIENT, Choice, Coverage, Server, Verdict, is_doubtful, judge, serve, try_fresh
from lab.places import ROOT
from mkdaemon.cli.arguments import AsJson
from mkdaemon.errors import ConfigError, MkError

SUBJECTS: Final[Mapping[str, tuple[str, ...]]] = {
    "src/mkdaemon/control": ("tests/control", "tests/translate"),
    "src/mkdaemon/client/teleop": ("tests/client/teleop",),
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
    sample: Annotated[int, Parameter(help="Mutants of each subject to try, drawn with the seed; 0: all.")] = 0,
    seed: int = 29,
    jobs: Annotated[int, Parameter(help="Processes.")] = 1,
    tests: Annotated[
        list[Path] | None, Parameter(help="Files or folders of tests that judge, in place of all that belong to them.")
    ] = None,
    budget: Annotated[
        float, Parameter(help="Computing time of the tests of one mutant at most [s]; 0: no limit.")
    ] = 0.0,
    anew: Annotated[bool, Parameter(help="Forget what earlier runs found.")] = False,
    root: Annotated[Path, Parameter(help="Root of the source tree.")] = ROOT,
    as_json: AsJson = False,
) -> int:
    """Mutate the code that decides, and run the tests that come by; exit code 1 if a survivor has no reason.

    A mutant is killed when a test fails or computes for too long. Reasons stand in `lab/mutants/survivors.toml`. A run
    that was stopped goes on where it was: verdicts are kept in `build/mutants`.
    """
    tree = plan_tree(root, files, tests or ())
    by_subject: dict[str, list[Mutant]] = {}
    for path, module in tree.modules.items():
        by_subject.setdefault(_subject_of(path), []).extend(module.mutants.values())
    mutants = [mutant for every in by_subject.values() for mutant in draw(every, sample, seed)]
    verdicts, first = judge_all(tree, mutants, jobs, budget=budget, anew=anew)
    summary = {
        "seed": seed,
        "sample": sample,
        "budget": budget,
        "tests": sorted(path.as_posix() for path in tests or ()),
        "of": {name: len(every) for name, every in by_subject.items()},
        **sum_up(mutants, verdicts, read_reasons(root / REASONS), _subject_of, first),
    }
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


def plan_tree(root: Path, files: Sequence[Path], tests: Sequence[Path] = ()) -> Tree:
    """Find the modules to mutate, and their tests.

    Raises:
        ConfigError: nothing is there, or nobody said which tests judge it.
    """
    wanted = [_from_root(root, path) for path in files] or list(SUBJECTS)
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
    judges = {_from_root(root, path) for path in tests} or {test for path in paths for test in _tests_of(path)}
    modules = {path: Module(path, (root / path).read_text(encoding="utf-8")) for path in paths}
    return Tree(root, tuple(sorted(judges)), modules, root / "build" / "mutants")


def _from_root(root: Path, path: Path) -> str:
    return (root / path).resolve().relative_to(root).as_posix()


def _subject_of(path: str) -> str:
    """What of `SUBJECTS` a file belongs to; itself, where it is none of them."""
    return next((name for name in SUBJECTS if path == name or path.startswith(f"{name}/")), path)


def _tests_of(path: str) -> tuple[str, ...]:
    if (subject := _subject_of(path)) in SUBJECTS:
        return SUBJECTS[subject]
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


def judge_all(
    tree: Tree, mutants: Sequence[Mutant], jobs: int, *, budget: float = 0.0, anew: bool = False
) -> tuple[dict[str, Verdict], dict[str, Verdict]]:
    """Judge every mutant that has no verdict yet.

    Args:
        tree: under test.
        mutants: to judge.
        jobs: processes.
        budget: computing time of the tests of one mutant at most [s]; 0 for no limit.
        anew: forget what earlier runs found.

    Returns:
        Verdicts by the mutants' ids: those that hold, and those that were found first.

    Raises:
        MkError: the tests cannot be run, or one fails without a mutant.
    """
    prints = _fingerprints(tree.root)
    store = Store(tree.keep / "verdicts.jsonl", prints)
    if anew:
        store.forget()
    waiting = [mutant for mutant in mutants if mutant.id not in store.verdicts]
    progress = _Progress(len(waiting))
    if waiting:
        # Each child that imports a module anew would compile it, and every module that stands on it, anew.
        sys.dont_write_bytecode = False
        os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
        kept = _KeptCoverage(tree, prints)
        coverage = kept.read()
        choose = Chooser(tree, store, budget)
        unreached = {mutant.id for mutant in waiting if mutant.at_import}
        warm: list[str] = []
        swapped = [mutant for mutant in waiting if not mutant.at_import]
        for message in _serve_apart(tree, swapped, coverage, jobs, choose):
            if "coverage" in message:
                coverage = Coverage(**message["coverage"])
                kept.write(coverage)
            elif "modules" in message:
                warm = message["modules"]
            elif (verdict := Verdict(**message["verdict"])).outcome == "unreached":
                unreached.add(verdict.mutant)
            else:
                store.add(verdict, message["files"])
                progress.add(verdict)
        for verdict, files in _judge_fresh(
            tree, [m for m in waiting if m.id in unreached], coverage, warm, jobs, choose
        ):
            store.add(verdict, files)
            progress.add(verdict)
    ids = [mutant.id for mutant in mutants]
    return {name: store.verdicts[name] for name in ids}, {name: store.first[name] for name in ids}


class _KeptCoverage:
    """What was measured of tests in earlier runs; it holds while the source and what tests share is the same."""

    def __init__(self, tree: Tree, prints: Mapping[str, str]) -> None:
        shared = {path: print_ for path, print_ in prints.items() if not Path(path).name.startswith("test_")}
        key = fingerprint(json.dumps([sorted(shared.items()), sorted(tree.modules)]))
        self._file = tree.keep / f"coverage-{key}.json"
        self._prints = prints

    def read(self) -> Coverage:
        """Return it, without the tests whose file has changed."""
        if not self._file.is_file():
            return Coverage()
        kept = json.loads(self._file.read_text(encoding="utf-8"))
        same = {file for file, print_ in kept["prints"].items() if self._prints.get(file) == print_}
        found = Coverage(**kept["coverage"])
        for by_test in (found.seconds, found.taken, found.lines):
            for test in [test for test in by_test if test.partition("::")[0] not in same]:
                del by_test[test]
        found.failing = [test for test in found.failing if test in found.seconds]
        return found

    def write(self, coverage: Coverage) -> None:
        """Keep it."""
        files = {test.partition("::")[0] for test in coverage.seconds}
        kept = {"prints": {file: self._prints[file] for file in files}, "coverage": asdict(coverage)}
        self._file.write_text(json.dumps(kept), encoding="utf-8")


def _serve_apart(
    tree: Tree, mutants: Sequence[Mutant], coverage: Coverage, jobs: int, choose: Chooser
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
                    if "verdict" in message:
                        choose.learn(Verdict(**message["verdict"]))
                    pipe.write(json.dumps(message) + "\n")
                    pipe.flush()

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
    tree: Tree, mutants: Sequence[Mutant], coverage: Coverage, warm: Sequence[str], jobs: int, choose: Chooser
) -> Iterator[tuple[Verdict, list[str]]]:
    """Judge mutants of what runs at import, each in a process that has not imported their module."""
    if not mutants:
        return
    _warm_up(tree.root, {mutant.path for mutant in mutants}, warm)
    by_id = {mutant.id: mutant for mutant in mutants}
    files: dict[str, list[str]] = {}

    def work(names: Iterable[str], patience: float) -> Iterator[tuple[str, Callable[[], dict[str, Any]]]]:
        for name in names:
            mutant = by_id[name]
            tests, files[name] = choose(mutant, coverage, is_imported=False)
            module = tree.modules[mutant.path]
            yield name, functools.partial(try_fresh, tree.root, module, mutant, tests, coverage, patience)

    doubtful: list[str] = []
    for name, result in run_forked(work(by_id, 1.0), jobs):
        if is_doubtful(result, coverage):
            doubtful.append(name)
            continue
        verdict = judge(name, result)
        choose.learn(verdict)
        yield verdict, files[name]
    for name, result in run_forked(work(doubtful, PATIENT), 1):
        yield judge(name, result), files[name]


def _warm_up(root: Path, paths: set[str], warm: Sequence[str]) -> None:
    """Import what the tests import, unless it, or a package it is in, imports one of these files.

    Raises:
        MkError: one of the files was imported all the same; its mutants would live.
    """
    graph = grimp.build_graph("mkdaemon", "mksim", cache_dir=None)
    modules = {
        path.removeprefix("src/").removesuffix(".py").removesuffix("/__init__").replace("/", ".") for path in paths
    }
    touched = touched_by(graph, modules)
    for name in ("cv2", "numpy", "pydantic", "zenoh", "structlog", "hypothesis", *warm):
        parts = name.split(".")
        if touched.isdisjoint(".".join(parts[: k + 1]) for k in range(len(parts))):
            importlib.import_module(name)
    if imported := sorted(modules & set(sys.modules)):
        raise MkError(f"{', '.join(imported)} are imported before their mutants")


def touched_by(graph: grimp.ImportGraph, modules: set[str]) -> set[str]:
    """Modules that import one of these, themselves included; whoever imports a module imports the package it is in."""
    touched, new = set(modules), modules & graph.modules
    while new:
        inside = new.union(*(graph.find_descendants(module) for module in new))
        new = inside.union(*(graph.find_downstream_modules(module) for module in inside)) - touched
        touched |= new
    return touched


class Chooser:
    """Chooses tests for mutants, those that tell most in the least time first.

    Args:
        tree: under test.
        store: what earlier runs found.
        budget: computing time of the tests of one mutant at most [s]; 0 for no limit.
    """

    def __init__(self, tree: Tree, store: Store, budget: float) -> None:
        self._tree = tree
        self._store = store
        self._budget = budget
        self._killers = store.killers()

    def learn(self, verdict: Verdict) -> None:
        """Take note of the test that killed a mutant."""
        if verdict.outcome == "killed":
            self._killers[verdict.mutant.partition(":")[0], verdict.by] += 1

    def __call__(self, mutant: Mutant, coverage: Coverage, *, is_imported: bool = True) -> Choice:
        """Choose of the tests that come by a mutant those that it has not outlived yet.

        Args:
            mutant: to judge.
            coverage: what each test runs.
            is_imported: its module is imported already, so that only what runs again can tell.
        """
        coming_by = self._coming_by(mutant, coverage, is_imported=is_imported) - set(coverage.failing)
        outlived = self._store.outlived(mutant.id)
        tests: list[str] = []
        left_out: set[str] = set()
        spent = 0.0
        for test in sorted(coming_by, key=lambda test: self._cost(test, mutant, coverage)):
            if test.partition("::")[0] in outlived:
                continue
            if tests and 0.0 < self._budget < spent + coverage.seconds[test]:
                left_out.add(test.partition("::")[0])
            else:
                spent += coverage.seconds[test]
                tests.append(test)
        return Choice(tests, sorted({test.partition("::")[0] for test in coming_by} - left_out))

    def _cost(self, test: str, mutant: Mutant, coverage: Coverage) -> tuple[float, str]:
        """Time of a test over a guess how likely it notices: it has before, or it is the test of this file."""
        folder = "/".join(["tests", *Path(mutant.path).parts[2:-1], ""])
        likely = 0.1 + self._killers[mutant.path, test]
        likely += 1.0 if f"/test_{Path(mutant.path).stem}.py::" in test else 0.3 * test.startswith(folder)
        return max(coverage.taken[test], 0.002) / likely, test

    def _coming_by(self, mutant: Mutant, coverage: Coverage, *, is_imported: bool) -> set[str]:
        """Tests that run the mutated line.

        What runs at import only is judged by the tests that run a line with one of its names, and by its own file's.
        """
        if self._tree.modules[mutant.path].is_program and not mutant.at_import:
            return {test for test in coverage.seconds if test.startswith(_tests_of(mutant.path))}
        passing = {test for test, lines in coverage.lines.items() if mutant.statement in lines.get(mutant.path, ())}
        if passing or is_imported:
            return passing
        own = {test for test in coverage.seconds if f"/test_{Path(mutant.path).stem}.py::" in test}
        return own | _tests_with_names(self._tree, mutant, coverage)


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
    return {path.relative_to(root).as_posix(): fingerprint(path.read_text(encoding="utf-8")) for path in files}


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
