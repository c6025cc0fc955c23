"""`python -m lab fly`: the whole daemon holds over a target that it sees through a rendered camera, in real time.

`mkdaemon sim`, `mkdaemon run` and `mkctl hold` are processes of their own, started as a user starts them; the simulated
pilot takes off by hand. Judged by the true place, and by the bytes on the line: how late they are after an image, and
after one another.

The goals of time are those of a cable to the FlightCtrl. Behind a NaviCtrl 0.24 no two stick frames are closer than
25 ms, so that flight has none.
"""

from __future__ import annotations

import asyncio
import math
import os
import time
from collections.abc import Sequence
from typing import Any, Final, NamedTuple

import numpy as np

from lab.campaign import Row
from lab.rigs.overtarget import HEIGHT, Hover, Seen, Setting, hovering
from lab.rigs.processes import cpu_of
from lab.rigs.sleeper import Sleeper
from lab.rigs.wiretap import Sticks
from lab.tables import show
from mkdaemon.cli.arguments import AsJson

BOARDS: Final = {"fc": "", "nc": "behind_navictrl_"}
"""Whose port is flown through, and what its figures are called."""
CAMERA_MS: Final = 30.0
"""The rendered camera means to deliver an image so long after the middle of its exposure [ms]."""
FLIGHT: Final = 66.0
"""A flight lasts so long [s]."""
SETTLING: Final = 6.0
"""And counts from then on [s]."""
SPARE: Final = 5.0
"""The operator's program would fly on for so long [s]."""
LARGEST: Final = 0.5
"""Farthest from the goal at any moment of the hold [m]."""
PERIOD: Final = 0.02
"""Longest time between two stick frames, where nothing is late [s]: docs/configuration.md, control.rate."""
MATCH: Final = 0.012
"""A stick frame's image is the one taken so close to the time that the estimate names [s]."""
LATEST: Final = 2.0
"""A stick frame that rests on an image leaves within this time, in which no number comes again [s]."""
GOALS: Final = (
    ("image_to_wire", "p99_ms", 25.0),
    ("control_jitter", "p99_ms", 3.0),
    ("daemon_cpu_percent", "value", 60.0),
)
"""At most; the first from when the camera has delivered the image."""


class Way(NamedTuple):
    """The way of one image to the wire; see `docs/lab/control.md`.

    Attributes:
        camera: from the middle of the exposure until the daemon has the image [s].
        eyes: from then until its pose is ready [s].
        core: from then until the first stick frame that rests on it is handed to the line [s].
        line: from then until the last byte of that frame has left [s].
    """

    camera: float
    eyes: float
    core: float
    line: float


def images_to_wire(seen: Seen, sticks: Sequence[Sticks], since: float) -> list[Way]:
    """The way of each image to the first stick frame on the wire that rests on it.

    Args:
        since: images before this do not count [s; monotonic].
    """
    left: dict[int, list[float]] = {}
    for at, stick in sticks:
        left.setdefault(stick.frame, []).append(at)
    images = sorted(zip(seen.captures, seen.deliveries, seen.latencies, strict=True))
    captures, found, newest = np.array([capture for capture, _, _ in images]), list[Way](), since
    for number, image, made in seen.frames:
        capture = float(captures[np.abs(captures - image).argmin()])
        # Numbers come again; one that was never written rests with the next.
        at = min((at for at in left.get(number, ()) if capture < at < capture + LATEST), default=math.nan)
        if capture > newest and abs(capture - image) < MATCH and math.isfinite(at):
            # An image that a newer one overtook reached the wire with it.
            found += [
                Way(delivered, ready - delivered, made - taken - ready, at - made)
                for taken, delivered, ready in images
                if newest < taken <= capture
            ]
            newest = capture
    return found


def main(*, seconds: float = FLIGHT, seed: int = 1, as_json: AsJson = False) -> int:
    """Fly once by cable and once behind a NaviCtrl, in real time; four minutes.

    The goals are a hold within 0.5 m after the first seconds and, by cable, times and load of the processor.

    Args:
        seconds: how long the machine flies each time.
        seed: of the simulator.
    """
    found: list[Row] = []
    for board, prefix in BOARDS.items():
        setting = Setting(30.0, seed=seed, latency_ms=CAMERA_MS, jitter_ms=0.0, is_tapped=True, board=board)
        figures = asyncio.run(fly(setting, seconds))
        for name, key, limit in GOALS if board == "fc" else ():
            figures[name] |= {"goal": limit, "holds": figures[name][key] <= limit}
        found += [{"figure": f"{prefix}{name}"} | figure for name, figure in figures.items()]
    return show(found, ("figure",), as_json=as_json)


async def fly(setting: Setting, seconds: float) -> dict[str, Row]:
    """Fly once for so long [s]; figures by key, each with `holds`.

    Raises:
        TimeoutError: the pilot did not come to hover with the target in sight, or the daemon does not fly.
    """
    async with hovering(setting) as hover:
        operator = await hover.hold(seconds + SPARE)
        await asyncio.sleep(SETTLING)
        with Sleeper() as sleeper:
            began, before = time.monotonic(), (hover.daemon.cpu_s(), cpu_of(hover.simulator))
            await asyncio.sleep(seconds - SETTLING)
            ended, after = time.monotonic(), (hover.daemon.cpu_s(), cpu_of(hover.simulator))
        is_flying = hover.seen.is_flying
        await operator.end()
    shares = [round(100 * (new - old) / (ended - began), 1) for new, old in zip(after, before, strict=True)]
    return {name: {"holds": True} | figure for name, figure in _times(hover, began, ended).items()} | {
        "hold": hold_of(hover.seen, began, ended),
        "daemon_cpu_percent": {"value": shares[0], "holds": True},
        "simulator_cpu_percent": {"value": shares[1]},
        "machine": {"load": round(os.getloadavg()[0], 1), "woken_late_p99_ms": sleeper.percentile(99)},
        "flight": {"phases": hover.seen.phases, "failsafes": hover.seen.failsafes, "holds": is_flying},
    }


def hold_of(seen: Seen, began: float, ended: float) -> Row:
    """How near to its goal the aircraft was between two times [s; monotonic], by the truth; None without a flight."""
    held = np.array([place for at, place in seen.truths if began < at < ended]).reshape(-1, 3) - (0.0, 0.0, HEIGHT)
    if not len(held):
        return {"rms_cm": None, "height_rms_cm": None, "farthest_cm": None, "holds": False}
    level, height = np.sqrt((held[:, :2] ** 2).sum(axis=1).mean()), np.sqrt((held[:, 2] ** 2).mean())
    farthest = float(np.linalg.norm(held, axis=1).max())
    figures = {"rms_cm": level, "height_rms_cm": height, "farthest_cm": farthest}
    return {name: round(100 * float(value), 2) for name, value in figures.items()} | {"holds": farthest <= LARGEST}


def _times(hover: Hover, began: float, ended: float) -> dict[str, Row]:
    assert hover.tap is not None
    sticks = [item for item in hover.tap.sticks() if item[1].config]
    hops = 1000 * np.array(images_to_wire(hover.seen, sticks, began))
    gaps = 1000 * np.diff([at for at, _ in sticks if began < at < ended])
    return {
        "exposure_to_pose": _spread(hops[:, :2].sum(axis=1)),
        "image_to_wire": _spread(hops[:, 1:].sum(axis=1)),
        "image_to_pose": _spread(hops[:, 1]),
        "pose_to_frame": _spread(hops[:, 2]),
        "frame_to_wire": _spread(hops[:, 3]),
        "control_jitter": _spread(np.maximum(gaps - 1000 * PERIOD, 0.0)),
    }


def _spread(values: Any) -> Row:
    """Middle, 99th percentile and worst [ms]."""
    p50, p99, worst = (round(float(value), 2) for value in np.percentile(values, (50, 99, 100)))
    return {"p50_ms": p50, "p99_ms": p99, "worst_ms": worst, "count": len(values)}
