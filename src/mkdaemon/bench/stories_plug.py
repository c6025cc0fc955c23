"""Two hundred replugs of a real pseudo terminal under a daemon process: telemetry back, descriptors and memory flat.

The device is a symbolic link, as udev makes them; behind it a new pseudo terminal appears at every replug.
"""

from __future__ import annotations

import asyncio
import random
import statistics
import tempfile
import time
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from mkdaemon.bench.stories_cable import BACK_S, first_words
from mkdaemon.bench.stories_process import PATIENCE, ObservedSimulation, connected, daemon_process
from mkdaemon.config.sim import PilotPlan, SimConfig
from mkdaemon.sim.runtime import Runtime

STREAMED: Final = frozenset({"osd", "attitude", "debug"})
WARM_UP: Final = 0.25
"""Part of the cycles before descriptors and memory are compared."""
MEMORY_MB: Final = 2.0
"""Growth that still counts as flat [MiB]: the allocator's grain."""


@dataclass(frozen=True, slots=True)
class Replugs:
    """What the cycles showed.

    Attributes:
        cycles: how many.
        back_p50: time from the device's return to streamed telemetry, median [s].
        back_max: longest [s].
        not_release: cycles whose first bytes were not a release.
        never_back: cycles after which no telemetry came.
        descriptors: open files of the daemon after the warm-up and at the end, line open.
        memory_mb: its memory, median after the warm-up and of the last quarter [MiB].
        tracebacks: in its log.
    """

    cycles: int
    back_p50: float
    back_max: float
    not_release: list[int]
    never_back: list[int]
    descriptors: tuple[int, int]
    memory_mb: tuple[float, float]
    tracebacks: int

    @property
    def holds(self) -> bool:
        """Whether every limit holds."""
        return (
            self.back_max <= BACK_S
            and not self.not_release
            and not self.never_back
            and self.descriptors[1] <= self.descriptors[0]
            and self.memory_mb[1] - self.memory_mb[0] <= MEMORY_MB
            and not self.tracebacks
        )


async def replug(cycles: int, *, seed: int = 1, board: str = "nc") -> Replugs:
    """Unplug and plug in so many times."""
    rng = random.Random(f"{seed} plug")
    config = SimConfig.model_validate(
        {"board": board, "pilot_plan": PilotPlan.NOTHING, "calibrated": True, "seed": seed}
    )
    simulation = ObservedSimulation(config)
    back: list[float] = []
    wrong: list[int] = []
    lost: list[int] = []
    descriptors: list[int] = []
    memory: list[float] = []
    with tempfile.TemporaryDirectory() as folder:
        device = Path(folder) / "ttyMK"
        async with (
            daemon_process(f"pty:{device}", Path(folder), link="wait_for_port = true") as daemon,
            connected(daemon.endpoint) as client,
            client.watch("rx/**") as samples,
        ):
            latest = 0.0

            async def listen() -> None:
                nonlocal latest
                async for sample in samples:
                    if sample.suffix.rpartition("/")[2] in STREAMED:
                        latest = sample.fields["t_monotonic"]

            listening = asyncio.create_task(listen(), name="listen")
            for cycle in range(cycles):
                runtime = Runtime(simulation)
                simulation.heard.clear()
                async with runtime.serve():
                    returned = time.monotonic()
                    device.symlink_to(runtime.port)
                    try:
                        async with asyncio.timeout(PATIENCE):
                            while latest < returned:  # noqa: ASYNC110 - told by another process
                                await asyncio.sleep(0.002)
                        back.append(latest - returned)
                    except TimeoutError:
                        lost.append(cycle)
                    await asyncio.sleep(rng.uniform(0.05, 0.4))
                    descriptors.append(daemon.descriptors())
                    memory.append(daemon.resident_mb())
                    if first_words(b"".join(data for _, data in simulation.heard)) != "release":
                        wrong.append(cycle)
                    device.unlink()
                await asyncio.sleep(rng.uniform(0.05, 0.6))
            listening.cancel()
            with suppress(asyncio.CancelledError):
                await listening
    warm, quarter = int(cycles * WARM_UP), max(1, cycles // 4)
    return Replugs(
        cycles=cycles,
        back_p50=round(statistics.median(back), 3),
        back_max=round(max(back), 3),
        not_release=wrong,
        never_back=lost,
        descriptors=(max(descriptors[warm : warm + quarter]), max(descriptors[-quarter:])),
        memory_mb=(
            round(statistics.median(memory[warm : warm + quarter]), 2),
            round(statistics.median(memory[-quarter:]), 2),
        ),
        tracebacks=daemon.errors.count("Traceback"),
    )
