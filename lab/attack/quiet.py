"""The guard says nothing in a flight that does not need it, whatever the line does: hours of it in virtual time."""

from __future__ import annotations

import asyncio
import math
import random
from contextlib import suppress
from typing import Final

from lab.campaign import Row
from lab.rigs.boardport import ADAPTER_TIME, LineFault
from lab.rigs.cockpit import Boards, Cockpit, cockpit
from lab.rigs.virtualguard import VirtualGuard
from lab.stories.faults import FAULTS, HARMED
from mkdaemon.bus.codec import encode_map
from mkdaemon.errors import CommandRejectedError
from mkdaemon.telemetry.control import Phase
from mkdaemon.virtualtime import run_virtually

FLIGHT: Final = 600.0
"""Length of one flight [s; virtual]."""
STICK_HZ: Final = 50.0
NEEDS_GUARD: Final = frozenset(
    {LineFault.STUCK_WRITER, LineFault.DEVICE_FULL, LineFault.UNPLUGGED, LineFault.GONE_DURING_WRITE}
)
"""Faults in which no stick frame can be written: there the guard has to act, or has no port."""


def fly_quietly(boards: Boards, seed: int) -> Row:
    """Fly once.

    Returns:
        `hours` under control [h; virtual]; `faults` of the line that were played; `leases` taken, a fault that ends one
        is followed by another; `written`, when the guard wrote anything [s from the begin]; `is_wrong`: it did.
    """
    return run_virtually(_fly(boards, seed))


async def _fly(boards: Boards, seed: int) -> Row:
    rng = random.Random(f"{seed} quiet")
    guard = VirtualGuard()
    tally: Row = {"hours": 0.0, "faults": 0, "leases": 0}
    kinds = [fault for fault in FAULTS if fault not in NEEDS_GUARD]
    loop = asyncio.get_running_loop()
    async with cockpit(boards, seed, guard=guard, tick=ADAPTER_TIME) as flown:
        began = loop.time()
        pilot = asyncio.create_task(_pilot(flown, rng, tally), name="pilot")
        while loop.time() - began < FLIGHT:
            await asyncio.sleep(rng.uniform(5.0, 25.0))
            fault, port = rng.choice(kinds), flown.socket.port
            if port is None or port.is_closed:
                continue
            port.inject(fault, HARMED.get(fault, 0.0))
            tally["faults"] += 1
            await asyncio.sleep(rng.uniform(0.1, 2.5))
            if not port.is_closed:
                port.inject(LineFault.NONE)
        pilot.cancel()
        guard.stop()
        written = [round(at - began, 3) for at, _ in guard.written]
        return tally | {"written": written, "is_wrong": bool(written)}


async def _pilot(flown: Cockpit, rng: random.Random, tally: Row) -> None:
    """Stream sticks for ever, with a new lease wherever the last one ended."""
    sequence = 0
    while True:
        if flown.flight.phase is Phase.FREE and flown.may_fly:
            with suppress(CommandRejectedError):
                await flown.take("pilot", force=True)
                tally["leases"] += 1
                sequence = 0
        sequence += 1
        tally["hours"] += (flown.flight.phase is Phase.FLYING) / STICK_HZ / 3600.0
        # The stream begins with level sticks, or nobody engages.
        tilt = 40.0 * math.sin(sequence / 30.0) + rng.uniform(-5.0, 5.0) if sequence > 2 * STICK_HZ else 0.0
        sticks = {"pitch": tilt, "roll": -tilt, "yaw": 0.0, "throttle": 0.0}
        flown.stream(encode_map({**sticks, "epoch": flown.epoch, "sequence": sequence, "ttl": 0.3}))
        await asyncio.sleep(1.0 / STICK_HZ)
