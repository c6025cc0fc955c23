"""pytest for mutants: one warm session that forks a child for each, and a fresh one where a module is imported anew."""

from __future__ import annotations

import ast
import functools
import math
import os
import signal
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec, PathFinder, SourceFileLoader
from pathlib import Path
from types import CodeType, ModuleType
from typing import Any, Final, NamedTuple, NoReturn

import pytest
from hypothesis import Phase, settings

from lab.mutants.children import DIED, FAILED, SECONDS, run_forked
from lab.mutants.engine import LiveFunctions, NotReachableError, compile_tree
from lab.mutants.operators import Module, Mutant
from mkdaemon.errors import MkError

CPU_LIMIT: Final = 2.0
"""Computing time of a test with a mutant [s], and `CPU_FACTOR` times its own."""
CPU_FACTOR: Final = 5.0
WAITING_LIMIT: Final = 20.0
"""Time that a test with a mutant may take [s], and `WAITING_FACTOR` times its own: it may wait for what never comes."""
WAITING_FACTOR: Final = 5.0
PATIENT: Final = 4.0
"""A mutant is tried again, with this many times its limits, before it counts as killed by time or by a test that waits:
what is computed once in a process, a test that ran before may have paid for when its time was measured."""
WAITS: Final = 0.1
"""A test that takes so much longer than it computes waits for something, and a loaded machine can make it fail [s]."""
COLLECTING_LIMIT: Final = 60.0
"""Computing time of importing and collecting with a mutant [s]."""
OPTIONS: Final = (
    *("-q", "-p", "no:cacheprovider", "-o", "timeout=0"),
    *("-W", "ignore::pytest.PytestAssertRewriteWarning", "-m", "not flight and not real_time"),
)
"""Of pytest. What runs in real time says nothing on a loaded machine."""
_LIMITING: Final = (signal.SIGPROF, signal.SIGKILL)
"""Signals that end a mutant which takes too long: it computes, or it waits."""


@dataclass(slots=True)
class Coverage:
    """Which lines each test runs.

    Attributes:
        seconds: computing time of each test.
        taken: how long each took, less the time it waited for a processor [s].
        lines: of each test the lines of each file, its path from the root.
        failing: tests that fail without a mutant; they judge none.
    """

    seconds: dict[str, float] = field(default_factory=dict)
    taken: dict[str, float] = field(default_factory=dict)
    lines: dict[str, dict[str, list[int]]] = field(default_factory=dict)
    failing: list[str] = field(default_factory=list)

    def add(self, other: Mapping[str, Any]) -> None:
        """Take in what was measured of other tests, as plain values."""
        for kept, new in ((self.seconds, "seconds"), (self.taken, "taken"), (self.lines, "lines")):
            kept.update(other[new])
        self.failing.extend(other["failing"])

    def waits(self, test: str) -> bool:
        """Whether a test waits for something, so that it may fail because the machine is loaded."""
        return self.taken.get(test, WAITS) - self.seconds.get(test, 0.0) >= WAITS


@dataclass(frozen=True, slots=True)
class Verdict:
    """What became of a mutant.

    Attributes:
        mutant: its id.
        outcome: `killed`, `timeout`, `survived`, or `unreached` where no test came to it in the warm session.
        by: test that killed it.
        seconds: computing time that took.
    """

    mutant: str
    outcome: str
    by: str
    seconds: float


class Choice(NamedTuple):
    """Tests for a mutant.

    Attributes:
        tests: to run, in this order.
        files: of these, and of those that were run before: none of their tests is left out.
    """

    tests: list[str]
    files: list[str]


class _Profile:
    """Plugin: an example that fails is enough; nobody reads the smallest one."""

    @pytest.hookimpl(trylast=True)
    def pytest_configure(self) -> None:
        house = settings.default
        settings.register_profile("mutants", parent=house, phases=(Phase.explicit, Phase.generate), database=None)
        settings.load_profile("mutants")


class _Judge:
    """Plugin: keeps the first test that fails."""

    def __init__(self) -> None:
        self.killer = ""

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        if report.failed and not self.killer:
            self.killer = report.nodeid


class _StrictJudge(_Judge):
    """Plugin: keeps the first test that fails, and limits the time of each by what it takes without a mutant."""

    def __init__(self, known: Coverage, patience: float) -> None:
        super().__init__()
        self._known = known
        self._patience = patience
        self._limits = _Limits()
        self._limits.set(COLLECTING_LIMIT, patience * WAITING_FACTOR * COLLECTING_LIMIT)

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Generator[None, object, object]:
        cpu = self._known.seconds.get(item.nodeid, CPU_LIMIT)
        taken = self._known.taken.get(item.nodeid, WAITING_LIMIT)
        patience = self._patience
        self._limits.set(patience * (CPU_LIMIT + CPU_FACTOR * cpu), patience * (WAITING_LIMIT + WAITING_FACTOR * taken))
        return (yield)


def fair_clock() -> float:
    """Time [s], less what this process waited for a processor: a loaded machine is slow, not wrong."""
    _, waited_ns, _ = Path("/proc/self/schedstat").read_text(encoding="ascii").split()
    return time.monotonic() - int(waited_ns) * 1e-9


class _Watchdog(threading.Thread):
    """Kills this process when a deadline is over. Signals would not: the guard ignores them.

    Attributes:
        deadline: on the fair clock [s].
    """

    def __init__(self) -> None:
        super().__init__(name="watchdog", daemon=True)
        self.deadline = math.inf

    def run(self) -> None:
        """Look every second."""
        while fair_clock() < self.deadline:
            time.sleep(1.0)
        os.kill(os.getpid(), signal.SIGKILL)


class _Limits:
    """Ends this process when it takes too long, by SIGPROF where it computes and by SIGKILL where it waits."""

    def __init__(self) -> None:
        signal.signal(signal.SIGPROF, signal.SIG_DFL)
        self._watchdog = _Watchdog()
        self._watchdog.start()

    def set(self, cpu: float, taken: float) -> None:
        """Allow so much computing time from now, and so much of its own time [s]."""
        self._watchdog.deadline = fair_clock() + taken
        signal.setitimer(signal.ITIMER_PROF, cpu)


class _SharedFixtures:
    """Plugin: what fixtures cost and run that are made once for many tests.

    A mutant is judged in a process of its own, where each test makes them anew: they are a part of it.

    Args:
        seen: lines of each file that have run, as they are noted.
    """

    def __init__(self, seen: Mapping[str, set[int]]) -> None:
        self._seen = seen
        self._made: dict[tuple[str, str], Coverage] = {}  # by name and by where it is declared
        self._made_now: set[tuple[str, str]] = set()

    @pytest.hookimpl(wrapper=True)
    def pytest_fixture_setup(self, fixturedef: pytest.FixtureDef[Any]) -> Generator[None, object, object]:
        if fixturedef.scope == "function":
            return (yield)
        before = {path: set(lines) for path, lines in self._seen.items()}
        for lines in self._seen.values():
            lines.clear()
        cpu_start, start = time.process_time(), fair_clock()
        try:
            return (yield)
        finally:
            key = fixturedef.argname, fixturedef.baseid
            made = self._made[key] = Coverage()
            made.seconds[""] = time.process_time() - cpu_start
            made.taken[""] = fair_clock() - start
            made.lines[""] = {path: sorted(lines) for path, lines in self._seen.items() if lines}
            self._made_now.add(key)
            for path, lines in self._seen.items():
                lines |= before[path]

    def add_to(self, item: pytest.Item, measured: Coverage) -> None:
        """Add to what was measured of a test, which has just run, the fixtures that an earlier one made for it."""
        name, used = item.nodeid, getattr(item, "fixturenames", ())
        for (fixture, place), made in self._made.items():
            if fixture in used and name.startswith(place) and (fixture, place) not in self._made_now:
                measured.seconds[name] += made.seconds[""]
                measured.taken[name] += made.taken[""]
                for path, lines in made.lines[""].items():
                    measured.lines[name][path] = sorted({*measured.lines[name].get(path, ()), *lines})
        self._made_now.clear()


class Server:
    """Plugin of the warm session: in place of running the tests it measures them, then judges mutants.

    Args:
        root: of the source tree.
        modules: by their paths from the root.
        mutants: those to judge.
        coverage: known already; tests without are measured.
        jobs: children at a time.
        choose: tests for a mutant, those that tell most in the least time first.
        report: takes each verdict and, when measured, the coverage.
    """

    def __init__(
        self,
        root: Path,
        modules: Mapping[str, Module],
        mutants: Sequence[Mutant],
        coverage: Coverage,
        jobs: int,
        choose: Callable[[Mutant, Coverage], Choice],
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
        self._files: dict[str, list[str]] = {}

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
        if unknown := [item for name, item in self._items.items() if name not in self._coverage.seconds]:
            ((_, result),) = run_forked([("coverage", lambda: self._measure(functions, unknown))], 1)
            if DIED in result or FAILED in result:
                pytest.exit(f"the tests could not be measured: {result}", returncode=3)
            self._coverage.add(result["coverage"])
            self._report({"coverage": asdict(self._coverage)})
        mutants = {mutant.id: mutant for mutant in self._mutants}
        doubtful: list[Mutant] = []
        for name, result in run_forked(self._work(functions, self._mutants, 1.0), self._jobs):
            if is_doubtful(result, self._coverage):
                doubtful.append(mutants[name])
            else:
                self._tell(name, result)
        for name, result in run_forked(self._work(functions, doubtful, PATIENT), 1):
            self._tell(name, result)
        return True

    def _tell(self, name: str, result: Mapping[str, Any]) -> None:
        self._report({"verdict": asdict(judge(name, result)), "files": self._files[name]})

    def _work(
        self, functions: LiveFunctions, mutants: Sequence[Mutant], patience: float
    ) -> Iterator[tuple[str, Callable[[], dict[str, Any]]]]:
        for mutant in mutants:
            tests, self._files[mutant.id] = self._choose(mutant, self._coverage)
            tests = [test for test in tests if test in self._items]
            if tests:
                yield mutant.id, functools.partial(self._try, functions, mutant, tests, patience)
            elif self._files[mutant.id]:
                self._tell(mutant.id, {"by": "", SECONDS: 0.0})
            else:
                self._tell(mutant.id, {"unreached": "no test runs it", SECONDS: 0.0})

    def _try(self, functions: LiveFunctions, mutant: Mutant, tests: list[str], patience: float) -> dict[str, Any]:
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
        return self._run([self._items[test] for test in tests], _StrictJudge(self._coverage, patience))

    def _run(self, items: Sequence[pytest.Item], judge: _Judge) -> dict[str, Any]:
        items[0].config.pluginmanager.register(judge, "judge-of-mutants")
        for item, following in zip(items, [*items[1:], None], strict=True):
            item.ihook.pytest_runtest_protocol(item=item, nextitem=following)
            if judge.killer:
                break
        return {"by": judge.killer}

    def _measure(self, functions: LiveFunctions, items: Sequence[pytest.Item]) -> dict[str, Any]:
        """In a child: run tests with probes in the files."""
        seen = {path: functions.add_probes(self._file(path), module.original) for path, module in self._modules.items()}
        coverage, shared = Coverage(), _SharedFixtures(seen)
        items[0].config.pluginmanager.register(shared, "shared-fixtures")
        for item, following in zip(items, [*items[1:], None], strict=True):
            for lines in seen.values():
                lines.clear()
            cpu_start, start = time.process_time(), fair_clock()
            failed = _Judge()
            item.config.pluginmanager.register(failed, "failing")
            item.ihook.pytest_runtest_protocol(item=item, nextitem=following)
            item.config.pluginmanager.unregister(failed)
            if failed.killer:
                coverage.failing.append(item.nodeid)
            coverage.seconds[item.nodeid] = time.process_time() - cpu_start
            coverage.taken[item.nodeid] = fair_clock() - start
            coverage.lines[item.nodeid] = {path: sorted(lines) for path, lines in seen.items() if lines}
            shared.add_to(item, coverage)
        return {"coverage": asdict(coverage)}


def is_doubtful(result: Mapping[str, Any], coverage: Coverage) -> bool:
    """Whether something else than the mutant may be what killed it: it took too long, or the test that failed waits."""
    return result.get(DIED) in _LIMITING or (bool(result.get("by")) and coverage.waits(result["by"]))


def judge(mutant: str, result: Mapping[str, Any]) -> Verdict:
    """Say what the result of a child means."""
    seconds = result[SECONDS]
    if "unreached" in result:
        return Verdict(mutant, "unreached", "", seconds)
    if DIED in result:
        return Verdict(mutant, "timeout" if result[DIED] in _LIMITING else "killed", "", seconds)
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


def try_fresh(
    root: Path, module: Module, mutant: Mutant, tests: Sequence[str], coverage: Coverage, patience: float
) -> dict[str, Any]:
    """In a child that has not imported the module: import the mutant and run tests until one fails."""
    if not tests:
        return {"by": ""}
    judging = _StrictJudge(coverage, patience)
    files = dict.fromkeys(test.partition("::")[0] for test in tests)
    with module.mutated(mutant.id) as tree:
        sys.meta_path.insert(0, _Finder(str(root / mutant.path), tree))
        os.chdir(root)
        code = pytest.main([*OPTIONS, "-x", *files], plugins=[_Profile(), judging, _Selection(tests, coverage.seconds)])
    if code not in (pytest.ExitCode.OK, pytest.ExitCode.NO_TESTS_COLLECTED) and not judging.killer:
        return {"by": "collection of the tests"}
    return {"by": judging.killer}
