"""What the operator must know of the aircraft: who flies, what is sent, link, battery, each with its age."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Any, Final

from mkdaemon.client import Vehicle

KEYS: Final = ("control/status", "control/output", "state/battery", "state/flight", "link/state", "health")
SILENCE: Final = 2.5
"""A daemon not heard for so long is out of reach [s]; it publishes `control/status` once a second."""
FLIGHT_AGE: Final = 3.0
"""Oldest flight state that counts [s]."""
_LINK_WORKS: Final = frozenset({"up", "degraded"})


class Watcher:
    """The newest values of some keys.

    Attributes:
        values: the newest fields by key.
    """

    def __init__(self) -> None:
        self._loop = asyncio.get_running_loop()
        self.values: dict[str, dict[str, Any]] = {}
        self._at: dict[str, float] = {}
        self._began = self._loop.time()

    async def run(self, uav: Vehicle, alarm: Callable[[str], None]) -> None:
        """Follow the bus; call `alarm` when the aircraft gets out of reach."""
        async with uav.watch(*KEYS) as samples:
            for suffix, sample in (await uav.get_all("*/*")).items():
                if suffix in KEYS and suffix != "control/output":
                    self.take(suffix, sample.fields, sample.age or 0.0)
            following = asyncio.create_task(self.watch_reach(alarm), name="teleop reach")
            try:
                async for sample in samples:
                    self.take(sample.suffix, sample.fields)
            finally:
                following.cancel()

    def take(self, suffix: str, fields: dict[str, Any], age: float = 0.0) -> None:
        """Take a value.

        Args:
            suffix: its key.
            fields: as it came.
            age: since it was published [s].
        """
        self.values[suffix] = fields
        self._at[suffix] = self._loop.time() - age

    def age(self, suffix: str) -> float | None:
        """Time since a value came [s]; None where none did."""
        at = self._at.get(suffix)
        return None if at is None else self._loop.time() - at

    def field(self, suffix: str, name: str) -> Any:
        """One field of a value; None where it is not known."""
        return self.values.get(suffix, {}).get(name)

    @property
    def is_on_ground(self) -> bool | None:
        """Whether the aircraft is known to stand; None where nobody said so lately."""
        age = self.age("state/flight")
        flying = self.field("state/flight", "is_flying")
        return None if age is None or age > FLIGHT_AGE or flying is None else not flying

    @property
    def trouble(self) -> str:
        """Why the aircraft is out of reach; empty where it is not."""
        age = self.age("control/status")
        silence = self._loop.time() - self._began if age is None else age
        if silence > SILENCE:
            return f"the daemon has not been heard for {silence:.1f} s"
        condition = self.field("link/state", "condition")
        if condition is not None and condition not in _LINK_WORKS:
            return f"the link is {condition}: {self.field('link/state', 'reason')}"
        return ""

    async def watch_reach(self, alarm: Callable[[str], None]) -> None:
        """Call `alarm` whenever the aircraft gets out of reach, for ever."""
        was = ""
        while True:
            trouble = self.trouble
            if trouble and not was:
                alarm(trouble)
            was = trouble
            await asyncio.sleep(0.1)
