"""What the operator must know of the aircraft, as every screen words it; and when the aircraft is out of reach."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Final

from mkdaemon.client import Vehicle
from mkdaemon.client.taskerrors import background
from mkdaemon.reading import Picture, Reading
from mkdaemon.reading.facts import age_words, because
from mkdaemon.telemetry.link import LinkCondition
from mkdaemon.telemetry.state import Flight

KEYS: Final = (
    *("control/status", "control/output", "state/battery", "state/flight", "link/state", "link/health", "health"),
)
SILENCE: Final = 2.5
"""A daemon that is silent for this time is out of reach [s]; it publishes `control/status` once a second."""


class Watcher:
    """The newest values of some keys."""

    def __init__(self) -> None:
        self._loop = asyncio.get_running_loop()
        self._reading = Reading()
        self._began = self._loop.time()

    async def run(self, uav: Vehicle, alarm: Callable[[str], None]) -> None:
        """Follow the bus; call `alarm` when the aircraft gets out of reach."""
        async with uav.watch(*KEYS) as samples:
            for suffix, sample in (await uav.get_all("*/*")).items():
                if suffix in KEYS:
                    self.take(suffix, sample.known, sample.age or 0.0)
            async with background(self.watch_reach(alarm)):
                async for sample in samples:
                    self.take(sample.suffix, sample.known)

    def take(self, suffix: str, value: object, age: float = 0.0) -> None:
        """Take a value.

        Args:
            suffix: its key.
            value: as its key carries it.
            age: since it was published [s].
        """
        self._reading.take(suffix, value, self._loop.time() - age)

    @property
    def picture(self) -> Picture:
        """What is known now."""
        return self._reading.at(self._loop.time())

    @property
    def is_on_ground(self) -> bool | None:
        """Whether the aircraft stands; None without a recent report."""
        flight = self.picture.fresh("state/flight", Flight)
        return None if flight is None or flight.is_flying is None else not flight.is_flying

    @property
    def trouble(self) -> str:
        """Why the aircraft is out of reach; empty where it is not."""
        picture = self.picture
        silence = min(picture.silence, self._loop.time() - self._began)
        if silence > SILENCE:
            return f"the daemon has been silent for {age_words(silence)}"
        link = picture.link()
        if link is None or link.value.condition in {LinkCondition.UP, LinkCondition.DEGRADED}:
            return ""
        return because(f"the link is {link.value.condition}", link.value.reason)

    async def watch_reach(self, alarm: Callable[[str], None]) -> None:
        """Call `alarm` whenever the aircraft gets out of reach, for ever."""
        was = ""
        while True:
            trouble = self.trouble
            if trouble and not was:
                alarm(trouble)
            was = trouble
            await asyncio.sleep(0.1)
