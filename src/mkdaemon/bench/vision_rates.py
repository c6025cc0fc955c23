"""How long looking takes, beside plain OpenCV and AprilTag in the same run, and what it does to the event loop."""

from __future__ import annotations

import asyncio
import threading
import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from mkdaemon.bench.vision_flight import VGA, FlightFrame, fly
from mkdaemon.bench.vision_stills import SeedSet, target_named
from mkdaemon.vision.attitude import LOOKING_DOWN
from mkdaemon.vision.detector import Detector
from mkdaemon.vision.tagmap import TagMap
from mkdaemon.vision.tracker import Tracker

Grey = npt.NDArray[np.uint8]

LAG_SAMPLE_S = 0.002
"""Sleep of the lag probe [s]; its lateness is the loop's lag."""


def rates(quick: bool, seeds: SeedSet) -> dict[str, Any]:
    """Times of search, tracking and the whole pipeline, and the lag of an event loop beside it."""
    target = target_named("nested")
    frames = list(fly(target, seeds.base + 800, seconds=2.0 if quick else 8.0, troubled=False))
    images = [frame.image.pixels for frame in frames]
    detector = Detector(TagMap((target,)).whitelist)
    search = _times(images, lambda pixels: detector.climb(pixels))
    plain = Detector(TagMap((target,)).whitelist)
    april = _times(images, lambda pixels: plain.search(pixels, "decimate1"))
    opencv = _times(images, _opencv())
    tracked, modes = _track_times(frames)
    out: dict[str, Any] = {
        "images": len(images),
        "size": [VGA.width, VGA.height],
        "detect_ms": _summary(search),
        "track_ms": _summary(tracked),
        "pipeline_hz": round(1000.0 / float(np.mean(tracked)), 1),
        "tracked_share": round(modes, 3),
        "opencv_subpix_ms": _summary(opencv),
        "apriltag_decimate1_ms": _summary(april),
        "ratio_detect_to_opencv": round(float(np.median(search) / np.median(opencv)), 3),
        "ratio_track_to_opencv": round(float(np.median(tracked) / np.median(opencv)), 3),
        "ratio_detect_to_apriltag": round(float(np.median(search) / np.median(april)), 3),
        "ratio_track_to_apriltag": round(float(np.median(tracked) / np.median(april)), 3),
    }
    for fps in (30, 60):
        out[f"loop_{fps}fps"] = asyncio.run(_loop_lag(frames, fps, 4.0 if quick else 15.0))
    out["loop_lag_p99_ms"] = out["loop_30fps"]["lag_p99_ms"]
    return out


def _opencv() -> Callable[[Grey], object]:
    parameters = cv2.aruco.DetectorParameters()
    parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    detector = cv2.aruco.ArucoDetector(cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11), parameters)
    return detector.detectMarkers


def _times(images: list[Grey], look: Callable[[Grey], object]) -> list[float]:
    """Milliseconds an image, after a warm-up."""
    for pixels in images[:3]:
        look(pixels)
    found = []
    for pixels in images:
        start = time.perf_counter()
        look(pixels)
        found.append((time.perf_counter() - start) * 1000.0)
    return found


def _track_times(frames: list[FlightFrame]) -> tuple[list[float], float]:
    """Milliseconds an image of the whole tracker with attitude, search included, and the share tracked."""
    target = target_named("nested")
    tracker = Tracker(TagMap((target,)), VGA, LOOKING_DOWN)
    found, followed = [], 0
    for frame in frames:
        start = time.perf_counter()
        result = tracker.update(frame.image, frame.attitude)
        found.append((time.perf_counter() - start) * 1000.0)
        followed += any(pose.mode in ("predicted", "flow") for pose in result.poses)
    return found, followed / max(len(frames), 1)


def _summary(values: list[float]) -> dict[str, float]:
    return {
        "median": round(float(np.median(values)), 3),
        "p95": round(float(np.percentile(values, 95)), 3),
        "p99": round(float(np.percentile(values, 99)), 3),
    }


async def _loop_lag(frames: list[FlightFrame], fps: int, seconds: float) -> dict[str, float]:
    """Lag of this loop, idle and beside a thread that tracks at `fps`."""
    idle = await _probe(seconds / 3)
    stop = threading.Event()
    done: list[float] = []
    worker = threading.Thread(target=_work, args=(frames, fps, stop, done), name="vision")
    worker.start()
    try:
        busy = await _probe(seconds)
    finally:
        stop.set()
        await asyncio.to_thread(worker.join)
    return {
        "idle_p99_ms": round(float(np.percentile(idle, 99)), 3),
        "lag_p50_ms": round(float(np.percentile(busy, 50)), 3),
        "lag_p99_ms": round(float(np.percentile(busy, 99)), 3),
        "above_idle_p99_ms": round(float(np.percentile(busy, 99) - np.percentile(idle, 99)), 3),
        "images_per_second": round(len(done) / seconds, 2),
    }


def _work(frames: list[FlightFrame], fps: int, stop: threading.Event, done: list[float]) -> None:
    target = target_named("nested")
    tracker = Tracker(TagMap((target,)), VGA, LOOKING_DOWN)
    due = time.perf_counter()
    k = 0
    while not stop.is_set():
        frame = frames[k % len(frames)]
        lap = k // len(frames) * frames[-1].image.captured_at
        image = replace(frame.image, captured_at=frame.image.captured_at + lap)
        tracker.update(image, frame.attitude if lap == 0 else None)
        done.append(time.perf_counter())
        k += 1
        due += 1.0 / fps
        stop.wait(max(due - time.perf_counter(), 0.0))


async def _probe(seconds: float) -> list[float]:
    """Lateness of short sleeps [ms]."""
    lags = []
    end = time.perf_counter() + seconds
    while time.perf_counter() < end:
        start = time.perf_counter()
        await asyncio.sleep(LAG_SAMPLE_S)
        lags.append((time.perf_counter() - start - LAG_SAMPLE_S) * 1000.0)
    return lags
