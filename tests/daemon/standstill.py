"""A flight shows nothing while the machine lets it stand still: then it is flown again."""

from __future__ import annotations

import asyncio
import functools
import threading
import time
from collections.abc import Awaitable, Callable

import pytest

LOOK = 0.02
"""Time between two looks [s]."""
TOLERATED = 0.03
"""A standstill up to this is no excuse [s]. Two link tests unanswered for 0.1 s each are an outage, a setpoint lives
for 0.3 s, and one standstill seldom comes alone. A mistake that shows in every flight fails all the same."""
ATTEMPTS = 6
"""Flights in all; on a machine so loaded that each one stands still, the last one counts."""


class Standstill:
    """The longest time this process has stood still, as its loop and a thread of its own have seen it.

    Attributes:
        longest: beyond the time between two looks [s].
    """

    def __init__(self) -> None:
        self.longest = 0.0
        self._done = threading.Event()
        self._thread = threading.Thread(target=self._watch, name="standstill", daemon=True)

    async def __aenter__(self) -> Standstill:
        self._thread.start()
        self._task = asyncio.create_task(self._look(), name="standstill")
        return self

    async def __aexit__(self, *_: object) -> None:
        self._task.cancel()
        self._done.set()
        await asyncio.to_thread(self._thread.join)

    def _note(self, began: float) -> None:
        self.longest = max(self.longest, time.monotonic() - began - LOOK)

    async def _look(self) -> None:
        while True:
            began = time.monotonic()
            await asyncio.sleep(LOOK)
            self._note(began)

    def _watch(self) -> None:
        began = time.monotonic()
        while not self._done.wait(LOOK):
            self._note(began)
            began = time.monotonic()


def flown_again(flight: Callable[..., Awaitable[None]]) -> Callable[..., Awaitable[None]]:
    """Repeat a flight that failed, if it was held up by more than control tolerates; any other failure stands."""

    @functools.wraps(flight)
    async def fly(*args: object, **options: object) -> None:
        for left in reversed(range(ATTEMPTS)):
            async with Standstill() as still:
                try:
                    await flight(*args, **options)
                except (Exception, pytest.fail.Exception):
                    if left == 0 or still.longest <= TOLERATED:
                        raise
                else:
                    break

    return fly
