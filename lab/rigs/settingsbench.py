"""A simulated FlightCtrl whose five parameter sets differ, and what it holds of them."""

from __future__ import annotations

import random
import tempfile
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Final, NamedTuple

from lab.rigs.boardport import ADAPTER_TIME
from lab.rigs.flown import observed
from mkdaemon.client import Vehicle
from mkdaemon.telemetry.settings import StoredSet
from mksim.runtime import Runtime

RESTORED: Final = (1, 4)
"""Sets that a restore changes; the active one is another."""


class Contents(NamedTuple):
    """What a FlightCtrl holds.

    Attributes:
        live: bytes of the live set.
        active: number of the active set.
        sets: bytes of the stored sets.
    """

    live: bytes
    active: int
    sets: dict[int, bytes]


class Bench:
    """A simulated FlightCtrl whose five sets differ, and the daemon on it."""

    def __init__(self, seed: int, folder: Path) -> None:
        self.simulation = observed(seed)
        self.runtime = Runtime(self.simulation, tick=ADAPTER_TIME)
        self.port = f"pty:{self.runtime.port}"
        self.folder = folder
        self._rng = random.Random(f"{seed} sets")
        flight = self.simulation.flight
        for slot, raw in list(flight.eeprom.sets.items()):
            flight.eeprom.sets[slot] = raw[:50] + bytes((slot,)) + raw[51:]
        flight.load(flight.eeprom.active)

    def new_sets(self) -> dict[int, bytes]:
        """Other bytes for the sets to be restored, within what a FlightCtrl stores as it is."""
        sets = self.simulation.flight.eeprom.sets
        return {slot: sets[slot][:51] + self._rng.randbytes(3) + sets[slot][54:] for slot in RESTORED}

    def contents(self) -> Contents:
        """What the FlightCtrl holds now."""
        flight = self.simulation.flight
        return Contents(flight.live.raw, flight.eeprom.active, dict(flight.eeprom.sets))

    async def ask(self, uav: Vehicle, verb: str, wanted: dict[int, bytes]) -> None:
        """Ask for the procedure and wait for its end."""
        if verb == "backup":
            await uav.settings.backup()
        else:
            sets = [StoredSet(slot=slot, raw=raw) for slot, raw in wanted.items()]
            await uav.settings.restore(sets, confirm=True)


@asynccontextmanager
async def open_bench(seed: int) -> AsyncIterator[Bench]:
    """Run a simulated FlightCtrl while the context lasts."""
    with tempfile.TemporaryDirectory() as name:
        bench = Bench(seed, Path(name))
        async with bench.runtime.serve():
            yield bench
