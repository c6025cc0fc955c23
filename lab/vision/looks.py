"""What programs make of images, against the truth: one judge and one set of figures for every campaign."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final, Protocol

import numpy as np
import numpy.typing as npt

from lab.vision.flight import LOOKING_DOWN, FlightFrame
from lab.vision.parts import Part
from lab.vision.stills import WRONG_DEG, WRONG_M, error_of
from mkdaemon.vision.camera.calibration_file import Intrinsics
from mkdaemon.vision.tags.tagmap import TagMap, Target
from mkdaemon.vision.track.follower import TargetPose
from mkdaemon.vision.track.tracker import Tracker

Array = npt.NDArray[np.float64]
Program = Callable[[FlightFrame], "Look"]
SHARE_M: Final = 0.01
"""A pose is wrong beyond 5 cm and this share of the distance, or 5 degrees."""
WITH, WITHOUT = "eyes_with_attitude", "eyes_without"
"""The eyes as programs."""


class Shown(Protocol):
    """An image whose truth is known."""

    @property
    def rotation(self) -> Array:
        """Camera from target `(3, 3)`."""

    @property
    def position(self) -> Array:
        """Of the target `(3,)` [m; RDF]."""


@dataclass(frozen=True, slots=True)
class Look:
    """What one program made of one image.

    Attributes:
        distance: true distance [m].
        posed: whether there was a pose.
        wrong: beyond 5 cm and 1 % of the distance, or 5 degrees.
        off: distance of the position from the truth [m].
        turned: angle from the truth [deg].
        nees: of the measurement, per degree of freedom, without the calibration floor, as the lens is known exactly
            here.
    """

    distance: float
    posed: bool = False
    wrong: bool = False
    off: float = np.nan
    turned: float = np.nan
    nees: float = np.nan


def look(shown: Shown, found: TargetPose | None) -> Look:
    """What the eyes made of an image, against the truth."""
    distance = float(np.linalg.norm(shown.position))
    if found is None:
        return Look(distance)
    pose = found.pose
    error = error_of(pose.rotation, pose.position, shown.rotation, shown.position)
    vector = np.array([*error.xyz, *error.rpy])
    nees = float(vector @ np.linalg.solve(pose.covariance, vector)) / 6
    wrong = error.distance > max(WRONG_M, SHARE_M * distance) or error.angle_deg > WRONG_DEG
    return Look(distance, True, wrong, error.distance, error.angle_deg, nees)


def eyes(target: Target, lens: Intrinsics) -> dict[str, Program]:
    """The eyes behind a lens, with attitude and without."""
    tags = TagMap((target,))
    trackers = {WITH: Tracker(tags, lens, LOOKING_DOWN), WITHOUT: Tracker(tags, lens)}

    def program(tracker: Tracker) -> Program:
        return lambda frame: look(frame, tracker.update(frame.image, frame.attitude).pose_of(target.name))

    return {name: program(tracker) for name, tracker in trackers.items()}


def look_at(
    frames: Iterable[FlightFrame], programs: Mapping[str, Program], *, whole: bool = True
) -> dict[str, list[Look]]:
    """What programs make of a flight.

    Args:
        frames: of the flight.
        programs: see every image.
        whole: only images that show the whole target count.
    """
    looks: dict[str, list[Look]] = {program: [] for program in programs}
    for frame in frames:
        for name, program in programs.items():
            found = program(frame)
            if not whole or frame.in_view == 1.0:
                looks[name].append(found)
    return looks


def figures(looks: Sequence[Look]) -> dict[str, Any]:
    """Counts and errors of what one program made of some images."""
    posed = [one for one in looks if one.posed]
    row: dict[str, Any] = {"images": len(looks), "posed": len(posed), "wrong": sum(one.wrong for one in posed)}
    if posed:
        off, turned, nees = ([getattr(one, name) for one in posed] for name in ("off", "turned", "nees"))
        row |= {
            "median_cm": round(100 * float(np.median(off)), 3),
            "median_deg": round(float(np.median(turned)), 3),
            "largest_cm": round(100 * max(off), 2),
            "largest_deg": round(max(turned), 2),
            "nees_mean": round(float(np.mean(nees)), 2),
            "nees_median": round(float(np.median(nees)), 2),
        }
    return row


def summed(
    figures: Callable[[Sequence[Look]], dict[str, Any]],
    _quick: bool,
    parts: Sequence[Part],
    found: Sequence[Mapping[str, Sequence[Look]]],
) -> dict[str, Any]:
    """Figures by the first argument of the parts and by program, and seeds, the last one, with a wrong pose."""
    rows: dict[str, Any] = {}
    for name in dict.fromkeys(part.args[0] for part in parts):
        flights = [(part.args[-1], looks) for part, looks in zip(parts, found, strict=True) if part.args[0] == name]
        rows[name] = {
            program: figures([one for _, looks in flights for one in looks[program]])
            | {"wrong_seeds": [seed for seed, looks in flights if any(one.wrong for one in looks[program])]}
            for program in flights[0][1]
        }
    return rows
