"""What viewers want of a vehicle's keys is subscribed on the bus: each value comes once, and nothing else comes."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Collection
from typing import Final

from mkdaemon.client import Sample, Vehicle
from mkdaemon.gateways.keys import matches

BACKLOG: Final = 512
"""Values of a pattern that may wait while this program is busy; then the oldest is dropped."""
IMAGES: Final = 8
"""Likewise, of images."""


class Feed:
    """The subscriptions of one vehicle."""

    def __init__(self, take: Callable[[Sample], None]) -> None:
        """Subscribe to nothing.

        Args:
            take: called on the loop with each sample.
        """
        self._take = take
        self._client: Vehicle | None = None
        self._tasks: dict[str, asyncio.Task[None]] = {}
        self._ended: set[asyncio.Task[None]] = set()

    def follow(self, client: Vehicle) -> None:
        """Go on with another client of the vehicle."""
        wanted = set(self._tasks)
        self.want(())
        self._client = client
        self.want(wanted)

    def want(self, patterns: Collection[str]) -> None:
        """Be subscribed to these patterns and no others; they wait until a daemon speaks for the vehicle."""
        widest = {one for one in patterns if not any(other != one and matches(other, one) for other in patterns)}
        for pattern in widest - self._tasks.keys():  # before others end: no value falls between two subscriptions
            self._tasks[pattern] = asyncio.create_task(self._read(pattern), name=f"feed {pattern}")
        for pattern in self._tasks.keys() - widest:
            task = self._tasks.pop(pattern)
            task.cancel()
            self._ended.add(task)
            task.add_done_callback(self._ended.discard)

    async def close(self) -> None:
        """End every subscription."""
        self.want(())
        await asyncio.gather(*self._ended, return_exceptions=True)

    async def _read(self, pattern: str) -> None:
        if self._client is None:
            return
        backlog = IMAGES if pattern.endswith("/image") else BACKLOG
        async with self._client.watch(pattern, backlog=backlog, are_known=True) as samples:
            async for sample in samples:
                self._take(sample)
