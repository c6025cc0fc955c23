"""The whole daemon in a thread of this process, for programs that run in the foreground as a user starts them."""

from __future__ import annotations

import asyncio
import logging
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from contextlib import AbstractAsyncContextManager, contextmanager
from typing import Any, TypeVar

import structlog

from lab.rigs.live import LiveDaemon, live_daemon
from lab.rigs.waiting import wait_blocking
from mkdaemon.client import Vehicle

_Value = TypeVar("_Value")


class BackgroundDaemon:
    """A simulator and a daemon that run in a thread of their own.

    Attributes:
        endpoint: where the daemon's bus listens.
    """

    def __init__(self, live: LiveDaemon) -> None:
        self.endpoint = live.endpoint
        self._live = live
        self._simulation = live.runtime.simulation
        self._loop = asyncio.get_running_loop()
        self._stop = asyncio.Event()

    def wait_for_values(self, *suffixes: str) -> None:
        """Return when something was published under each of these keys.

        Raises:
            TimeoutError: it was not.
        """
        wait_blocking(lambda: all(self._live.values(suffix) for suffix in suffixes))

    def wait_for_value(self, suffix: str, claim: Callable[[dict[str, Any]], bool]) -> None:
        """Return when a claim holds of what was published last under a key.

        Raises:
            TimeoutError: it never did.
        """
        wait_blocking(lambda: any(claim(value) for value in self._live.values(suffix)[-1:]))

    def wait_for_phase(self, phase: str) -> None:
        """Return when control is in a phase.

        Raises:
            TimeoutError: it never was.
        """
        self.wait_for_value("control/status", lambda status: bool(status["phase"] == phase))

    @contextmanager
    def other_client(self, work: Callable[[Vehicle], AbstractAsyncContextManager[_Value]]) -> Iterator[_Value]:
        """Another client, which does something as long as the context lasts."""
        entered: Future[_Value] = Future()
        left = asyncio.Event()

        async def run() -> None:
            async with self._live.client() as client, work(client) as value:
                entered.set_result(value)
                await left.wait()

        running = asyncio.run_coroutine_threadsafe(run(), self._loop)
        try:
            yield entered.result()
        finally:
            self._loop.call_soon_threadsafe(left.set)
            running.result()

    def start_pilot(self) -> None:
        """Let the simulated pilot begin."""
        self._loop.call_soon_threadsafe(self._simulation.start_pilot)

    def stop(self) -> None:
        """End both in order."""
        self._loop.call_soon_threadsafe(self._stop.set)

    async def wait_for_stop(self) -> None:
        """Return when they are to end."""
        await self._stop.wait()


@contextmanager
def background_daemon(**sim: Any) -> Iterator[BackgroundDaemon]:
    """A daemon that runs as long as the context lasts, as soon as external control is possible; it logs nothing.

    Args:
        sim: settings of the simulator.

    Raises:
        TimeoutError: external control was not possible in time.
    """
    started: Future[BackgroundDaemon] = Future()

    async def serve() -> None:
        async with live_daemon(**sim) as live:
            daemon = BackgroundDaemon(live)
            started.set_result(daemon)
            await daemon.wait_for_stop()

    def run() -> None:
        try:
            asyncio.run(serve())
        except Exception as error:
            if started.done():
                raise
            started.set_exception(error)

    with _silent_logs():
        thread = threading.Thread(target=run, name="daemon")
        thread.start()
        try:
            daemon = started.result()
            try:
                yield daemon
            finally:
                daemon.stop()
        finally:
            thread.join()


@contextmanager
def _silent_logs() -> Iterator[None]:
    """What the daemon logs is not written between the lines of the program in the foreground."""
    before = structlog.get_config()
    structlog.configure(wrapper_class=structlog.make_filtering_bound_logger(logging.CRITICAL))
    try:
        yield
    finally:
        structlog.configure(**before)
