"""What the black box costs the daemon: processor time, and the way of a setpoint, with and without it, in turns.

Medians of the turns count: another program of this machine can make one of them long, and never one short.
"""

from __future__ import annotations

import asyncio
import tempfile
import time
from pathlib import Path
from statistics import median
from typing import Any, Final

import cv2
import numpy as np

from lab.places import CONFIGS
from lab.rigs.flown import flown, observed
from lab.rigs.pilot import Pilot
from mkdaemon.link.session.evidence import percentile

SETTLE: Final = 3.0
"""After the aircraft obeys, before anything counts [s]."""
LINK: Final = "rates = {debug = 50, attitude = 20}\necho_hz = 5\n"
"""As much as a FlightCtrl's line carries beside setpoints at 50 Hz."""
OFF: Final = "[record]\nenabled = false\n"
CAMERA: Final = '[[cameras]]\nsource = "folder:{folder}/images"\nloop = true\nfps = 10.0\ntargets = ["{target}"]\n'
IMAGES: Final = 10
"""Of the folder that the camera plays, 640x480 each."""


async def measure(seconds: float, turns: int) -> dict[str, Any]:
    """Fly by sticks at 50 Hz for so long, in turns without and with, and beside a camera.

    Args:
        seconds: each time.
        turns: of each.
    """
    found: dict[str, list[dict[str, float]]] = {}
    for turn in range(turns):
        variants = {"off": OFF, "on": "", "camera_off": CAMERA + OFF, "camera_on": CAMERA}
        for name, section in variants.items():
            found.setdefault(name, []).append(await _fly(section, seconds, seed=turn))
    figures: dict[str, Any] = {}
    for name, runs in found.items():
        figures[name] = {key: median(run[key] for run in runs) for key in runs[0]}
    for prefix in ("", "camera_"):
        on, off = figures[f"{prefix}on"], figures[f"{prefix}off"]
        figures[f"{prefix}cpu_percent_more"] = on["cpu_percent"] - off["cpu_percent"]
        figures[f"{prefix}setpoint_p99_ms_more"] = on["setpoint_p99_ms"] - off["setpoint_p99_ms"]
    return figures


def _make_images(folder: Path) -> None:
    """Draw what a camera over rough ground sees: nothing smooth, which a recorder could make small, and no tag."""
    folder.mkdir()
    rng = np.random.default_rng(1)
    for number in range(IMAGES):
        coarse = rng.integers(0, 256, (60, 80), dtype=np.uint8)
        ground = cv2.resize(coarse, (640, 480), interpolation=cv2.INTER_CUBIC)
        noise = rng.integers(0, 8, ground.shape, dtype=np.uint8)
        cv2.imwrite(str(folder / f"{number:03}.png"), (ground // 2 + noise).astype(np.uint8))


async def _fly(section: str, seconds: float, *, seed: int) -> dict[str, float]:
    simulation = observed(seed)
    ages: list[float] = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        _make_images(folder / "images")
        lines = LINK + section.format(folder=folder, target=CONFIGS / "targets" / "nested.toml")
        async with flown(simulation, folder=folder, link=lines) as one, Pilot(one.client, "pilot") as pilot:
            client, daemon = one.client, one.daemon
            await pilot.engage(lambda: simulation.is_controlled)
            await asyncio.sleep(SETTLE)
            status = await client.get("record/status")
            entries = 0 if status is None else status.fields["entries"]
            cpu, began = daemon.cpu_s(), time.monotonic()
            async with client.watch("control/output") as samples:
                async with asyncio.timeout(seconds + 10.0):
                    async for sample in samples:
                        ages.append(sample.fields["age"])
                        if time.monotonic() - began > seconds:
                            break
            spent, took = daemon.cpu_s() - cpu, time.monotonic() - began
            status = await client.get("record/status")
            size = sum(path.stat().st_size for path in (folder / "state").glob("recordings/*.mcap"))
            written = 0 if status is None else status.fields["entries"] - entries
    ages.sort()
    return {
        "cpu_percent": 100 * spent / took,
        "setpoint_p99_ms": 1e3 * (percentile(ages, 0.99) or 0.0),
        "entries_per_s": written / took,
        "file_bytes_per_minute": size / (took + SETTLE) * 60,
    }
