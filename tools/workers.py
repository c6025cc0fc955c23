"""Tests in several processes: a plugin of pytest (`python -m pytest -p tools.workers --workers 3`).

One process collects the tests and forks the workers, each of which takes the tests of one file after another. Workers
that collect for themselves import and rewrite everything three times: half a minute of computing more.

What is marked `alone` runs when everything else has ended.
"""

from __future__ import annotations

import os
import signal
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from itertools import groupby
from multiprocessing import Pipe
from multiprocessing.connection import Connection, wait
from types import SimpleNamespace
from typing import Any, Final, NoReturn

import pytest

ALONE: Final = "alone"
"""Mark of tests that need the machine for themselves."""


class Hooks:
    """Hooks by which other plugins bring home what they found in a worker."""

    @pytest.hookspec(firstresult=True)
    def pytest_worker_result(self) -> object:
        """Return what this worker found; asked in the worker, at its end."""

    def pytest_worker_ended(self, result: Any) -> None:
        """Take what a worker found; called in the process that forked it."""


class _Reporter:
    """Plugin of a worker: sends what became of its tests."""

    def __init__(self, pipe: Connection, config: pytest.Config) -> None:
        self._pipe = pipe
        self._config = config

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        self._pipe.send(self._config.hook.pytest_report_to_serializable(config=self._config, report=report))


class _Worker:
    """A forked process, as the one sees it that forked it.

    Attributes:
        pipe: to it.
        process: its id.
        left: tests that it has and has not begun, by their places in the session.
        current: the test that it has begun; None before the first.
        is_done: it has said its last word.
        node: how pytest's own reporter tells which worker a report comes from.
    """

    def __init__(self, name: str, process: int, pipe: Connection) -> None:
        self.process = process
        self.pipe = pipe
        self.left: deque[int] = deque()
        self.current: int | None = None
        self.is_done = False
        self.node = SimpleNamespace(gateway=SimpleNamespace(id=name), _workerinfocache=f"[{name}]")


class Workers:
    """The plugin.

    Args:
        count: of the workers.
    """

    def __init__(self, count: int) -> None:
        self._count = count
        self._forked = 0

    @pytest.hookimpl(tryfirst=True)
    def pytest_runtestloop(self, session: pytest.Session) -> bool | None:
        """Run the tests in workers, unless something is wrong with them already."""
        if session.testsfailed or session.config.option.collectonly:
            return None
        for is_alone, count in ((False, self._count), (True, 1)):
            batches = deque(_batches(session.items, is_alone=is_alone))
            if batches:
                self._run(session, batches, count)
        return True

    def _run(self, session: pytest.Session, batches: deque[list[int]], count: int) -> None:
        """Let workers take all batches.

        Raises:
            pytest.Session.Failed: so many tests have failed that the run is to end.
        """
        workers = [self._fork(session) for _ in range(min(count, len(batches)))]
        try:
            while workers:
                for pipe in wait([worker.pipe for worker in workers]):
                    worker = next(one for one in workers if one.pipe is pipe)
                    try:
                        self._take(session, worker, worker.pipe.recv(), batches)
                    except (EOFError, ConnectionError):
                        workers.remove(worker)
                        if self._bury(session, worker, batches):
                            workers.append(self._fork(session))
                if session.shouldfail:
                    raise session.Failed(session.shouldfail)
        finally:
            for worker in workers:
                with suppress(ProcessLookupError):
                    os.kill(worker.process, signal.SIGKILL)
                os.waitpid(worker.process, 0)

    def _take(self, session: pytest.Session, worker: _Worker, word: Any, batches: deque[list[int]]) -> None:
        """Take a word of a worker: it wants tests, begins one, reports, or is at its end."""
        config = session.config
        match word:
            case None:
                batch = batches.popleft() if batches else []
                worker.left.extend(batch)
                worker.pipe.send(batch)
            case int():
                worker.current = worker.left.popleft()
            case {"$report_type": _}:
                report = config.hook.pytest_report_from_serializable(config=config, data=word)
                report.node = worker.node
                config.hook.pytest_runtest_logreport(report=report)
            case (result,):
                worker.is_done = True
                config.hook.pytest_worker_ended(result=result)

    def _bury(self, session: pytest.Session, worker: _Worker, batches: deque[list[int]]) -> bool:
        """Take note of a worker that has ended; returns whether another is needed for what it left.

        Raises:
            RuntimeError: it ended before its first test.
        """
        _, status = os.waitpid(worker.process, 0)
        if worker.is_done:
            return False
        words = f"its worker ended: {os.waitstatus_to_exitcode(status)}"
        if worker.current is None:
            raise RuntimeError(words)
        item = session.items[worker.current]
        report = pytest.TestReport(item.nodeid, item.location, {}, "failed", words, "call")
        report.node = worker.node  # type: ignore[attr-defined]
        session.config.hook.pytest_runtest_logreport(report=report)
        if worker.left:
            batches.appendleft(list(worker.left))
        return bool(batches)

    def _fork(self, session: pytest.Session) -> _Worker:
        here, there = Pipe()
        self._forked += 1
        process = os.fork()
        if process == 0:
            here.close()
            _end_with(lambda: _work(session, there))
        there.close()
        return _Worker(f"worker {self._forked}", process, here)


def _batches(items: Sequence[pytest.Item], *, is_alone: bool) -> Iterator[list[int]]:
    """Places of tests, those of one file together, in their order."""
    chosen = (place for place, item in enumerate(items) if (item.get_closest_marker(ALONE) is not None) is is_alone)
    return (list(places) for _, places in groupby(chosen, key=lambda place: items[place].path))


def _end_with(work: Callable[[], None]) -> NoReturn:
    """Do what is left for this process to do, and end it: what its parent has open is not its own to close."""
    code = 1
    try:
        work()
        code = 0
    finally:
        os._exit(code)


def _work(session: pytest.Session, pipe: Connection) -> None:
    """Run the tests that this process is told to."""
    config = session.config
    plugins = config.pluginmanager
    plugins.unregister(name="terminalreporter")
    if (capture := plugins.getplugin("capturemanager")) is not None:
        capture.stop_global_capturing()  # its file belongs to all
        capture.start_global_capturing()
    plugins.register(_Reporter(pipe, config))
    places = _asked(pipe)
    place = next(places, None)
    while place is not None:
        following = next(places, None)  # fixtures that it uses, too, are not torn down
        pipe.send(place)
        item, next_item = session.items[place], None if following is None else session.items[following]
        config.hook.pytest_runtest_protocol(item=item, nextitem=next_item)
        place = following
    pipe.send((config.hook.pytest_worker_result(),))


def _asked(pipe: Connection) -> Iterator[int]:
    """The tests that this process gets, one file after another."""
    while True:
        pipe.send(None)
        if not (batch := pipe.recv()):
            return
        yield from batch


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add `--workers`."""
    parser.addoption("--workers", type=int, default=0, help="processes that run the tests; 0: this one")


def pytest_addhooks(pluginmanager: pytest.PytestPluginManager) -> None:
    """Make the hooks known."""
    pluginmanager.add_hookspecs(Hooks)


def pytest_configure(config: pytest.Config) -> None:
    """Fork workers where it is asked for."""
    if count := config.getoption("workers"):
        config.pluginmanager.register(Workers(count), "forked-workers")
