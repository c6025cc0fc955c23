"""What viewers want of a vehicle's keys is subscribed on the bus: each value comes once, and nothing else comes."""

from __future__ import annotations

from collections.abc import Callable, Collection
from contextlib import ExitStack

from mkdaemon.client import Sample, Vehicle
from mkdaemon.gateways.keys import matches


class Feed:
    """The subscriptions of one vehicle."""

    def __init__(self, take: Callable[[Sample], None]) -> None:
        """Subscribe to nothing.

        Args:
            take: called with each sample, on Zenoh's thread.
        """
        self._take = take
        self._client: Vehicle | None = None
        self._subscribed: dict[str, ExitStack] = {}

    def follow(self, client: Vehicle) -> None:
        """Go on with another client of the vehicle."""
        wanted = set(self._subscribed)
        self.want(())
        self._client = client
        self.want(wanted)

    def want(self, patterns: Collection[str]) -> None:
        """Be subscribed to these patterns and no others; they wait until a daemon speaks for the vehicle."""
        widest = {one for one in patterns if not any(other != one and matches(other, one) for other in patterns)}
        for pattern in widest - self._subscribed.keys():  # before others end: no value falls between two subscriptions
            self._subscribed[pattern] = ExitStack()
            if self._client is not None:
                self._subscribed[pattern].enter_context(self._client.each(pattern, self._take))
        for pattern in self._subscribed.keys() - widest:
            self._subscribed.pop(pattern).close()
