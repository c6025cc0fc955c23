"""From a stick to the line, in real time, until the bytes of the `b` frame are in the simulator's hands.

The kernel's event struct in a socket, evdev, the session, Zenoh, the daemon as a process of its own, the pseudo
terminal. The pad's events come through a socket and not from the kernel's driver: what a USB pad adds (1 to 8 ms of its
own polling) is not in it.
"""

from __future__ import annotations

import asyncio
import json
import os
import random
import time
from typing import Final

from lab.campaign import Row
from lab.cases import judged, percentile
from lab.rigs.flown import flown, observed
from lab.rigs.pipedpad import PipedPad
from lab.rigs.processes import Program, connected
from lab.rigs.waiting import wait_until
from mkdaemon.cli.mkctl.teleop.evdevpad import EvdevPad
from mkdaemon.cli.mkctl.teleop.mappings import find_mapping, load_mappings
from mkdaemon.cli.mkctl.teleop.session import TeleopSession
from mkdaemon.client.leasekeeper import LeaseKeeper
from mkdaemon.protocol.framing import Frame, FrameDecoder
from mkdaemon.protocol.messages import ExternControlV2

LIMITS: Final = {"p99_ms": 25.0, "unseen": 0}
"""See `summed_up`."""
SIDES: Final = (13_000, 19_000)
"""Raw roll, in turn: both give other counts, close enough for the limiter to pass at once."""
PAUSE: Final = (0.05, 0.15)
"""Shortest and longest time between two moves [s]."""
_OPERATOR: Final = "import asyncio, sys; from lab.teleop.latency import fly; asyncio.run(fly(*sys.argv[1:]))"


async def fly(endpoint: str, moves: str, seed: str) -> None:
    """Be an operator: fly, then move a stick at random times; print when, one JSON array."""
    rng = random.Random(seed)
    device = PipedPad()
    async with connected(endpoint) as uav:
        session = TeleopSession(LeaseKeeper(uav.lease))
        pad = EvdevPad(device, session.reported)
        session.attach(pad, find_mapping(pad.id, pad.facts.name, load_mappings()))
        stop = asyncio.Event()
        running = asyncio.create_task(session.run(stop), name="session")
        await asyncio.sleep(0.2)
        device.move(ABS_Y=32767)
        await asyncio.sleep(0.2)
        device.move(ABS_Y=0, BTN_TL=1)
        await wait_until(lambda: session.keeper.is_engaged)
        device.move(ABS_RX=SIDES[0])
        await asyncio.sleep(1.0)
        moved = []
        for number in range(int(moves)):
            await asyncio.sleep(rng.uniform(*PAUSE))
            moved.append(time.monotonic())
            device.move(ABS_RX=SIDES[(number + 1) % 2])
        await asyncio.sleep(0.5)
        stop.set()
        await running
    print(json.dumps(moved), flush=True)


async def measure_latency(moves: int, seed: int) -> Row:
    """Move a stick so often and measure."""
    simulation = observed(seed, keeps=True)
    before = os.getloadavg()[0]
    async with flown(simulation) as one:
        arguments = ("-c", _OPERATOR, one.daemon.endpoint, str(moves), str(seed))
        _, out = await (await Program.start(*arguments)).output()
    moved = json.loads(out)
    return summed_up(moved, _rolls(simulation.heard), before)


def _rolls(written: list[tuple[float, bytes]]) -> list[tuple[float, int]]:
    """Time and roll of every stick frame that flew."""
    decoder = FrameDecoder()
    found = []
    for at, data in written:
        for item in decoder.feed(data):
            if isinstance(item, Frame) and item.id == "b":
                frame = ExternControlV2.decode(item.payload)
                if frame.config:
                    found.append((at, frame.roll))
    return found


def summed_up(moved: list[float], rolls: list[tuple[float, int]], load: float) -> Row:
    """Find the first frame after each move that shows another roll than the one before it.

    Args:
        moved: when the stick moved [s; monotonic].

    Returns:
        `moves`; `unseen`, those that no frame showed; `p50_ms`, `p99_ms` and `max_ms` of the times, None without any
        [ms]; `frames`, stick frames on the line, and their `rate` [Hz]; `load` average before and after.
    """
    taken = []
    for number, at in enumerate(moved):
        until = moved[number + 1] if number + 1 < len(moved) else at + 1.0
        was = next((roll for when, roll in reversed(rolls) if when <= at), None)
        seen = next((when for when, roll in rolls if at < when <= until and roll != was), None)
        if seen is not None:
            taken.append(seen - at)
    ordered = sorted(taken)
    in_time = [when for when, _ in rolls if moved[0] <= when <= moved[-1]]
    return judged(
        LIMITS,
        moves=len(moved),
        unseen=len(moved) - len(taken),
        p50_ms=_ms(percentile(ordered, 0.5)),
        p99_ms=_ms(percentile(ordered, 0.99)),
        max_ms=_ms(ordered[-1] if ordered else None),
        frames=len(in_time),
        rate=round((len(in_time) - 1) / (in_time[-1] - in_time[0]), 1) if len(in_time) > 1 else 0.0,
        load=(round(load, 2), round(os.getloadavg()[0], 2)),
    )


def _ms(seconds: float | None) -> float | None:
    return None if seconds is None else round(1000 * seconds, 1)
