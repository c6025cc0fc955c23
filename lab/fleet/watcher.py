"""The fleet view on the ground: when it says what of each vehicle, and when values come."""

from __future__ import annotations

import asyncio
import time
from collections import defaultdict
from typing import Final

from mkdaemon.client import Vehicle
from mkdaemon.client.fleet import Fleet
from mkdaemon.view.top.fleetboard import KEYS, FleetBoard

NAMES: Final = ("mk1", "mk2", "mk3")
WATCHED: Final = "state/battery"
"""The key whose gaps are looked at: it comes with every set of the NaviCtrl's data."""
LOOK: Final = 0.02
"""Between two looks at the fleet view [s]."""


class Watcher:
    """Looks at the fleet view for as long as it runs.

    Attributes:
        times: when a value of `WATCHED` came from a vehicle [s; monotonic].
        heard: when anything came from it.
        said: every change of what the view says of a vehicle, as (time, state).
    """

    def __init__(self, client: Vehicle) -> None:
        self._board = FleetBoard()
        self.times: defaultdict[str, list[float]] = defaultdict(list)
        self.heard: defaultdict[str, list[float]] = defaultdict(list)
        self.said: defaultdict[str, list[tuple[float, str]]] = defaultdict(list)
        self._fleet = Fleet(client)

    async def run(self) -> None:
        """Watch, for ever."""
        async with asyncio.TaskGroup() as tasks:
            tasks.create_task(self._take(), name="values")
            tasks.create_task(self._look(), name="looks")

    async def _take(self) -> None:
        def changed() -> None:
            self._board.look(self._fleet.vehicles, time.monotonic())

        async with self._fleet.watch(changed, lambda *_: None), self._fleet.values(*KEYS) as samples:
            async for sample in samples:
                name, _, suffix = sample.suffix.partition("/")
                now = time.monotonic()
                self._board.take(name, suffix, sample.known, now)
                self.heard[name].append(now)
                if suffix == WATCHED:
                    self.times[name].append(now)

    async def _look(self) -> None:
        while True:
            now = time.monotonic()
            for name in NAMES:
                state, said = self._board.state(name, now), self.said[name]
                if not said or said[-1][1] != state:
                    said.append((now, state))
            await asyncio.sleep(LOOK)

    def state(self, name: str) -> str:
        """What it says of a vehicle now."""
        return self.said[name][-1][1] if self.said[name] else "unknown"

    def first(self, name: str, state: str, since: float) -> float | None:
        """How long after a time it first said so [s]; None for never."""
        return next((at - since for at, said in self.said[name] if at >= since and said == state), None)

    def between(self, name: str, begin: float, end: float) -> set[str]:
        """Everything it said of a vehicle in some time."""
        before = [said for at, said in self.said[name] if at < begin]
        return {*before[-1:], *(said for at, said in self.said[name] if begin <= at < end)}
