"""The soak: a daemon under full load for a long time, and every frame accounted for on both sides.

Streams O 100, D 200, C 50 ms and link tests at 10 Hz, stick frames at 40 Hz through a NaviCtrl 0.24 (the fastest it
passes on without loss). At the end the simulator stands still, so that nothing is under way when frames are counted.
"""

from __future__ import annotations

import asyncio
import math
import signal
import statistics
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Any, Final

from lab.campaign import Row
from lab.cases import judged
from lab.rigs.flown import flown, observed
from lab.rigs.pilot import Pilot
from lab.rigs.processes import DaemonProcess, ObservedSimulation
from lab.rigs.waiting import following
from mkdaemon.client import Vehicle

LOAD: Final = "rates = {osd = 100, debug = 200, attitude = 50}\necho_hz = 10"
STICK_HZ: Final = 40.0
SAMPLE: Final = 2.0
"""Time between two looks at memory and descriptors [s]."""
WARM_UP: Final = 0.25
"""Part of the run before memory is compared: caches, windows and allocator arenas fill."""
LIMITS: Final = {"memory_mb_more": 2.0, "cpu_percent": 25.0} | dict.fromkeys(
    ("unreceived", "damaged", "echo_loss", "descriptors_more", "tracebacks", "exit_code"), 0.0
)
"""Of a soak; memory that grows by no more than the allocator's grain is flat [MiB]; see `soak`."""
SETTLE_TIME: Final = 1.5
"""Counters are published once a second [s]."""


async def soak(seconds: float, seed: int) -> Row:
    """Fly at full load for so long [s], then count.

    Returns:
        `board_sent` and `daemon_sent`, frames that each wrote; `unreceived`, frames that the other did not count, or
        counted too many; `dropped`, losses the daemon counted while it flew, by reason, and `damaged`, those of a bad
        line: meeting the boards cuts a frame or two before; `tracebacks`; `memory_mb`, median of the last quarter
        [MiB], and `descriptors`, open files at the end, both with what they are more than after the warm-up;
        `cpu_percent` of a core; `echo_loss`, link tests lost over the last window [%]; `exit_code`; `engagements`, how
        often the client had to take the lease: once, unless the machine stalled it for a second; `sticks` sent.
    """
    simulation = observed(seed, nc="0.24")
    async with flown(simulation, link=LOAD) as one, _last_values(one.client, "link/traffic", "link/health") as last:
        client, daemon = one.client, one.daemon
        await asyncio.sleep(SETTLE_TIME)
        before = last["link/traffic"]["dropped"]
        watch = await _fly(client, daemon, simulation, seconds)
        echo = last["link/health"]["echo"]["loss_percent"]
        await asyncio.sleep(SETTLE_TIME)
        simulation.is_frozen = True
        await asyncio.sleep(SETTLE_TIME)
        code = await daemon.end(signal.SIGTERM)
        await asyncio.sleep(SETTLE_TIME)
        traffic = last["link/traffic"]
    lost = {reason: more for reason, count in traffic["dropped"].items() if (more := count - before.get(reason, 0))}
    return judged(
        LIMITS,
        board_sent=simulation.to_host,
        daemon_sent=traffic["tx_frames"],
        unreceived=abs(simulation.to_host - traffic["rx_frames"]) + abs(traffic["tx_frames"] - simulation.from_host),
        damaged=sum(lost.get(reason, 0) for reason in ("checksum", "length", "characters")),
        dropped=lost,
        tracebacks=daemon.errors.count("Traceback"),
        sticks=traffic["tx_kinds"].get("fc.b", 0),
        echo_loss=echo,
        exit_code=abs(code),
        **watch,
    )


async def _fly(client: Vehicle, daemon: DaemonProcess, simulation: ObservedSimulation, seconds: float) -> Row:
    """Stream slow circles of the sticks; a lease that is lost on a busy machine is taken again, and counted."""
    memory: list[float] = []
    descriptors: list[int] = []
    engagements = 0
    async with Pilot(client, "soak", STICK_HZ) as pilot:
        began, cpu = time.monotonic(), daemon.cpu_s()
        while (t := time.monotonic() - began) < seconds:
            if not simulation.is_controlled:
                engagements += 1
                pilot.sticks |= {"pitch": 0.0, "roll": 0.0}
                await pilot.engage(lambda: simulation.is_controlled)
            pilot.sticks |= {"pitch": 30 * math.sin(t), "roll": 30 * math.cos(t), "throttle": -20.0}
            if t >= len(memory) * SAMPLE:
                memory.append(daemon.resident_mb())
                descriptors.append(daemon.descriptors())
            await asyncio.sleep(0.1)
        cpu = 100 * (daemon.cpu_s() - cpu) / t
    warm, quarter = int(len(memory) * WARM_UP), max(1, len(memory) // 4)
    level = statistics.median(memory[-quarter:])
    return {
        "memory_mb": round(level, 2),
        "memory_mb_more": round(level - statistics.median(memory[warm : warm + quarter]), 2),
        "descriptors": descriptors[-1],
        "descriptors_more": descriptors[-1] - descriptors[warm],
        "cpu_percent": round(cpu, 1),
        "engagements": engagements,
    }


@asynccontextmanager
async def _last_values(client: Vehicle, *suffixes: str) -> AsyncIterator[dict[str, dict[str, Any]]]:
    """The latest value of each key, kept up to date while the context lasts."""
    last: dict[str, dict[str, Any]] = {}
    async with following(client, lambda sample: last.update({sample.suffix: sample.fields}), *suffixes):
        yield last
