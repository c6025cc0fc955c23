"""The holder of the lease floods, and is killed or falls silent: how long its sticks are flown after its last put.

Judged on the wire: by what the simulated FlightCtrl holds, and when the boards heard it.
"""

from __future__ import annotations

import asyncio
import mmap
import os
import signal
import sys
import time
from contextlib import suppress
from dataclasses import dataclass
from typing import Final

from lab.attack.floods import LADDER_LIMIT, NEUTRAL_LIMIT
from lab.attack.flown import daemon_on_tcp
from lab.attack.holder import NOTE
from lab.rigs.processes import VEHICLE, ObservedSimulation, Sticks
from lab.rigs.waiting import wait_until

RATES: Final = (1000.0, 3000.0, 5000.0, 0.0)
"""Of the floods [Hz]; 0 for all that go."""
ENDS: Final = ("killed", "silent")
SECONDS: Final = 3.0
"""How long it floods [s]."""
STEP: Final = 0.002
"""Between two looks at the boards [s]."""
BEGINNING: Final = 60.0
"""Longest wait until the flood begins [s]."""


@dataclass(frozen=True, slots=True)
class Backlog:
    """One flight.

    Attributes:
        rate: that the holder reached [1/s]; None where it was killed.
        neutral: from its last put until no tilted sticks were held [s]; negative where they were gone before.
        released: from its last put until nothing was held [s]; negative where that was before.
        lost_before: the aircraft was released while the holder still flooded: its setpoints came too late.
        load: of the machine, over one minute.
    """

    rate: float | None
    neutral: float
    released: float
    lost_before: bool
    load: float

    @property
    def is_wrong(self) -> bool:
        """Whether it breaks a limit."""
        return self.neutral > NEUTRAL_LIMIT or self.released > LADDER_LIMIT


async def flood_and_end(rate: float, end: str, seed: int) -> Backlog:
    """Fly one flight.

    Raises:
        TimeoutError: the flight did not begin, or the aircraft was never released.
    """
    async with daemon_on_tcp(seed, keeps=False) as attacked:
        notes_path = attacked.folder / "notes"
        notes_path.write_bytes(NOTE.pack(0.0, 0.0))
        endpoint = attacked.daemon.endpoint
        words = ("-m", "lab.attack.holder", endpoint, VEHICLE, str(rate), str(SECONDS), str(notes_path), end)
        holder = await asyncio.create_subprocess_exec(sys.executable, *words, stdout=asyncio.subprocess.PIPE)
        try:
            with notes_path.open("r+b") as opened, mmap.mmap(opened.fileno(), NOTE.size) as notes:
                return await _judge(attacked.simulation, notes, holder)
        finally:
            with suppress(ProcessLookupError):
                holder.send_signal(signal.SIGKILL)
            await holder.wait()


async def _judge(simulation: ObservedSimulation, notes: mmap.mmap, holder: asyncio.subprocess.Process) -> Backlog:
    def began() -> float:
        return float(NOTE.unpack(notes[:])[1])

    await wait_until(lambda: began() > 0.0, BEGINNING)
    tilted = held = time.monotonic()
    end = began() + SECONDS
    while held > time.monotonic() - 1.5 or time.monotonic() < end + 1.0:
        now = time.monotonic()
        if simulation.sticks is Sticks.STEERED:
            tilted = now
        if simulation.sticks is not Sticks.NOTHING:
            held = now
        if now > end + BEGINNING:
            raise TimeoutError("the aircraft was never released")
        await asyncio.sleep(STEP)
    last = float(NOTE.unpack(notes[:])[0])
    rate = None
    if holder.returncode is None and holder.stdout is not None:
        rate = float((await holder.stdout.readline()).decode() or "nan")
    load = round(os.getloadavg()[0], 1)
    return Backlog(rate, round(tilted - last, 3), round(held - last, 3), held < last, load)
