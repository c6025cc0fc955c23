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
from dataclasses import dataclass
from typing import Any, Final

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
MEMORY_MB: Final = 2.0
"""Growth that still counts as flat [MiB]: the allocator's grain."""
CPU_PERCENT: Final = 25.0
"""Largest share of a core."""
SETTLE_TIME: Final = 1.5
"""Counters are published once a second [s]."""


@dataclass(frozen=True, slots=True)
class Soak:
    """What a soak showed.

    Attributes:
        seconds: how long it flew.
        board_sent: frames the simulated board wrote.
        daemon_received: frames the daemon counted.
        daemon_sent: frames the daemon counted.
        board_received: frames that reached the simulated board.
        dropped: losses the daemon counted while it flew, by reason; meeting the boards cuts a frame or two before.
        tracebacks: in its log.
        memory_mb: median of its memory after the warm-up, and of the last quarter [MiB].
        descriptors: open files after the warm-up and at the end.
        cpu_percent: of one core.
        echo_loss: link tests lost over the last window [%].
        exit_code: of the daemon.
        engagements: how often the client had to take the lease: once, unless the machine stalled it for a second.
        sticks: external control frames sent.
    """

    seconds: float
    board_sent: int
    daemon_received: int
    daemon_sent: int
    board_received: int
    dropped: dict[str, int]
    tracebacks: int
    memory_mb: tuple[float, float]
    descriptors: tuple[int, int]
    cpu_percent: float
    echo_loss: float
    exit_code: int
    engagements: int = 1
    sticks: int = 0

    @property
    def is_wrong(self) -> bool:
        """Whether a frame was lost or damaged, the daemon grew or failed, or used too much of a core."""
        is_lost = self.board_sent != self.daemon_received or self.daemon_sent != self.board_received
        is_damaged = bool({"checksum", "length", "characters"} & self.dropped.keys()) or self.echo_loss != 0
        grows = self.memory_mb[1] - self.memory_mb[0] > MEMORY_MB or self.descriptors[1] > self.descriptors[0]
        has_failed = bool(self.tracebacks or self.exit_code)
        return is_lost or is_damaged or grows or has_failed or self.cpu_percent > CPU_PERCENT


async def soak(seconds: float, seed: int) -> Soak:
    """Fly at full load for so long [s], then count."""
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
    return Soak(
        seconds=seconds,
        board_sent=simulation.to_host,
        daemon_received=traffic["rx_frames"],
        daemon_sent=traffic["tx_frames"],
        board_received=simulation.from_host,
        dropped={
            reason: more for reason, count in traffic["dropped"].items() if (more := count - before.get(reason, 0))
        },
        tracebacks=daemon.errors.count("Traceback"),
        memory_mb=watch.memory_mb,
        descriptors=watch.descriptors,
        cpu_percent=watch.cpu_percent,
        engagements=watch.engagements,
        sticks=traffic["tx_kinds"].get("fc.b", 0),
        echo_loss=echo,
        exit_code=code,
    )


@dataclass(frozen=True, slots=True)
class _Watch:
    """What the daemon's process did while it flew."""

    memory_mb: tuple[float, float]
    descriptors: tuple[int, int]
    cpu_percent: float
    engagements: int


async def _fly(client: Vehicle, daemon: DaemonProcess, simulation: ObservedSimulation, seconds: float) -> _Watch:
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
    first, final = memory[warm : warm + quarter], memory[-quarter:]
    levels = round(statistics.median(first), 2), round(statistics.median(final), 2)
    return _Watch(levels, (descriptors[warm], descriptors[-1]), round(cpu, 1), engagements)


@asynccontextmanager
async def _last_values(client: Vehicle, *suffixes: str) -> AsyncIterator[dict[str, dict[str, Any]]]:
    """The latest value of each key, kept up to date while the context lasts."""
    last: dict[str, dict[str, Any]] = {}
    async with following(client, lambda sample: last.update({sample.suffix: sample.fields}), *suffixes):
        yield last
