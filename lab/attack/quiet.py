"""The guard says nothing in a flight that does not need it, whatever the line does: hours of it in virtual time."""

from __future__ import annotations

import asyncio
import math
import random
from contextlib import suppress
from dataclasses import dataclass
from typing import Final

from lab.rigs.boardport import ADAPTER_TIME, LineFault
from lab.rigs.cockpit import Boards, Cockpit, cockpit
from lab.rigs.virtualguard import VirtualGuard
from lab.stories.faults import FAULTS
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


@dataclass(frozen=True, slots=True)
class Quiet:
    """Flights of one aircraft.

    Attributes:
        boards: which.
        hours: flown under control, virtual.
        faults: of the line that were played.
        leases: taken; a fault that ends one is followed by another.
        written: what the guard wrote, as (seed, time since the flight began [s]).
    """

    boards: str
    hours: float
    faults: int
    leases: int
    written: list[tuple[int, float]]


def fly_quietly(boards: Boards, seeds: range) -> Quiet:
    """Fly once per seed."""
    found = [run_virtually(_fly(boards, seed)) for seed in seeds]
    return Quiet(
        boards.name,
        round(sum(tally.flown for tally, _ in found) / STICK_HZ / 3600.0, 3),
        sum(tally.faults for tally, _ in found),
        sum(tally.leases for tally, _ in found),
        [(seed, at) for seed, (_, written) in zip(seeds, found, strict=True) for at in written],
    )


async def _fly(boards: Boards, seed: int) -> tuple[_Tally, list[float]]:
    rng = random.Random(f"{seed} quiet")
    guard, tally = VirtualGuard(), _Tally()
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
            port.inject(fault, FAULTS[fault].amount)
            tally.faults += 1
            await asyncio.sleep(rng.uniform(0.1, 2.5))
            if not port.is_closed:
                port.inject(LineFault.NONE)
        pilot.cancel()
        guard.stop()
        return tally, [round(at - began, 3) for at, _ in guard.written]


@dataclass(slots=True)
class _Tally:
    leases: int = 0
    flown: int = 0
    faults: int = 0


async def _pilot(flown: Cockpit, rng: random.Random, tally: _Tally) -> None:
    """Stream sticks for ever, with a new lease wherever the last one ended."""
    sequence = 0
    while True:
        if flown.flight.phase is Phase.FREE and flown.may_fly:
            with suppress(CommandRejectedError):
                await flown.take("pilot", force=True)
                tally.leases += 1
                sequence = 0
        sequence += 1
        tally.flown += flown.flight.phase is Phase.FLYING
        # The stream begins with level sticks, or nobody engages.
        tilt = 40.0 * math.sin(sequence / 30.0) + rng.uniform(-5.0, 5.0) if sequence > 2 * STICK_HZ else 0.0
        sticks = {"pitch": tilt, "roll": -tilt, "yaw": 0.0, "throttle": 0.0}
        flown.stream(encode_map({**sticks, "epoch": flown.epoch, "sequence": sequence, "ttl": 0.3}))
        await asyncio.sleep(1.0 / STICK_HZ)
