"""How many images a second are looked at, and what that does to the event loop beside it.

The loop is measured beside the daemon's own vision worker, both with the priorities that they have in the daemon, as
far as the system allows it. Idle and working blocks alternate: whatever else the machine does is in both.
"""

from __future__ import annotations

import asyncio
import itertools
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from lab.places import CONFIGS
from lab.vision.flight import ATTITUDE_RATE, FlightFrame, fly
from lab.vision.stages import seconds_of
from lab.vision.stills import TARGETS, SeedSet, target_named
from mkdaemon.bus.codec import encode
from mkdaemon.clock import Clock
from mkdaemon.config.camera import CameraSection
from mkdaemon.config.vision import VisionSection
from mkdaemon.daemon.priority import favour_eyes, favour_loop, treat_threads_equally
from mkdaemon.frames import euler_from_rotation
from mkdaemon.telemetry.base import Telemetry
from mkdaemon.telemetry.vision import VisionStats
from mkdaemon.vision.camera.calibration_file import load_camera
from mkdaemon.vision.camera.image import ImageSource, Shot
from mkdaemon.vision.pipeline import STATS_EVERY
from mkdaemon.vision.track.attitude import AttitudeSample
from mkdaemon.vision.worker import VisionWorker

LAG_SAMPLE: Final = 0.002
"""Sleep of the probe [s]; its lateness is the loop's lag."""
BLOCK_TIME: Final = 2.0
"""Length of an idle or working block [s]."""
SETTLING: Final = 0.3
"""Left out after each change [s]."""
CAMERA_FILE: Final = CONFIGS / "cameras" / "sim.toml"
WAITED: Final = Path("/proc/thread-self/schedstat")
"""Linux: its second number is how long this thread could have run and waited for a core [ns]."""

Samples = npt.NDArray[np.float64]


def rates(quick: bool, seeds: SeedSet) -> dict[str, Any]:
    """Images a second of the whole tracker with attitude, search included, and the lag of an event loop beside it."""
    frames = list(fly(target_named("nested"), seeds.base + 800, seconds=2.0 if quick else 8.0, troubled=False))
    hz = len(frames) / seconds_of("nested", frames, known=True)
    loops = {f"loop_{fps}fps": loop_lag(seeds.base + 810, fps, 2 if quick else 10) for fps in (30, 60)}
    return {"images": len(frames), "pipeline_hz": round(hz, 1), **loops}


def loop_lag(seed: int, fps: int, rounds: int) -> dict[str, Any]:
    """Lag of the daemon's kind of loop beside its vision worker.

    Args:
        seed: of the flight the camera shows.
        fps: images a second.
        rounds: each has an idle and a working block.
    """
    lens = load_camera(CAMERA_FILE).intrinsics
    film = Film(list(fly(target_named("nested"), seed, seconds=4.0, fps=fps, intrinsics=lens, troubled=False)), fps)
    with asyncio.Runner(loop_factory=_fast_loop()) as runner:
        return runner.run(_measure(film, rounds))


def _fast_loop() -> Callable[[], asyncio.AbstractEventLoop] | None:
    """The loop the daemon uses."""
    try:
        import uvloop
    except ImportError:
        return None
    return uvloop.new_event_loop


class Film(ImageSource):
    """A camera that shows a flight forwards and backwards at its own rate, while it plays.

    Args:
        frames: of the flight.
        fps: images a second.
    """

    def __init__(self, frames: list[FlightFrame], fps: float) -> None:
        self._frames = itertools.cycle([*frames, *frames[-2:0:-1]])
        self._period = 1.0 / fps
        self._due = 0.0
        self.shown = 0
        self.playing = threading.Event()
        self.say: Callable[[AttitudeSample], None] = lambda _: None

    def open(self) -> tuple[str, ...]:
        """Nothing to open."""
        return ()

    def read(self, timeout: float) -> Shot | None:
        """Show the next image when its time has come; the vehicle's attitude comes with it."""
        if not self.playing.wait(timeout):
            return None
        overdue = time.monotonic() - self._due - self._period
        self._due += self._period if overdue < self._period else self._period + overdue
        time.sleep(max(-overdue, 0.0))
        frame, now = next(self._frames), time.monotonic()
        rotation = frame.attitude.at(frame.image.captured_at, 2.0 / ATTITUDE_RATE)
        if rotation is not None:
            self.say(AttitudeSample(now, *euler_from_rotation(rotation)))
        self.shown += 1
        return Shot(frame.image.pixels, now, now)

    def close(self) -> None:
        """Nothing to close."""


class _Audience:
    """Packs what the worker publishes, as the bus does, and counts the images."""

    def __init__(self) -> None:
        self.processed = 0

    def publish(self, _suffix: str, value: Telemetry) -> None:
        encode(value)
        if isinstance(value, VisionStats):
            self.processed = value.processed


async def _measure(film: Film, rounds: int) -> dict[str, Any]:
    """Idle and working, in turn."""
    cfg = CameraSection(source="film", calibration=CAMERA_FILE, targets=(TARGETS / "nested.toml",))
    audience, loop = _Audience(), asyncio.get_running_loop()
    worker = VisionWorker([cfg], VisionSection(), audience.publish, loop, Clock(), open_source=lambda _cfg: film)
    film.say = worker.attitude_arrived
    samples: dict[bool, list[Samples]] = {False: [], True: []}
    allowed, played = False, 0.0
    worker.start()
    try:
        for plays in list(samples) * rounds:
            allowed = favour_loop()
            favour_eyes()
            (film.playing.set if plays else film.playing.clear)()
            started = loop.time()
            await asyncio.sleep(SETTLING)
            samples[plays].append(await _probe(BLOCK_TIME))
            treat_threads_equally()
            played += plays * (loop.time() - started)
        film.playing.clear()
        await asyncio.sleep(STATS_EVERY + 0.2)
    finally:
        treat_threads_equally()
        await asyncio.to_thread(worker.stop)
    idle, busy = (np.percentile(np.concatenate(samples[plays]), 99, axis=0) for plays in (False, True))
    return {
        "loop_priority": "real-time" if allowed else "ordinary: the system allows no other",
        "lag_p99_ms": round(float(busy[0]), 3),
        "above_idle_p99_ms": round(float(busy[0] - idle[0]), 3),
        "waited_for_core_p99_ms": round(float(busy[1]), 3),
        "images_per_second": round(audience.processed / played, 2),
    }


async def _probe(seconds: float) -> Samples:
    """Lateness of short sleeps, and the part of it this thread waited for a core `(n, 2)` [ms]."""
    found = []
    end = time.perf_counter() + seconds
    while time.perf_counter() < end:
        waited, start = _waited_ms(), time.perf_counter()
        await asyncio.sleep(LAG_SAMPLE)
        late = (time.perf_counter() - start - LAG_SAMPLE) * 1000.0
        found.append((late, _waited_ms() - waited))
    return np.array(found)


def _waited_ms() -> float:
    """Time this thread has ever waited for a core [ms]; 0 where the system does not tell."""
    try:
        return int(WAITED.read_text().split()[1]) * 1e-6
    except (OSError, IndexError):
        return 0.0
