"""`python -m lab fly`: the whole daemon flies over a target it sees through a rendered camera, in real time.

`mkdaemon sim` and `mkdaemon run` are processes of their own, started as a user starts them. The simulated pilot takes
off by hand and hovers; a client streams position setpoints, the aircraft holds over the target, then is released.
"""

from __future__ import annotations

import asyncio
import math
from typing import Any, Final

import numpy as np

from lab.rigs.overtarget import HEIGHT, Seen, Setting, hovering
from lab.rigs.waiting import wait_for
from lab.tables import show
from mkdaemon.cli.arguments import AsJson
from mkdaemon.errors import MkError

SETTLING: Final = 6.0
"""Figures are taken after this much of the flight [s]."""
LARGEST: Final = 0.5
"""Farthest from the goal at any moment of the hold [m]."""
PERIOD: Final = 0.02
"""Longest time between two stick frames, where nothing is late [s]."""


def main(
    *,
    seconds: float = 20.0,
    fps: float = 15.0,
    wind: str = "indoor",
    seed: int = 1,
    as_json: AsJson = False,
) -> int:
    """Fly once, in real time; a minute. The goal is a hold within 0.5 m after the first seconds.

    Args:
        seconds: how long the machine flies.
        fps: images a second.
        wind: none, indoor, light or moderate.
        seed: of the simulator.
    """
    figures = asyncio.run(fly(seconds, fps, wind, seed))
    return show([{"seed": seed} | figures], ("seed",), as_json=as_json)


async def fly(seconds: float, fps: float, wind: str, seed: int) -> dict[str, Any]:
    """Fly once; the figures. See `main`.

    Raises:
        TimeoutError: the pilot did not come to hover with the target in sight.
    """
    async with hovering(Setting(fps, wind, seed)) as hover:
        daemon, client, seen = hover.daemon, hover.client, hover.seen
        began, share, lost = math.nan, math.nan, ""
        try:
            async with client.lease() as lease:
                await lease.velocity(0.0, 0.0, 0.0, seconds=0.1)
                began, cpu = asyncio.get_running_loop().time(), daemon.cpu_s()
                await lease.goto(0.0, 0.0, HEIGHT, seconds=seconds)
                share = (daemon.cpu_s() - cpu) / (asyncio.get_running_loop().time() - began)
        except MkError as error:
            lost = str(error)
        await wait_for(lambda: seen.phases[-1].startswith("free"), 10.0, 0.05)
        stats = seen.last.get("vision/down/stats", {})
    return build_figures(seen, began, share, lost) | {
        "image_rate": round(stats.get("fps", 0.0), 1),
        "images_lost": stats.get("lost", 0),
        "phases": seen.phases,
        "failsafes": seen.failsafes,
    }


def build_figures(seen: Seen, began: float, share: float, lost: str) -> dict[str, Any]:
    """What was measured; the loop's time is the bus's monotonic time on one machine."""
    held = np.array([place for at, place in seen.truths if at > began + SETTLING] or [(math.nan,) * 3])
    errors = held - (0.0, 0.0, HEIGHT)
    level = np.hypot(errors[:, 0], errors[:, 1])
    gaps = np.diff([at for at in seen.outputs if at > began] or [math.nan])
    farthest = float(np.linalg.norm(errors, axis=1).max())
    return {
        "hover_rms_cm": _rounded(100 * math.sqrt(float((level**2).mean()))),
        "hover_max_cm": _rounded(100 * farthest),
        "height_rms_cm": _rounded(100 * math.sqrt(float((errors[:, 2] ** 2).mean()))),
        "held_s": _rounded(seen.truths[-1][0] - began - SETTLING) if len(held) > 1 else 0.0,
        "image_latency_p50_ms": _percentile(seen.latencies, 50),
        "image_latency_p99_ms": _percentile(seen.latencies, 99),
        "control_jitter_p50_ms": _percentile(np.maximum(gaps - PERIOD, 0.0), 50),
        "control_jitter_p99_ms": _percentile(np.maximum(gaps - PERIOD, 0.0), 99),
        "frame_gap_max_ms": _percentile(gaps, 100),
        "simulator_gap_max_ms": _percentile(np.diff([at for at in seen.steps if at > began]), 100),
        "daemon_cpu_percent": _rounded(100 * share),
        "lost": lost,
        "holds": not lost and farthest <= LARGEST,
    }


def _percentile(values: Any, share: float) -> float | None:
    return _rounded(1000 * float(np.percentile(values, share))) if len(values) else None


def _rounded(value: float) -> float | None:
    return None if math.isnan(value) else round(value, 2)
