"""Running releases of the aircraft, and the tasks that wait for their end."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable
from contextlib import suppress
from typing import Final

from mkdaemon.clock import Clock
from mkdaemon.control.events import Released
from mkdaemon.control.modes import IN_FLIGHT
from mkdaemon.daemon.deck import Deck
from mkdaemon.link.link import Link
from mkdaemon.link.session.traffic import ReleaseResult
from mkdaemon.telemetry.control import ReleaseOutcome

LATE_RELEASE: Final = 600.0
"""How long a release that was not confirmed is watched for its confirmation [s]."""
LATE_LOOK: Final = 0.2
"""Time between two looks for it [s]."""
RELEASE_TIMEOUT: Final = 5.0
"""A release that takes longer than this counts as not confirmed [s]; the link needs 1.5 s at most."""


class Releases:
    """Runs releases, and reports their outcome to the flight core and to waiting tasks."""

    def __init__(self, deck: Deck, link: Link, clock: Clock) -> None:
        self._deck, self._link, self._clock = deck, link, clock
        self._waiters: list[asyncio.Future[ReleaseResult | None]] = []

    def next_end(self) -> asyncio.Future[ReleaseResult | None]:
        """Outcome of the next release; None if it does not end within `RELEASE_TIMEOUT`."""
        end: asyncio.Future[ReleaseResult | None] = asyncio.get_running_loop().create_future()
        self._waiters.append(end)
        return end

    def begin(self, reason: str, tasks: asyncio.TaskGroup) -> None:
        """Have the line release the aircraft, and wait for the end in a separate task."""
        release = self._link.release(reason)
        tasks.create_task(self._follow(reason, release), name="control.release")

    async def _follow(self, reason: str, release: Awaitable[ReleaseResult]) -> None:
        """Wait for the end of a release, then report it to the core and to the waiting clients."""
        began = self._clock.now()
        result: ReleaseResult | None = None
        with suppress(TimeoutError):
            async with asyncio.timeout(RELEASE_TIMEOUT):
                result = await release
        self._deck.feed(Released(None if result is None else result.status), self._clock.now())
        waiters, self._waiters = self._waiters, []
        for waiter in waiters:
            if not waiter.done():
                waiter.set_result(result)
        if result is None or result.status in {ReleaseOutcome.UNCONFIRMED, ReleaseOutcome.NOT_SENT}:
            await self._report_late_release(reason, began)

    async def _report_late_release(self, reason: str, began: float) -> None:
        """Correct the report of an unconfirmed release once it is confirmed; a new flight ends the wait."""
        with suppress(TimeoutError):
            async with asyncio.timeout(LATE_RELEASE):
                while self._deck.core.phase not in IN_FLIGHT:
                    if self._link.released_at > began:
                        self._deck.audit.failsafe("late release", f"{reason}; it is confirmed by now", released=True)
                        return
                    await asyncio.sleep(LATE_LOOK)
