"""Cameras as they are: tone curve, colour mosaic, sharpening, JPEG, rolling shutter, vibration, little light.

The same images go through the tracker with and without attitude, through plain AprilTag and through OpenCV.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from math import radians
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from lab.campaign import Case, Part
from lab.vision.flight import VGA, Device, FlightFrame, fly
from lab.vision.stills import SeedSet, error_of, target_named
from mkdaemon.sim.scene.light import Conditions
from mkdaemon.sim.scene.processing import Processing
from mkdaemon.vision.pose.pose import solve, with_floor
from mkdaemon.vision.pose.projection import Projection
from mkdaemon.vision.tags.aruco_fallback import ArucoSearch
from mkdaemon.vision.tags.detection import Detection
from mkdaemon.vision.tags.detector import AprilTagSearch
from mkdaemon.vision.tags.tagmap import TagMap, Target
from mkdaemon.vision.track.attitude import LOOKING_DOWN
from mkdaemon.vision.track.tracker import Tracker

Array = npt.NDArray[np.float64]
Grey = npt.NDArray[np.uint8]

SECONDS: Final = 4.0
NEAR_M, FAR_M, MIDDLE_M = 0.35, 8.0, 4.0
READOUT: Final = 0.030
"""Of all rows of an image [s]: a webcam at 30 images a second."""
VIBRATION: Final = radians(1.0)
RESPONSE: Final = 0.03
"""Of a multirotor's frame to what shakes it [s]."""
TONE: Final = Conditions(processing=Processing(gamma=2.2))
WEBCAM: Final = Conditions(processing=Processing(mosaic=True, denoise=6.0, gamma=2.2, sharpening=0.8), jpeg_quality=85)
DARK: Final = Conditions(exposure=0.15, noise_sd=2.5, processing=Processing(mosaic=True, denoise=4.0, gamma=2.2))
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
        nees: of what was published, per degree of freedom; NaN for programs that publish no covariance.
    """

    distance: float
    posed: bool = False
    wrong: bool = False
    off: float = np.nan
    turned: float = np.nan
    farther: float = np.nan
    nees: float = np.nan


def _plan(quick: bool, seeds: SeedSet) -> list[Part]:
    flights = 1 if quick else 6
    return [Part(_fly, (name, seeds.base + 1300 + k), int(30 * SECONDS)) for name in DEVICES for k in range(flights)]


def _fly(name: str, seed: int) -> dict[str, list[Look]]:
    """One flight through all programs."""
    device, target = DEVICES[name], target_named("nested")
    lens = VGA.model_copy(update={"line_time": device.line_time})
    eyes = {
        "eyes_with_attitude": Tracker(TagMap((target,)), lens, LOOKING_DOWN),
        "eyes_without": Tracker(TagMap((target,)), lens),
    }
    families = tuple({tag.family.name for tag in target.tags})
    april, opencv = AprilTagSearch(families), ArucoSearch(families)
    plain: dict[str, Callable[[Grey], list[Detection]]] = {
        "apriltag": lambda pixels: april.find(pixels, "decimate1"),
        "opencv": lambda pixels: opencv.find(pixels, "decimate1"),
    }
    looks: dict[str, list[Look]] = {program: [] for program in (*eyes, *plain)}
    for frame in fly(target, seed, seconds=SECONDS, near=NEAR_M, far=FAR_M, troubled=False, device=device):
        posed = {
            program: tracker.update(frame.image, frame.attitude).pose_of(target.name)
            for program, tracker in eyes.items()
        }
        if frame.in_view < 1.0:
            continue
        for program, found in posed.items():
            pose = None if found is None else found.pose
            looks[program].append(
                Look(float(np.linalg.norm(frame.position)))
                if pose is None
                else _look(frame, pose.rotation, pose.position, with_floor(pose))
            )
        for program, search in plain.items():
            looks[program].append(_plain_look(frame, target, search(frame.image.pixels)))
    return looks


def _plain_look(frame: FlightFrame, target: Target, found: Sequence[Detection]) -> Look:
    """The better of both solutions of the corners, as a program without a track takes it."""
    own = {(tag.family.name, tag.tag_id): tag for tag in target.tags}
    pairs = [(own[tag.family, tag.tag_id], tag) for tag in found if (tag.family, tag.tag_id) in own]
    poses = solve(pairs, Projection(VGA)) if pairs else []
    if not poses:
        return Look(float(np.linalg.norm(frame.position)))
    return _look(frame, poses[0].rotation, poses[0].position, None)


def _look(frame: FlightFrame, rotation: Array, position: Array, covariance: Array | None) -> Look:
    """A pose against the truth."""
    error = error_of(rotation, position, frame.rotation, frame.position)
    distance = float(np.linalg.norm(frame.position))
    nees = float("nan")
    if covariance is not None:
        vector = np.array([*error.xyz, *error.rpy])
        nees = float(vector @ np.linalg.solve(covariance, vector)) / 6
    wrong = error.distance > max(0.05, 0.01 * distance) or error.angle_deg > 5.0
    farther = float(np.linalg.norm(position)) / distance - 1.0
    return Look(distance, True, wrong, error.distance, error.angle_deg, farther, nees)


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
            nees = [look.nees for look in posed]
            row["nees_mean"] = None if np.isnan(nees).any() else round(float(np.mean(nees)), 2)
        yield title, row


REAL: Final = Case(_plan, _sum_up)
"""Posed, wrong, errors and NEES of four programs on images of six cameras."""
