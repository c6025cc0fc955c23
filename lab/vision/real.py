"""Cameras as they are: tone curve, colour mosaic, sharpening, JPEG, rolling shutter, vibration, little light.

The same images go through the tracker with and without attitude, through plain AprilTag and through OpenCV.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache, partial
from math import radians
from typing import Any, Final

import cv2
import numpy as np
import numpy.typing as npt

from lab.vision.flight import LOOKING_DOWN, VGA, Device, FlightFrame, fly
from lab.vision.parts import Case, Part
from lab.vision.stills import SeedSet, error_of, target_named
from mkdaemon.vision.camera.calibration_file import Intrinsics
from mkdaemon.vision.pose.pose import Pose, solve, with_floor
from mkdaemon.vision.pose.projection import Projection
from mkdaemon.vision.tags.cellread import Detection
from mkdaemon.vision.tags.detector import find_codes
from mkdaemon.vision.tags.tagmap import TagMap, Target
from mkdaemon.vision.track.follower import TargetPose
from mkdaemon.vision.track.tracker import Tracker
from mksim.scene.light import LightConditions
from mksim.scene.processing import Processing

Array = npt.NDArray[np.float64]
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


@dataclass(frozen=True, slots=True)
class Look:
    """What one program made of one image.

    Attributes:
        distance: true distance [m].
        posed: whether there was a pose.
        wrong: beyond 5 cm and 1 % of the distance, or 5 degrees.
        off: distance of the position from the truth [m].
        turned: angle from the truth [deg].
        farther: measured distance over the true one, less 1.
        nees: of the measurement, per degree of freedom, without the calibration floor, as the lens is known exactly
            here; NaN for programs that give no covariance.
        nees_published: of the published covariance, which has that floor in it.
    """

    distance: float
    posed: bool = False
    wrong: bool = False
    off: float = np.nan
    turned: float = np.nan
    farther: float = np.nan
    nees: float = np.nan
    nees_published: float = np.nan


def _plan(quick: bool, seeds: SeedSet) -> list[Part]:
    flights = 1 if quick else 6
    return [Part(_fly, (name, seeds.base + 1300 + k), int(30 * SECONDS)) for name in DEVICES for k in range(flights)]


def _fly(name: str, seed: int) -> dict[str, list[Look]]:
    """One flight through all programs."""
    device, target = DEVICES[name], target_named("nested")
    frames = fly(target, seed, seconds=SECONDS, near=NEAR_M, far=FAR_M, troubled=False, device=device)
    return look_at(frames, target, VGA.model_copy(update={"line_time": device.line_time}))


def look_at(frames: Iterable[FlightFrame], target: Target, lens: Intrinsics) -> dict[str, list[Look]]:
    """What the eyes with and without attitude, AprilTag and OpenCV make of the images that show a whole target.

    Args:
        frames: of one flight.
        target: what is seen.
        lens: what all of them believe it to be.
    """
    eyes, projection = _eyes(target, lens), Projection(lens)
    plain: dict[str, Callable[[Grey], list[Detection]]] = {
        "apriltag": partial(find_codes, (FAMILY,)),
        "opencv": find_by_opencv,
    }
    looks: dict[str, list[Look]] = {program: [] for program in (*eyes, *plain)}
    for frame in frames:
        posed = {
            program: tracker.update(frame.image, frame.attitude).pose_of(target.name)
            for program, tracker in eyes.items()
        }
        if frame.in_view < 1.0:
            continue
        for program, found in posed.items():
            looks[program].append(_eyes_look(frame, found))
        for program, search in plain.items():
            looks[program].append(_plain_look(frame, target, search(frame.image.pixels), projection))
    return looks


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


def _eyes(target: Target, lens: Intrinsics) -> dict[str, Tracker]:
    """Trackers behind a lens, with attitude and without."""
    tags = TagMap((target,))
    return {"eyes_with_attitude": Tracker(tags, lens, LOOKING_DOWN), "eyes_without": Tracker(tags, lens)}


def _eyes_look(frame: FlightFrame, found: TargetPose | None) -> Look:
    if found is None:
        return Look(float(np.linalg.norm(frame.position)))
    return _look(frame, found.pose.rotation, found.pose.position, found.pose)


def _plain_look(frame: FlightFrame, target: Target, found: Sequence[Detection], projection: Projection) -> Look:
    """The better of both solutions of the corners, as a program without a track takes it."""
    own = {tag.code: tag for tag in target.tags}
    pairs = [(own[tag.code], tag) for tag in found if tag.code in own]
    poses = solve(pairs, projection) if pairs else []
    if not poses:
        return Look(float(np.linalg.norm(frame.position)))
    return _look(frame, poses[0].rotation, poses[0].position, None)


def _look(frame: FlightFrame, rotation: Array, position: Array, measured: Pose | None) -> Look:
    """A pose against the truth."""
    error = error_of(rotation, position, frame.rotation, frame.position)
    distance = float(np.linalg.norm(frame.position))
    nees = published = float("nan")
    if measured is not None:
        vector = np.array([*error.xyz, *error.rpy])
        nees = float(vector @ np.linalg.solve(measured.covariance, vector)) / 6
        published = float(vector @ np.linalg.solve(with_floor(measured), vector)) / 6
    wrong = error.distance > max(0.05, 0.01 * distance) or error.angle_deg > 5.0
    farther = float(np.linalg.norm(position)) / distance - 1.0
    return Look(distance, True, wrong, error.distance, error.angle_deg, farther, nees, published)


def _sum_up(_quick: bool, parts: Sequence[Part], found: Sequence[dict[str, list[Look]]]) -> dict[str, Any]:
    rows: dict[str, Any] = {}
    for name in DEVICES:
        flights = [looks for part, looks in zip(parts, found, strict=True) if part.args[0] == name]
        rows[name] = {
            program: dict(_figures([look for flight in flights for look in flight[program]])) for program in flights[0]
        }
    return rows


def _figures(looks: list[Look]) -> Iterator[tuple[str, Any]]:
    """Shares near and far, and errors of what was posed."""
    for title, some in (
        ("to_4_m", [look for look in looks if look.distance <= MIDDLE_M]),
        ("to_8_m", [look for look in looks if look.distance > MIDDLE_M]),
    ):
        posed = [look for look in some if look.posed]
        row: dict[str, Any] = {"images": len(some), "posed": len(posed), "wrong": sum(look.wrong for look in posed)}
        if posed:
            row["median_cm"] = round(100 * float(np.median([look.off for look in posed])), 3)
            row["median_deg"] = round(float(np.median([look.turned for look in posed])), 3)
            row["range_bias_percent"] = round(100 * float(np.median([look.farther for look in posed])), 3)
            nees = np.array([(look.nees, look.nees_published) for look in posed])
            if not np.isnan(nees).any():
                row["nees_mean"], row["nees_published_mean"] = (round(float(mean), 2) for mean in nees.mean(axis=0))
                row["nees_median"] = round(float(np.median(nees[:, 0])), 2)
        yield title, row


def tally(parts: Sequence[Part], found: Sequence[dict[str, list[Look]]], word: str) -> dict[str, Any]:
    """Images, poses (under `word`) and wrong ones by the first argument of the parts, and by program."""
    rows: dict[str, Any] = {}
    for part, flight in zip(parts, found, strict=True):
        for program, looks in flight.items():
            row = rows.setdefault(part.args[0], {}).setdefault(program, {"images": 0, word: 0, "wrong": 0})
            row["images"] += len(looks)
            row[word] += sum(look.posed for look in looks)
            row["wrong"] += sum(look.wrong for look in looks)
    return rows


def _plan_published(quick: bool, seeds: SeedSet) -> list[Part]:
    flights = 1 if quick else 15
    return [
        Part(_publish, (name, seeds.base + 1400 + k), int(30 * SECONDS)) for k in range(flights) for name in DEVICES
    ]


def _publish(name: str, seed: int) -> dict[str, list[Look]]:
    """All that is published in one flight, tags that are cut by the image's edge included."""
    target = target_named("nested")
    eyes = _eyes(target, VGA.model_copy(update={"line_time": DEVICES[name].line_time}))
    looks: dict[str, list[Look]] = {program: [] for program in eyes}
    for frame in fly(target, seed, seconds=SECONDS, near=NEAR_M, far=FAR_M, troubled=False, device=DEVICES[name]):
        for program, tracker in eyes.items():
            look = _eyes_look(frame, tracker.update(frame.image, frame.attitude).pose_of(target.name))
            looks[program].append(look)
    return looks


def _sum_up_published(_quick: bool, parts: Sequence[Part], found: Sequence[dict[str, list[Look]]]) -> dict[str, Any]:
    rows = tally(parts, found, "published")
    for part, flight in zip(parts, found, strict=True):
        for program, looks in flight.items():
            wrong_in = rows[part.args[0]][program].setdefault("wrong_flights", [])
            wrong_in += [part.args[1]] if any(look.wrong for look in looks) else []
    every = [row for programs in rows.values() for row in programs.values()]
    return {
        "by_camera": rows,
        "published": sum(row["published"] for row in every),
        "wrong": sum(row["wrong"] for row in every),
    }


REAL: Final = Case(_plan, _sum_up)
"""Posed, wrong, errors and NEES of four programs on images of six cameras."""
PUBLISHED: Final = Case(_plan_published, _sum_up_published)
"""Wrong poses among some 10,000 that were published, from images of six cameras."""
