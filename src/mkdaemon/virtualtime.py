"""An event loop in virtual time: its clock jumps to the next timer, at once or no sooner than the wall clock."""

from __future__ import annotations

import asyncio
import selectors
import time
from collections.abc import Callable, Coroutine
from concurrent.futures import Executor, Future
from typing import Any, ParamSpec, TypeVar

_Result = TypeVar("_Result")
_Parameters = ParamSpec("_Parameters")


class _JumpingSelector(selectors.SelectSelector):
    """Never waits for a file: time passes instead.

    Attributes:
        now: virtual time [s].
        is_woken: another thread asks the loop to look again, at any time.
    """

    def __init__(self, pace: float, start: float) -> None:
        super().__init__()
        self.now = self._start = start
        self.is_woken = False
        self._pace = pace
        self._began = time.monotonic()

    def select(self, timeout: float | None = None) -> list[tuple[selectors.SelectorKey, int]]:
        if timeout is not None and timeout <= 0.0:
            return []  # something is to be done now: files, of which there are none but the loop's own, can wait
        ready = super().select(0) if len(self.get_map()) > 1 else []  # one is the loop's own
        if ready or self.is_woken:
            self.is_woken = False
            return ready
        if timeout is None:
            raise RuntimeError("everything waits, and no timer is set: this would wait for ever")
        self.now += timeout
        if self._pace > 0.0:
            ahead = (self.now - self._start) / self._pace - (time.monotonic() - self._began)
            if ahead > 0.0:
                time.sleep(ahead)
            else:
                self._began -= ahead  # a computer that is too slow makes the flight longer, not different
        return ready


class VirtualLoop(asyncio.SelectorEventLoop):
    """An event loop in virtual time; threads and real I/O have no place in it."""

    def __init__(self, pace: float = 0.0, start: float = 0.0) -> None:
        """Begin.

        Args:
            pace: virtual seconds a second at most; 0 for as fast as it goes.
            start: time of the beginning [s].
        """
        self._jumping = _JumpingSelector(pace, start)
        super().__init__(self._jumping)

    def time(self) -> float:
        """Virtual time [s]."""
        return self._jumping.now

    def _write_to_self(self) -> None:
        """Wake the loop; asyncio writes a byte to a socket for that, and reads it: two calls of the system."""
        self._jumping.is_woken = True

    def let_pass(self, seconds: float) -> None:
        """Let time pass in which nothing of this loop runs, as while a process is stopped or works on something."""
        self._jumping.now += seconds


class AtOnce(Executor):
    """Does everything at once: a thread would take time that virtual time does not know."""

    def submit(
        self, fn: Callable[_Parameters, _Result], /, *args: _Parameters.args, **kwargs: _Parameters.kwargs
    ) -> Future[_Result]:
        """Do it."""
        future: Future[_Result] = Future()
        try:
            future.set_result(fn(*args, **kwargs))
        except OSError as error:
            future.set_exception(error)
        return future


def run_virtually(main: Coroutine[Any, Any, _Result], pace: float = 0.0) -> _Result:
    """Run a coroutine to its end in virtual time; see `VirtualLoop`."""
    loop = VirtualLoop(pace)
    try:
        return loop.run_until_complete(main)
    finally:
        end_loop(loop)


def end_loop(loop: asyncio.AbstractEventLoop) -> None:
    """End what still runs in a loop, which may take its time to leave, and close it."""
    loop.run_until_complete(_end(asyncio.all_tasks(loop)))
    loop.run_until_complete(loop.shutdown_asyncgens())
    loop.close()


async def _end(tasks: set[asyncio.Task[Any]]) -> None:
    for task in tasks:
        task.cancel()
    await asyncio.gather(*tasks, return_exceptions=True)
