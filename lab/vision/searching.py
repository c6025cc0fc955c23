"""What the search for a target costs where there is none, by size of the image, beside AprilTag and OpenCV."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, Final

import cv2
import numpy as np
import numpy.typing as npt

from lab.vision.parts import Case, Part
from lab.vision.real import find_by_opencv
from lab.vision.stills import SeedSet, Studio, target_named
from mkdaemon.vision.camera.calibration_file import Intrinsics
from mkdaemon.vision.camera.image import CameraImage
from mkdaemon.vision.limits import LIMITS
from mkdaemon.vision.tags.detector import FIRST, Detector, looks_of
from mkdaemon.vision.tags.tagmap import TagMap
from mkdaemon.vision.track.tracker import Tracker
from mksim.scene.light import LightConditions

Grey = npt.NDArray[np.uint8]

SIZES: Final = ((640, 480), (1280, 720), (1920, 1080), (3840, 2160))
RENDERED: Final = (1920, 1080)
"""Larger images are enlarged from this size."""
MOST_IMAGES: Final = 40
FPS: Final = 30.0


def _plan(quick: bool, seeds: SeedSet) -> list[Part]:
    grounds = 1 if quick else 3
    return [Part(_size, (width, height, grounds, seeds.base + 500), grounds) for width, height in SIZES]


def _lens(width: int, height: int) -> Intrinsics:
    return Intrinsics(
        width=width, height=height, fx=0.94 * width, fy=0.94 * width, cx=(width - 1) / 2, cy=(height - 1) / 2
    )


def _pictures(width: int, height: int, grounds: int, seed: int) -> list[Grey]:
    """Images of ground alone, one of each kind."""
    size = (width, height) if width <= RENDERED[0] else RENDERED
    studio = Studio(target_named("nested"), seed, intrinsics=_lens(*size))
    nothing = LightConditions(target_in_view=False)
    pictures = [studio.shoot(2.5, 0.2, nothing).image.pixels for _ in range(grounds)]
    if size == (width, height):
        return pictures
    return [np.asarray(cv2.resize(p, (width, height), interpolation=cv2.INTER_CUBIC), dtype=np.uint8) for p in pictures]


def _size(width: int, height: int, grounds: int, seed: int) -> dict[str, Any]:
    """Processor times of one size [ms an image]."""
    tags = TagMap((target_named("nested"),))
    plain = Detector(tags.whitelist)
    search, april, opencv = [], [], []
    turns = 0
    for pixels in _pictures(width, height, grounds, seed):
        tracker = Tracker(tags, _lens(width, height))
        turns = LIMITS.search.thorough_every * len(looks_of(width, height))
        image = CameraImage(pixels, 0.0, 0.0, 0, "lab", "driver")
        for k in range(min(turns, MOST_IMAGES)):
            pixels[0, 0] ^= 1  # equal images would be those of a frozen camera
            search.append(_time(tracker.update, replace(image, captured_at=k / FPS, sequence=k)))
        april.append(_time(plain.search_all, pixels, *FIRST[0]))
        opencv.append(_time(find_by_opencv, pixels))
    return {
        "size": [width, height],
        "images": len(search),
        "mean_ms": round(float(np.mean(search)), 1),
        "largest_ms": round(max(search), 1),
        "apriltag_decimate2_ms": round(float(np.median(april)), 1),
        "opencv_subpix_ms": round(float(np.median(opencv)), 1),
        "every_search_s": round(turns / FPS, 2),
    }


def _time(call: Callable[..., object], *values: object) -> float:
    """Processor time of this thread [ms]."""
    start = time.thread_time()
    call(*values)
    return 1000.0 * (time.thread_time() - start)


def _sum_up(_quick: bool, _parts: Sequence[Part], found: Sequence[dict[str, Any]]) -> dict[str, Any]:
    return {"rows": list(found)}


SEARCH: Final = Case(_plan, _sum_up)
"""Milliseconds of processor time an image without a target."""
