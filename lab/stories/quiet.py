"""The guard writes nothing in a flight that does not need it, whatever the line does: hours of it in virtual time."""

from __future__ import annotations

import asyncio
import math
import random
from typing import Final

from lab.campaign import Row
from lab.cases import judged
from lab.rigs.boardport import ADAPTER_TIME, LineFault
from lab.rigs.cockpit import Boards, Cockpit, cockpit
from lab.rigs.virtualguard import VirtualGuard
from lab.rigs.waiting import in_virtual_time, running
from lab.stories.standstills import Streamer
from mkdaemon.telemetry.control import Phase

FLIGHT: Final = 600.0
"""Length of one flight [s; virtual]."""
NEEDS_GUARD: Final = frozenset(
    {LineFault.STUCK_WRITER, LineFault.DEVICE_FULL, LineFault.UNPLUGGED, LineFault.GONE_DURING_WRITE}
)
"""Faults in which no stick frame can be written: there the guard has to act, or has no port."""
HARMED: Final = 0.04
"""Share of the bytes that a fault spoils."""


@in_virtual_time
async def fly_quietly(boards: Boards, seed: int) -> Row:
    """Fly with one fault of the line after the other.

    Returns:
        `hours` under control [h; virtual]; `faults` of the line; `leases` taken, a fault that ends one is followed by
        another; `written`, how often the guard wrote anything.
    """
    rng, guard, loop = random.Random(f"{seed} quiet"), VirtualGuard(), asyncio.get_running_loop()
    tally: Row = {"hours": 0.0, "faults": 0, "leases": 0}
    kinds = [fault for fault in LineFault if fault not in {LineFault.NONE, *NEEDS_GUARD}]
    async with cockpit(boards, seed, guard=guard, tick=ADAPTER_TIME) as flown, running(_pilot(flown, tally)):
        end = loop.time() + FLIGHT
        while loop.time() < end:
            await asyncio.sleep(rng.uniform(5.0, 25.0))
            port = flown.socket.port
            if port is None or port.is_closed:
                continue
            port.inject(rng.choice(kinds), HARMED)
            tally["faults"] += 1
            await asyncio.sleep(rng.uniform(0.1, 2.5))
            if not port.is_closed:
                port.inject(LineFault.NONE)
        guard.stop()
    return judged({"written": 0}, **tally, written=len(guard.written))


async def _pilot(flown: Cockpit, tally: Row) -> None:
    """Fly by sticks for ever, with a new lease wherever the last one ended."""
    loop = asyncio.get_running_loop()
    while True:
        async with running(Streamer(flown, "pilot").fly()):
            await flown.until(lambda: flown.flight.phase is Phase.FLYING, math.inf)
            tally["leases"] += 1
            while flown.flight.phase is not Phase.FREE:
                before = loop.time()
                await asyncio.sleep(0.02)
                tally["hours"] += (loop.time() - before) / 3600.0
