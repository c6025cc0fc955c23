"""How long looking takes, beside plain OpenCV and AprilTag in the same run, and what it does to the event loop."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from lab.vision.flight import LOOKING_DOWN, VGA, FlightFrame, fly
from lab.vision.lag import loop_lag
from lab.vision.stills import SeedSet, search_in_turn, target_named
from mkdaemon.vision.tags.detector import Detector
from mkdaemon.vision.tags.tagmap import TagMap
from mkdaemon.vision.track.tracker import Tracker

Grey = npt.NDArray[np.uint8]


def rates(quick: bool, seeds: SeedSet) -> dict[str, Any]:
    """Times of search, tracking and the whole pipeline, and the lag of an event loop beside it."""
    target = target_named("nested")
    frames = list(fly(target, seeds.base + 800, seconds=2.0 if quick else 8.0, troubled=False))
    images = [frame.image.pixels for frame in frames]
    detector = Detector(TagMap((target,)).whitelist)
    search = _times(images, lambda pixels: search_in_turn(detector, pixels))
    plain = Detector(TagMap((target,)).whitelist)
    april = _times(images, lambda pixels: plain.search(pixels, "grey"))
    opencv = _times(images, opencv_search())
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
        out[f"loop_{fps}fps"] = loop_lag(seeds.base + 810, fps, 2 if quick else 10)
    out["loop_lag_p99_ms"] = out["loop_30fps"]["lag_p99_ms"]
    out["loop_lag_above_idle_p99_ms"] = out["loop_30fps"]["above_idle_p99_ms"]
    return out


def opencv_search() -> Callable[[Grey], object]:
    """OpenCV's search for tags, with corners refined."""
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
