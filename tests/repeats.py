"""Tests in real time: each states how long the machine may stand still, and a test is repeated only beyond that.

A test marked `real_time(tolerance=...)` that fails although the machine never stood still longer than it tolerates has
failed. One that was held up longer is repeated once. A test that measures itself how late the machine was raises
`InconclusiveError`: that is neither right nor wrong, and it is repeated once, too. Repeats are counted and printed, and
a run with more than `MOST_REPEATS` fails: whatever shows up that often is a fault of ours.
"""

from __future__ import annotations

import re
import threading
import time
from collections.abc import Generator
from typing import Final, Self

import pluggy
import pytest
from _pytest.runner import runtestprotocol

MOST_REPEATS: Final = 3
"""Repeats a run may have."""
STEP: Final = 0.02
"""Time between two looks at the clock [s]."""
REPEATED: Final = "repeated"
"""Name of the property of a report that says why its test was repeated."""


class InconclusiveError(Exception):
    """What was measured says nothing of the code, because the machine was late; says how late, or at what."""


def require_no_standstill(errors: str) -> None:
    """Pass where a program did not fail because its daemon got no processor.

    Raises:
        InconclusiveError: it says so.
    """
    if stalled := re.search(r"the daemon did not run for [\d.]+ s", errors):
        raise InconclusiveError(stalled[0])


class Standstill:
    """Measures how long this process got no processor, by a thread that wakes at steady times.

    Attributes:
        longest: longest time beyond `STEP` between two looks [s].
    """

    def __init__(self) -> None:
        self.longest = 0.0
        self._done = threading.Event()
        self._thread = threading.Thread(target=self._watch, name="standstill", daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._done.set()
        self._thread.join()

    def _watch(self) -> None:
        before = time.monotonic()
        while not self._done.wait(STEP):
            now = time.monotonic()
            self.longest = max(self.longest, now - before - STEP)
            before = now


class Repeats:
    """The plugin: repeats tests in real time that the machine held up, and keeps account of them.

    Attributes:
        count: tests in real time so far.
        reasons: one for every repeat so far.
    """

    def __init__(self) -> None:
        self.count = 0
        self.reasons: list[str] = []

    @pytest.hookimpl(tryfirst=True)
    def pytest_runtest_protocol(self, item: pytest.Item, nextitem: pytest.Item | None) -> bool | None:
        mark = item.get_closest_marker("real_time")
        if mark is None:
            return None
        item.ihook.pytest_runtest_logstart(nodeid=item.nodeid, location=item.location)
        with Standstill() as still:
            reports = runtestprotocol(item, log=False, nextitem=nextitem)
        tolerance = mark.kwargs["tolerance"]
        reason = ""
        inconclusive = next((report.inconclusive for report in reports if hasattr(report, "inconclusive")), None)
        if inconclusive is not None:
            reason = f"{item.nodeid}: inconclusive: {inconclusive}"
        elif any(report.failed for report in reports) and still.longest > tolerance:
            reason = (
                f"{item.nodeid}: the machine stood still for {1000 * still.longest:.0f} ms, "
                f"{1000 * tolerance:.0f} ms are tolerated"
            )
        if reason:
            item.session._setupstate.teardown_exact(None)  # fixtures that failed are made anew
            item._initrequest()  # type: ignore[attr-defined]
            reports = runtestprotocol(item, log=False, nextitem=nextitem)
        for report in reports:
            if report.when == "call" or report.failed:
                report.user_properties.append((REPEATED, reason))
            item.ihook.pytest_runtest_logreport(report=report)
        item.ihook.pytest_runtest_logfinish(nodeid=item.nodeid, location=item.location)
        return True

    @pytest.hookimpl(hookwrapper=True)
    def pytest_runtest_makereport(
        self, item: pytest.Item, call: pytest.CallInfo[None]
    ) -> Generator[None, pluggy.Result[pytest.TestReport], None]:
        outcome = yield
        if call.excinfo is not None and isinstance(call.excinfo.value, InconclusiveError):
            outcome.get_result().inconclusive = str(call.excinfo.value)

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Also called where the tests run in other processes: properties travel with their report."""
        for reason in [str(value) for name, value in report.user_properties if name == REPEATED]:
            self.count += 1
            self.reasons += [reason] if reason else []

    @pytest.hookimpl(tryfirst=True)
    def pytest_sessionfinish(self, session: pytest.Session) -> None:
        if len(self.reasons) > MOST_REPEATS and session.exitstatus == pytest.ExitCode.OK:
            session.exitstatus = pytest.ExitCode.TESTS_FAILED

    def pytest_terminal_summary(self, terminalreporter: pytest.TerminalReporter) -> None:
        if not self.count:
            return
        terminalreporter.section("tests in real time")
        for reason in self.reasons:
            terminalreporter.line(reason)
        words = f"{len(self.reasons)} of {self.count} repeated; {MOST_REPEATS} may be"
        terminalreporter.line(words, red=len(self.reasons) > MOST_REPEATS)
