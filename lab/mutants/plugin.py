"""Plugin of pytest for mutants: it measures which lines each test runs, or runs the tests that were chosen.

The file that `PLAN` names says what is wanted (`Plan`); what was found is written in its place. Nothing of the product
is imported here: a mutant may break it.
"""

from __future__ import annotations

import json
import os
import sys
import threading
import time
from collections.abc import Generator, Mapping
from pathlib import Path
from types import FrameType
from typing import Any, Final, TypedDict

import pytest
from hypothesis import Phase, settings

PLAN: Final = "MUTANTS_PLAN"
"""Variable of the environment with the path of the file."""


class Measured(TypedDict):
    """What a test does without a mutant.

    Attributes:
        seconds: its computing time.
        taken: how long it took, less the time it waited for a processor [s].
        lines: that it ran of each file, by the path from the root.
        fails: it fails; it judges no mutant.
    """

    seconds: float
    taken: float
    lines: dict[str, list[int]]
    fails: bool


class Plan(TypedDict, total=False):
    """What is wanted, and what was found.

    Attributes:
        files: whose lines are noted, by their absolute paths; without them the chosen tests are run.
        tests: chosen, in this order.
        known: all that were measured; one that is not among them is new, by the mutant, and is run as well.
        measured: what was found of each test.
        killer: test that failed; empty for none.
    """

    files: dict[str, str]
    tests: list[str]
    known: list[str]
    measured: dict[str, Measured]
    killer: str


def fair_clock() -> float:
    """Time [s], less what this process waited for a processor: a loaded machine is slow, not wrong."""
    _, waited_ns, _ = Path("/proc/self/schedstat").read_text(encoding="ascii").split()
    return time.monotonic() - int(waited_ns) * 1e-9


class _Lines:
    """Notes which lines of some files run, in every thread."""

    def __init__(self, files: Mapping[str, str]) -> None:
        self._seen: dict[str, set[int]] = {file: set() for file in files}
        self._names = files
        threading.settrace(self._called)
        sys.settrace(self._called)

    def _called(self, frame: FrameType, event: str, _: object) -> Any:
        return self._ran if frame.f_code.co_filename in self._seen else None

    def _ran(self, frame: FrameType, event: str, _: object) -> Any:
        self._seen[frame.f_code.co_filename].add(frame.f_lineno)
        return self._ran

    def take(self) -> dict[str, set[int]]:
        """The lines that ran since the last call, by the names of the files."""
        found = {self._names[file]: lines for file, lines in self._seen.items() if lines}
        self._seen.update((file, set()) for file in self._seen)
        return found


class _Measurement:
    """Measures every test.

    A fixture that is made once for many tests counts for each of them: a mutant is judged in a process of its own,
    where whichever test comes first makes it.
    """

    def __init__(self, plan: Plan) -> None:
        self._lines = _Lines(plan["files"])
        self._measured = plan["measured"] = {}
        self._shared: list[tuple[str, str, dict[str, set[int]]]] = []
        self._own: list[dict[str, set[int]]] = []
        self._items: list[pytest.Item] = []

    @pytest.hookimpl(wrapper=True)
    def pytest_fixture_setup(self, fixturedef: pytest.FixtureDef[Any]) -> Generator[None, object, object]:
        if fixturedef.scope == "function":
            return (yield)
        self._own.append(self._lines.take())
        try:
            return (yield)
        finally:
            self._shared.append((fixturedef.argname, fixturedef.baseid, self._lines.take()))

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Generator[None, object, object]:
        self._lines.take()
        self._own.clear()
        self._items.append(item)
        self._measured[item.nodeid] = found = Measured(seconds=0.0, taken=0.0, lines={}, fails=False)
        seconds, taken = time.process_time(), fair_clock()
        try:
            return (yield)
        finally:
            found["seconds"], found["taken"] = time.process_time() - seconds, fair_clock() - taken
            self._add(found, *self._own, self._lines.take())

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        if report.failed:
            self._measured[report.nodeid]["fails"] = True

    def pytest_sessionfinish(self) -> None:
        for item in self._items:
            used = getattr(item, "fixturenames", ())
            made = [lines for name, place, lines in self._shared if name in used and item.nodeid.startswith(place)]
            self._add(self._measured[item.nodeid], *made)

    @staticmethod
    def _add(found: Measured, *lines: Mapping[str, set[int]]) -> None:
        for each in lines:
            for path, numbers in each.items():
                found["lines"][path] = sorted(numbers.union(found["lines"].get(path, ())))


class _Choice:
    """Runs the chosen tests, in their order, and keeps the first that fails."""

    def __init__(self, plan: Plan) -> None:
        self._plan = plan

    @pytest.hookimpl(trylast=True)
    def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> None:
        by_id, known = {item.nodeid: item for item in items}, frozenset(self._plan["known"])
        new = [item for item in items if item.nodeid not in known]
        items[:] = [by_id[test] for test in self._plan["tests"] if test in by_id] + new

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        if report.failed:
            self._plan["killer"] = self._plan.get("killer") or report.nodeid


def pytest_configure(config: pytest.Config) -> None:
    """Do what the plan says; an example of Hypothesis that fails is enough: nobody reads the smallest one."""
    phases = (Phase.explicit, Phase.generate)
    settings.register_profile("mutants", parent=settings.default, phases=phases, database=None)
    settings.load_profile("mutants")
    plan: Plan = json.loads(Path(os.environ[PLAN]).read_text(encoding="utf-8"))
    config.pluginmanager.register(_Measurement(plan) if "files" in plan else _Choice(plan), "mutants-work")
    config.add_cleanup(lambda: _write(plan))


def _write(plan: Plan) -> None:
    Path(os.environ[PLAN]).write_text(json.dumps(plan), encoding="utf-8")
