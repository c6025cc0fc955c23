"""Cameras as they are: tone curve, colour mosaic, sharpening, JPEG, rolling shutter, vibration, little light.

The same images go through the tracker with and without attitude, through plain AprilTag and through OpenCV.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import cache, partial
from math import radians
from typing import Any, Final

import cv2
import numpy as np
import numpy.typing as npt

from lab.vision.flight import VGA, Device, FlightFrame, fly
from lab.vision.looks import Look, Program, eyes, figures, flights, judged, look, look_at, summed
from lab.vision.parts import Case, Part
from lab.vision.stills import SeedSet, target_named
from mkdaemon.vision.camera.calibration_file import Intrinsics
from mkdaemon.vision.pose.pose import solve
from mkdaemon.vision.pose.projection import Projection
from mkdaemon.vision.tags.cellread import Detection
from mkdaemon.vision.tags.detector import find_codes
from mkdaemon.vision.tags.tagmap import Target
from mksim.scene.light import LightConditions
from mksim.scene.processing import Processing

Grey = npt.NDArray[np.uint8]

FAMILY: Final = "tag36h11"
"""Of every target that is seen."""
SECONDS: Final = 4.0
NEAR_M, FAR_M, MIDDLE_M = 0.35, 8.0, 4.0
READOUT: Final = 0.030
"""Of all rows of an image [s]: a webcam at 30 images a second."""
VIBRATION: Final = radians(1.0)
RESPONSE: Final = 0.03
"""Of a multirotor's frame to what shakes it [s]."""
TONE: Final = LightConditions(processing=Processing(gamma=2.2))
WEBCAM: Final = LightConditions(
    processing=Processing(mosaic=True, denoise=6.0, gamma=2.2, sharpening=0.8), jpeg_quality=85
)
DARK: Final = LightConditions(exposure=0.15, noise_sd=2.5, processing=Processing(mosaic=True, denoise=4.0, gamma=2.2))
LINE_TIME: Final = READOUT / VGA.height
DEVICES: Final = {
    "ideal": Device(response=RESPONSE),
    "gamma": Device(TONE, response=RESPONSE),
    "low_light": Device(DARK, exposure_time=0.008, response=RESPONSE),
    "webcam": Device(WEBCAM, response=RESPONSE),
    "rolling": Device(line_time=LINE_TIME, vibration=VIBRATION, response=RESPONSE),
    "webcam_rolling": Device(WEBCAM, line_time=LINE_TIME, vibration=VIBRATION, response=RESPONSE),
}
"""Cameras by name."""


def _plan(quick: bool, seeds: SeedSet) -> list[Part]:
    return flights(_fly, DEVICES, seeds.base + 1300, 1 if quick else 6, int(30 * SECONDS))


def _fly(name: str, seed: int) -> dict[str, list[Look]]:
    """One flight through all programs."""
    target = target_named("nested")
    return look_at(_frames(name, seed), eyes(target, lens_of(name)), plain_programs(target, lens_of(name)))


def _frames(name: str, seed: int) -> Iterator[FlightFrame]:
    """A flight behind a camera."""
    return fly(
        target_named("nested"), seed, seconds=SECONDS, near=NEAR_M, far=FAR_M, troubled=False, device=DEVICES[name]
    )


def lens_of(name: str) -> Intrinsics:
    """What all programs believe a camera to be."""
    return VGA.model_copy(update={"line_time": DEVICES[name].line_time})


def plain_programs(target: Target, lens: Intrinsics) -> dict[str, Program]:
    """AprilTag and OpenCV: the better of both solutions of the corners, as a program without a track takes it."""
    own, projection = {tag.code: tag for tag in target.tags}, Projection(lens)

    def program(search: Callable[[Grey], list[Detection]]) -> Program:
        def see(frame: FlightFrame) -> Look:
            pairs = [(own[tag.code], tag) for tag in search(frame.image.pixels) if tag.code in own]
            poses = solve(pairs, projection) if pairs else []
            return judged(frame, poses[0].rotation, poses[0].position) if poses else look(frame, None)

        return see

    return {"apriltag": program(partial(find_codes, (FAMILY,))), "opencv": program(find_by_opencv)}


@cache
def _opencv() -> cv2.aruco.ArucoDetector:
    """OpenCV's search for tags, with sub-pixel corners."""
    parameters = cv2.aruco.DetectorParameters()
    parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    parameters.cornerRefinementWinSize = 3
    parameters.minMarkerPerimeterRate = 0.02
    return cv2.aruco.ArucoDetector(cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11), parameters)


def find_by_opencv(pixels: Grey) -> list[Detection]:
    """The codes that OpenCV sees in `(h, w)` uint8; it draws them upside down."""
    quads, ids, _ = _opencv().detectMarkers(pixels)
    corners = (np.roll(np.asarray(quad, dtype=np.float64).reshape(4, 2), 2, axis=0) for quad in quads)
    codes = [] if ids is None else ids.ravel()
    return [Detection(FAMILY, int(code), 0, 0.0, at) for code, at in zip(codes, corners, strict=True)]


def _near_and_far(looks: Sequence[Look]) -> dict[str, Any]:
    return {
        "to_4_m": figures([one for one in looks if one.distance <= MIDDLE_M]),
        "to_8_m": figures([one for one in looks if one.distance > MIDDLE_M]),
    }


def _plan_published(quick: bool, seeds: SeedSet) -> list[Part]:
    return flights(_publish, DEVICES, seeds.base + 1400, 1 if quick else 15, int(30 * SECONDS))


def _publish(name: str, seed: int) -> dict[str, list[Look]]:
    """All that is published in one flight, tags that are cut by the image's edge included."""
    return look_at(_frames(name, seed), eyes(target_named("nested"), lens_of(name)), whole=False)


REAL: Final = Case(_plan, partial(summed, figures=_near_and_far))
"""Posed, wrong, errors and NEES of four programs on images of six cameras."""
PUBLISHED: Final = Case(_plan_published, summed)
"""Wrong poses among some 10,000 that were published, from images of six cameras."""
