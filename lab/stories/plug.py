"""Two hundred replugs of a real pseudo terminal under a daemon process: telemetry back, descriptors and memory flat.

The device is a symbolic link, as udev makes them; behind it a new pseudo terminal appears at every replug.
"""

from __future__ import annotations

import asyncio
import random
import statistics
import tempfile
import time
from pathlib import Path
from typing import Final

from lab.campaign import Row
from lab.cases import judged
from lab.rigs.flown import observed
from lab.rigs.processes import DaemonProcess, ObservedSimulation, connected, daemon_process
from lab.rigs.waiting import following, wait_until
from lab.stories.cable import BACK, first_words
from mkdaemon.client import Sample
from mksim.runtime import Runtime

STREAMED: Final = frozenset({"osd", "attitude", "debug"})
WARM_UP: Final = 0.25
"""Part of the cycles before descriptors and memory are compared."""
LIMITS: Final = {"back_max": BACK, "memory_mb_more": 2.0} | dict.fromkeys(
    ("not_release", "never_back", "descriptors_more", "tracebacks"), 0.0
)
"""Of all cycles together; memory that grows by no more than the allocator's grain is flat [MiB]; see `replug`."""


class _Bench:
    """The device that comes and goes, and what was seen of the daemon meanwhile.

    Attributes:
        streamed: when the daemon showed streamed telemetry last, on its clock [s].
    """

    streamed = 0.0

    def __init__(self, simulation: ObservedSimulation, device: Path, rng: random.Random) -> None:
        self.back: list[float] = []
        self.wrong = self.lost = 0
        self.descriptors: list[int] = []
        self.memory: list[float] = []
        self._simulation = simulation
        self._device = device
        self._rng = rng

    def take(self, sample: Sample) -> None:
        """Keep the time of a sample."""
        if sample.suffix.rpartition("/")[2] in STREAMED:
            self.streamed = sample.fields["stamp"]["monotonic"]

    async def cycle(self, daemon: DaemonProcess) -> None:
        """Plug in, wait for telemetry, look at everything, unplug."""
        simulation, rng = self._simulation, self._rng
        runtime = Runtime(simulation)
        simulation.heard.clear()
        async with runtime.serve():
            returned = time.monotonic()
            self._device.symlink_to(runtime.port)
            try:
                # After our first bytes: what the old line still held may be read late.
                await wait_until(lambda: simulation.heard and self.streamed >= simulation.heard[0][0])
                self.back.append(self.streamed - returned)
            except TimeoutError:
                self.lost += 1
            await asyncio.sleep(rng.uniform(0.05, 0.4))
            self.descriptors.append(daemon.descriptors())
            self.memory.append(daemon.resident_mb())
            if first_words(b"".join(data for _, data in simulation.heard)) != "release":
                self.wrong += 1
            self._device.unlink()
        await asyncio.sleep(rng.uniform(0.05, 0.6))


async def replug(cycles: int, seed: int) -> Row:
    """Unplug and plug in so many times.

    Returns:
        `back_p50` and `back_max`, median and longest time from the device's return to streamed telemetry [s];
        `not_release`, cycles whose first bytes were not a release; `never_back`, cycles after which no telemetry came;
        `descriptors`, open files of the daemon at the end, line open, and `memory_mb`, its memory, median of the last
        quarter [MiB]; both with what they are more than after the warm-up; `tracebacks` in its log.
    """
    with tempfile.TemporaryDirectory() as folder:
        device = Path(folder) / "ttyMK"
        bench = _Bench(observed(seed, nc="0.24", keeps=True), device, random.Random(f"{seed} plug"))
        async with (
            daemon_process(f"pty:{device}", Path(folder), link="wait_for_port = true") as daemon,
            connected(daemon.endpoint) as client,
            following(client, bench.take, "rx/**"),
        ):
            for _ in range(cycles):
                await bench.cycle(daemon)
    warm, quarter = int(cycles * WARM_UP), max(1, cycles // 4)
    files, memory = bench.descriptors, bench.memory
    level = statistics.median(memory[-quarter:])
    return judged(
        LIMITS,
        back_p50=round(statistics.median(bench.back), 3),
        back_max=round(max(bench.back), 3),
        not_release=bench.wrong,
        never_back=bench.lost,
        descriptors=max(files[-quarter:]),
        descriptors_more=max(files[-quarter:]) - max(files[warm : warm + quarter]),
        memory_mb=round(level, 2),
        memory_mb_more=round(level - statistics.median(memory[warm : warm + quarter]), 2),
        tracebacks=daemon.errors.count("Traceback"),
    )
