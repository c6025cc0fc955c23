"""The holder of the lease floods, and is killed or falls silent: how long its sticks are flown after its last put.

Judged on the wire: by what the simulated FlightCtrl holds, and when the boards heard it.
"""

from __future__ import annotations

import asyncio
import math
import mmap
import signal
import time
from typing import Final

from lab.attack.floods import LADDER_LIMIT, NEUTRAL_LIMIT, daemon_on_tcp
from lab.attack.holder import NOTE
from lab.campaign import Row
from lab.rigs.processes import VEHICLE, ObservedSimulation, Program, Sticks
from lab.rigs.waiting import wait_until

RATES: Final = (1000.0, 3000.0, 5000.0, math.inf)
"""Of the floods [Hz]; without end: all that go."""
ENDS: Final = ("killed", "silent")
SECONDS: Final = 3.0
"""How long it floods [s]."""
STEP: Final = 0.002
"""Between two looks at the boards [s]."""
BEGINNING: Final = 60.0
"""Longest wait until the flood begins [s]."""


async def flood_and_end(rate: float, end: str, seed: int) -> Row:
    """Fly one flight.

    Returns:
        `rate` that the holder reached [1/s], None where it was killed; `neutral` and `released`, from its last put
        until no tilted sticks were held, and until nothing was [s], negative where that was before it; `is_wrong`.

    Raises:
        TimeoutError: the flight did not begin, or the aircraft was never released.
    """
    async with daemon_on_tcp(seed, keeps=False) as attacked:
        notes_path = attacked.folder / "notes"
        notes_path.write_bytes(NOTE.pack(0.0, 0.0))
        endpoint = attacked.daemon.endpoint
        words = ("-m", "lab.attack.holder", endpoint, VEHICLE, str(rate), str(SECONDS), str(notes_path), end)
        holder = await Program.start(*words)
        try:
            with notes_path.open("r+b") as opened, mmap.mmap(opened.fileno(), NOTE.size) as notes:
                neutral, released = await _ended(attacked.simulation, notes)
            reached = await holder.first_line()
        finally:
            await holder.end(signal.SIGKILL)
    is_wrong = neutral > NEUTRAL_LIMIT or released > LADDER_LIMIT
    rate_reached = float(reached) if reached else None
    return {"rate": rate_reached, "neutral": neutral, "released": released, "is_wrong": is_wrong}


async def _ended(simulation: ObservedSimulation, notes: mmap.mmap) -> tuple[float, float]:
    """When the sticks were level, and when nothing was held, from the last put on [s]."""

    def began() -> float:
        return float(NOTE.unpack(notes[:])[1])

    await wait_until(lambda: began() > 0.0, BEGINNING)
    tilted = held = time.monotonic()
    end = began() + SECONDS
    while held > time.monotonic() - 1.5 or time.monotonic() < end + 1.0:
        now, sticks = time.monotonic(), simulation.sticks
        tilted = now if sticks is Sticks.STEERED else tilted
        held = now if sticks is not Sticks.NOTHING else held
        if now > end + BEGINNING:
            raise TimeoutError("the aircraft was never released")
        await asyncio.sleep(STEP)
    last = float(NOTE.unpack(notes[:])[0])
    return round(tilted - last, 3), round(held - last, 3)
