"""pytest for mutants: one warm session that forks a child for each, and a fresh one where a module is imported anew."""

from __future__ import annotations

import ast
import os
import signal
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec, PathFinder, SourceFileLoader
from pathlib import Path
from types import CodeType, ModuleType
from typing import Any, Final, NoReturn

import pytest
from hypothesis import Phase, settings

from lab.mutants.children import DIED, FAILED, run_forked
from lab.mutants.engine import LiveFunctions, NotReachableError, compile_tree
from lab.mutants.operators import Module, Mutant
from mkdaemon.errors import MkError

CPU_LIMIT: Final = 2.0
"""Computing time of a test with a mutant [s], and `CPU_FACTOR` times its own."""
CPU_FACTOR: Final = 5.0
WALL_LIMIT: Final = 60.0
"""Time of a test with a mutant [s], and `WALL_FACTOR` times its own: it may wait for what never comes."""
WALL_FACTOR: Final = 5.0
COLLECTING_LIMIT: Final = 60.0
"""Computing time of importing and collecting with a mutant [s]."""
OPTIONS: Final = (
    *("-q", "-p", "no:cacheprovider", "-p", "no:xdist", "-o", "timeout=0"),
    *("-W", "ignore::pytest.PytestAssertRewriteWarning", "-m", "not flight and not real_time"),
)
"""Of pytest. What runs in real time says nothing on a loaded machine."""
_SIGNALS: Final = (signal.SIGPROF, signal.SIGALRM)


@dataclass(slots=True)
class Coverage:
    """Which lines each test runs.

    Attributes:
        seconds: computing time of each test.
        waited: how long each took, computing or not [s].
        lines: of each test the lines of each file, its path from the root.
        failing: tests that fail without a mutant; they judge none.
    """

    seconds: dict[str, float] = field(default_factory=dict)
    waited: dict[str, float] = field(default_factory=dict)
    lines: dict[str, dict[str, list[int]]] = field(default_factory=dict)
    failing: list[str] = field(default_factory=list)


@dataclass(frozen=True, slots=True)
class Verdict:
    """What became of a mutant.

    Attributes:
        mutant: its id.
        outcome: `killed`, `timeout`, `survived`, or `unreached` where no test came to it in the warm session.
        by: test that killed it.
        seconds: how long that took.
    """

    mutant: str
    outcome: str
    by: str
    seconds: float


class _Profile:
    """Plugin: an example that fails is enough; nobody reads the smallest one."""

    @pytest.hookimpl(trylast=True)
    def pytest_configure(self) -> None:
        house = settings.default
        settings.register_profile("mutants", parent=house, phases=(Phase.explicit, Phase.generate), database=None)
        settings.load_profile("mutants")


class _Judge:
    """Plugin: keeps the first test that fails, and limits the time of each where it is known what it takes."""

    def __init__(self, known: Coverage | None = None) -> None:
        self.killer = ""
        self._known = known

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Generator[None, object, object]:
        if self._known is not None:
            cpu = self._known.seconds.get(item.nodeid, CPU_LIMIT)
            wall = self._known.waited.get(item.nodeid, WALL_LIMIT)
            limit_time(CPU_LIMIT + CPU_FACTOR * cpu, WALL_LIMIT + WALL_FACTOR * wall)
        return (yield)

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        if report.failed and not self.killer:
            self.killer = report.nodeid


def limit_time(cpu: float, wall: float) -> None:
    """End this process when it has computed for so long [s], or when so much time is over [s]."""
    for number in _SIGNALS:
        signal.signal(number, signal.SIG_DFL)
    signal.setitimer(signal.ITIMER_PROF, cpu)
    signal.setitimer(signal.ITIMER_REAL, wall)


class Server:
    """Plugin of the warm session: in place of running the tests it measures them, then judges mutants.

    Args:
        root: of the source tree.
        modules: by their paths from the root.
        mutants: those to judge.
        coverage: known already, or None.
        jobs: children at a time.
        choose: tests for a mutant, the likeliest to kill it first.
        report: takes each verdict and, when measured, the coverage.
    """

    def __init__(
        self,
        root: Path,
        modules: Mapping[str, Module],
        mutants: Sequence[Mutant],
        coverage: Coverage | None,
        jobs: int,
        choose: Callable[[Mutant, Coverage, Counter[str]], list[str]],
        report: Callable[[dict[str, Any]], None],
    ) -> None:
        self._root = root
        self._modules = modules
        self._mutants = mutants
        self._coverage = coverage
        self._jobs = jobs
        self._choose = choose
        self._report = report
        self._items: dict[str, pytest.Item] = {}
        self._killers: Counter[str] = Counter()
        self._started: dict[str, float] = {}

    def _file(self, path: str) -> str:
        return str(self._root / path)

    @pytest.hookimpl(tryfirst=True)
    def pytest_runtestloop(self, session: pytest.Session) -> bool:
        """Judge in place of running.

        Raises:
            Interrupted: a file of tests could not be collected; without it survivors would prove nothing.
        """
        if session.testsfailed:
            raise session.Interrupted(f"{session.testsfailed} errors during collection")
        self._items = {item.nodeid: item for item in session.items}
        functions = LiveFunctions(self._file(path) for path in self._modules)
        if self._coverage is None:
            ((_, result),) = run_forked([("coverage", lambda: self._measure(functions))], 1)
            if DIED in result or FAILED in result:
                pytest.exit(f"the tests could not be measured: {result}", returncode=3)
            self._coverage = Coverage(**result)
            self._report({"coverage": result})
        names = {mutant.id: mutant for mutant in self._mutants}
        for name, result in run_forked(self._work(functions), self._jobs):
            verdict = judge(names[name].id, result, time.monotonic() - self._started[name])
            if verdict.outcome == "killed":
                self._killers[verdict.by] += 1
            self._report({"verdict": [verdict.mutant, verdict.outcome, verdict.by, verdict.seconds]})
        return True

    def _work(self, functions: LiveFunctions) -> Iterator[tuple[str, Callable[[], dict[str, Any]]]]:
        assert self._coverage is not None
        for mutant in self._mutants:
            tests = [test for test in self._choose(mutant, self._coverage, self._killers) if test in self._items]
            if not tests:
                self._report({"verdict": [mutant.id, "unreached", "", 0.0]})
                continue
            self._started[mutant.id] = time.monotonic()
            yield mutant.id, lambda mutant=mutant, tests=tests: self._try(functions, mutant, tests)  # type: ignore[misc]

    def _try(self, functions: LiveFunctions, mutant: Mutant, tests: list[str]) -> dict[str, Any]:
        """In the child: become the mutant and run tests until one fails."""
        module, file = self._modules[mutant.path], self._file(mutant.path)
        try:
            with module.mutated(mutant.id) as tree:
                functions.exchange(file, module.original, tree)
                if module.is_program:
                    for living in [m for m in sys.modules.values() if getattr(m, "__file__", None) == file]:
                        living.__file__ = write_program(file, tree)
        except NotReachableError as error:
            return {"unreached": str(error)}
        assert self._coverage is not None
        return self._run([self._items[test] for test in tests], _Judge(self._coverage))

    def _run(self, items: Sequence[pytest.Item], judge: _Judge) -> dict[str, Any]:
        items[0].config.pluginmanager.register(judge, "judge-of-mutants")
        for item, following in zip(items, [*items[1:], None], strict=True):
            item.ihook.pytest_runtest_protocol(item=item, nextitem=following)
            if judge.killer:
                break
        for timer in (signal.ITIMER_PROF, signal.ITIMER_REAL):
            signal.setitimer(timer, 0.0)
        return {"by": judge.killer}

    def _measure(self, functions: LiveFunctions) -> dict[str, Any]:
        """In a child: run every test with probes in the files."""
        seen = {path: functions.add_probes(self._file(path), module.original) for path, module in self._modules.items()}
        coverage = Coverage()
        items = list(self._items.values())
        for item, following in zip(items, [*items[1:], None], strict=True):
            for lines in seen.values():
                lines.clear()
            cpu_start, wall_start = time.process_time(), time.monotonic()
            failed = _Judge()
            item.config.pluginmanager.register(failed, "failing")
            item.ihook.pytest_runtest_protocol(item=item, nextitem=following)
            item.config.pluginmanager.unregister(failed)
            if failed.killer:
                coverage.failing.append(item.nodeid)
            coverage.seconds[item.nodeid] = time.process_time() - cpu_start
            coverage.waited[item.nodeid] = time.monotonic() - wall_start
            coverage.lines[item.nodeid] = {path: sorted(lines) for path, lines in seen.items() if lines}
        return asdict(coverage)


def judge(mutant: str, result: Mapping[str, Any], seconds: float) -> Verdict:
    """Say what the result of a child means."""
    if "unreached" in result:
        return Verdict(mutant, "unreached", "", seconds)
    if DIED in result:
        return Verdict(mutant, "timeout" if result[DIED] in _SIGNALS else "killed", "", seconds)
    if FAILED in result:
        return Verdict(mutant, "killed", result[FAILED].splitlines()[-1], seconds)
    return Verdict(mutant, "killed" if result["by"] else "survived", result["by"], seconds)


def serve(server: Server, root: Path, tests: Sequence[str]) -> None:
    """Run the warm session with tests of these files and folders.

    Raises:
        MkError: the tests could not be collected.
    """
    os.chdir(root)
    code = pytest.main([*OPTIONS, *tests], plugins=[_Profile(), server])
    if code != pytest.ExitCode.OK:
        raise MkError(f"pytest ended with {code!r}; see what `pytest --collect-only {' '.join(tests)}` says")


def write_program(file: str, tree: ast.Module) -> str:
    """Write a mutant as a file, for tests that start the module as a program of its own, and return its path."""
    place = Path(tempfile.mkdtemp(prefix="program-")) / Path(file).name
    place.write_text(ast.unparse(tree), encoding="utf-8")
    return str(place)


class _Loader(SourceFileLoader):
    """Loads one module as a mutant."""

    def __init__(self, name: str, path: str, tree: ast.Module) -> None:
        super().__init__(name, path)
        self._tree = tree

    def path_stats(self, path: str) -> NoReturn:
        """Know nothing of compiled files.

        Raises:
            OSError: always.
        """
        raise OSError

    def source_to_code(self, data: Any, path: Any, *, _optimize: int = -1) -> CodeType:  # type: ignore[override]
        """Compile the mutant."""
        return compile_tree(self._tree, str(path))

    def exec_module(self, module: ModuleType) -> None:
        """Run the mutant; who starts its file as a program starts the mutant."""
        super().exec_module(module)
        module.__file__ = write_program(self.path, self._tree)


class _Finder(MetaPathFinder):
    """Finds one module's mutant before anybody finds the module."""

    def __init__(self, file: str, tree: ast.Module) -> None:
        self._file = file
        self._tree = tree

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        if fullname.rpartition(".")[2] not in self._file:
            return None
        spec = PathFinder.find_spec(fullname, path, target)
        if spec is None or spec.origin != self._file:
            return None
        spec.loader = _Loader(fullname, self._file, self._tree)
        return spec


class _Selection:
    """Plugin: keeps the chosen tests, in their order, and those that nobody knew."""

    def __init__(self, tests: Sequence[str], known: Iterable[str]) -> None:
        self._tests = tests
        self._known = frozenset(known)

    @pytest.hookimpl(trylast=True)
    def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> None:
        by_id = {item.nodeid: item for item in items}
        new = [item for item in items if item.nodeid not in self._known]
        items[:] = [by_id[test] for test in self._tests if test in by_id] + new


def try_fresh(root: Path, module: Module, mutant: Mutant, tests: Sequence[str], coverage: Coverage) -> dict[str, Any]:
    """In a child that has not imported the module: import the mutant and run tests until one fails."""
    limit_time(COLLECTING_LIMIT, WALL_FACTOR * COLLECTING_LIMIT)
    judging = _Judge(coverage)
    files = dict.fromkeys(test.partition("::")[0] for test in tests)
    with module.mutated(mutant.id) as tree:
        sys.meta_path.insert(0, _Finder(str(root / mutant.path), tree))
        os.chdir(root)
        code = pytest.main([*OPTIONS, "-x", *files], plugins=[_Profile(), judging, _Selection(tests, coverage.seconds)])
    if code not in (pytest.ExitCode.OK, pytest.ExitCode.NO_TESTS_COLLECTED) and not judging.killer:
        return {"by": "collection of the tests"}
    return {"by": judging.killer}
