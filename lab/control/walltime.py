"""How fast the whole daemon is in earnest: from the image to the last byte on the wire, jitter, processor time.

`mkdaemon sim` with its rendered camera, `mkdaemon run` and a client are processes of their own; the simulator's time is
not the daemon's. The machine does other things, so what a known amount of work takes meanwhile stands beside it.

The goals are those of a cable to the FlightCtrl. Behind a NaviCtrl 0.24 no two stick frames are closer than 25 ms, so
that flight has figures and no goals.
"""

from __future__ import annotations

import asyncio
import itertools
import math
import os
import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, NamedTuple

import cv2
import numpy as np

from lab.rigs.overtarget import Hover, Seen, Setting, hovering
from lab.rigs.wiretap import Sticks

CAMERA_MS: Final = 30.0
"""The rendered camera means to deliver an image so long after the middle of its exposure [ms]; a busy machine renders
later."""
BOARDS: Final = {"fc": "", "nc": "behind_navictrl_"}
"""Whose port is flown through, and what its figures are called."""
FLIGHT: Final = 60.0
"""A measured flight lasts so long [s]."""
SETTLING: Final = 4.0
"""And is measured from then on [s]."""
SPARE: Final = 5.0
"""The operator's program would fly on for so long [s]."""
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


@dataclass(frozen=True, slots=True)
class Busy:
    """How busy a machine was meanwhile.

    Attributes:
        load: mean number of programs that ran or waited, over a minute.
        peer_p50: what OpenCV's own tag detector takes for one VGA image [s].
        peer_p99: the same, hardly ever exceeded [s].
        late_p99: an ordinary sleeper woke so much too late [s].
    """

    load: float
    peer_p50: float
    peer_p99: float
    late_p99: float


class Load:
    """Measures how busy the machine is with what does not belong to the daemon."""

    def __init__(self) -> None:
        self._peer: list[float] = []
        self._late: list[float] = []
        rng = np.random.default_rng(1)
        self._image = cv2.GaussianBlur(rng.integers(0, 255, (480, 640), np.uint8), (0, 0), 3.0)
        self._detector = cv2.aruco.ArucoDetector(cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36H11))

    async def watch(self) -> None:
        """Look twice a second, for ever."""
        while True:
            await asyncio.to_thread(self._look)
            await asyncio.sleep(0.5)

    def _look(self) -> None:
        began = time.perf_counter()
        self._detector.detectMarkers(self._image)
        self._peer.append(time.perf_counter() - began)
        due = time.perf_counter() + 0.02
        time.sleep(0.02)
        self._late.append(time.perf_counter() - due)

    def found(self) -> Busy:
        """Everything so far."""
        p50, p99 = np.percentile(self._peer, (50, 99))
        return Busy(os.getloadavg()[0], float(p50), float(p99), float(np.percentile(self._late, 99)))


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

    @property
    def to_wire(self) -> float:
        """From the delivery of the image until the last byte has left [s]."""
        return self.eyes + self.core + self.line


def images_to_wire(seen: Seen, sticks: Sequence[Sticks], since: float) -> list[Way]:
    """The way of each image to the first stick frame on the wire that rests on it.

    Args:
        seen: what was published.
        sticks: what was on the wire.
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


def thread_times(pid: int) -> dict[str, float]:
    """Processor time of each thread of a process, by its name; threads of one name together [s]."""
    used: dict[str, float] = {}
    for task in Path(f"/proc/{pid}/task").iterdir():
        with suppress(OSError):
            head, _, rest = (task / "stat").read_text(encoding="utf-8").rpartition(")")
            name = "loop" if int(task.name) == pid else head.partition("(")[2].rstrip("0123456789-")
            ticks = rest.split()
            used[name] = used.get(name, 0.0) + (int(ticks[11]) + int(ticks[12])) / os.sysconf("SC_CLK_TCK")
    return used


def run_timing(runs: int | None, first_seed: int, jobs: int) -> dict[str, dict[str, Any]]:
    """Fly in earnest and measure; figures by key.

    Args:
        runs: flights through each port; one if None.
        first_seed: seeds count up from here.
        jobs: has no meaning here, where one flight fills the machine.
    """
    found: dict[str, dict[str, Any]] = {}
    for k, (board, prefix) in itertools.product(range(runs or 1), BOARDS.items()):
        figures = asyncio.run(_fly(first_seed + k, board))
        suffix = "" if runs in (None, 1) else f"_{k}"
        found |= {f"{prefix}{name}{suffix}": figure for name, figure in figures.items()}
    return found


async def _fly(seed: int, board: str) -> dict[str, dict[str, Any]]:
    setting = Setting(fps=30.0, seed=seed, latency_ms=CAMERA_MS, jitter_ms=0.0, is_tapped=True, board=board)
    load = Load()
    async with hovering(setting) as hover:
        operator = await hover.hold(SETTLING + FLIGHT + SPARE)
        await asyncio.sleep(SETTLING)
        watching = asyncio.create_task(load.watch(), name="load")
        began, before = time.monotonic(), thread_times(hover.daemon.pid)
        simulator = sum(thread_times(hover.simulator).values())
        await asyncio.sleep(FLIGHT)
        after, ended = thread_times(hover.daemon.pid), time.monotonic()
        simulator = sum(thread_times(hover.simulator).values()) - simulator
        watching.cancel()
        is_flying = hover.seen.is_flying
        operator.terminate()
        await operator.wait()
    took = ended - began
    threads = {name: round(100 * (spent - before.get(name, 0.0)) / took, 1) for name, spent in after.items()}
    figures = _figures(hover, (began, ended), load.found(), threads, 100 * simulator / took)
    if board == "fc":
        for name, key, limit in GOALS:
            figures[name] |= {"goal": limit, "holds": figures[name][key] <= limit}
    return figures | {"flight": figures["flight"] | {"holds": is_flying}}


def _figures(
    hover: Hover, span: tuple[float, float], busy: Busy, threads: dict[str, float], simulator: float
) -> dict[str, dict[str, Any]]:
    assert hover.tap is not None
    seen, sticks = hover.seen, [item for item in hover.tap.sticks() if item[1].config]
    ways = images_to_wire(seen, sticks, span[0])
    hops = 1000 * np.array(ways)
    times = np.array([at for at, _ in sticks if span[0] < at < span[1]])
    figures = {
        "image_to_wire": _spread([1000 * way.to_wire for way in ways]),
        "camera_late": _spread(hops[:, 0] - CAMERA_MS),
        "image_to_pose": _spread(hops[:, 1]),
        "pose_to_frame": _spread(hops[:, 2]),
        "frame_to_wire": _spread(hops[:, 3]),
        "control_jitter": _spread(1000 * np.maximum(np.diff(times) - PERIOD, 0.0)),
        "frame_gap": _spread(1000 * np.diff(times)),
        "daemon_cpu_percent": {"value": round(sum(threads.values()), 1), "threads": threads},
        "simulator_cpu_percent": {"value": round(simulator, 1)},
        "machine": {
            "load": round(busy.load, 1),
            "cores": os.cpu_count(),
            "peer_ms": [round(1000 * busy.peer_p50, 1), round(1000 * busy.peer_p99, 1)],
            "late_p99_ms": round(1000 * busy.late_p99, 2),
        },
        "flight": {"phases": seen.phases, "failsafes": seen.failsafes},
    }
    return {name: {"holds": True} | figure for name, figure in figures.items()}


def _spread(values: Any) -> dict[str, Any]:
    """Middle, 99th percentile and worst [ms]."""
    p50, p99, worst = (round(float(value), 2) for value in np.percentile(values, (50, 99, 100)))
    return {"p50_ms": p50, "p99_ms": p99, "worst_ms": worst, "count": len(values)}
