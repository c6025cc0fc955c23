"""Targets that do not lie as the vehicle's attitude says: tilted and rocking decks, and an attitude that is wrong."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import radians
from typing import Any, Final

import numpy as np

from lab.vision.flight import LEVEL, LOOKING_DOWN, VGA, fly
from lab.vision.parts import Case, Part
from lab.vision.stills import SeedSet, error_of, target_named
from mkdaemon.vision.pose.pose import with_floor
from mkdaemon.vision.tags.tagmap import TagMap
from mkdaemon.vision.track.attitude import AttitudeHistory, AttitudeSample
from mkdaemon.vision.track.tracker import Tracker
from mksim.scene.motion import Platform

Report = Callable[[AttitudeSample], AttitudeSample]
"""What a vehicle makes of its attitude."""
SECONDS: Final = 4.0
TILT: Final = radians(4.0)
BIAS: Final = radians(5.0)
JUMP: Final = radians(6.0)
JUMPS_AT: Final = SECONDS / 2
"""Since take-off [s]."""


@dataclass(frozen=True, slots=True)
class Lie:
    """How a target lies, and how the attitude is wrong."""

    deck: Platform = LEVEL
    report: Report = lambda sample: sample


LIES: Final = {
    "level": Lie(),
    "tilted": Lie(Platform(roll=TILT, pitch=-0.75 * TILT)),
    "rocking": Lie(Platform(rocking=TILT)),
    "attitude_biased": Lie(report=lambda s: AttitudeSample(s.time, s.roll + BIAS, s.pitch, s.yaw)),
    "attitude_jumps": Lie(
        report=lambda s: AttitudeSample(s.time, s.roll + (JUMP if s.time > JUMPS_AT else 0.0), s.pitch, s.yaw)
    ),
    "roll_sign_swapped": Lie(report=lambda s: AttitudeSample(s.time, -s.roll, s.pitch, s.yaw)),
    "both_signs_swapped": Lie(report=lambda s: AttitudeSample(s.time, -s.roll, -s.pitch, s.yaw)),
}
"""Decks of 4 degrees, and attitudes that are wrong from the start or from the middle of a flight on."""


@dataclass(frozen=True, slots=True)
class Look:
    """One image.

    Attributes:
        posed: whether it was.
        wrong: posed beyond 5 cm and 1 % of the range, or 5 degrees.
        nees: of the measurement, per degree of freedom, as the lens is known exactly.
        nees_published: of the published covariance, which has the floor of a calibration in it.
    """

    posed: bool
    wrong: bool = False
    nees: float = 0.0
    nees_published: float = 0.0


def _plan(quick: bool, seeds: SeedSet) -> list[Part]:
    flights = 1 if quick else 6
    images = int(30 * SECONDS)
    return [
        Part(_fly, (f"{name}_{target}", name, target, seeds.base + 1200 + k), images)
        for name in LIES
        for target in ("nested", "single")
        for k in range(flights)
    ]


def _fly(_row: str, name: str, target_name: str, seed: int) -> list[Look]:
    lie, target = LIES[name], target_named(target_name)
    tracker = Tracker(TagMap((target,)), VGA, LOOKING_DOWN)
    looks = []
    for frame in fly(target, seed, seconds=SECONDS, deck=lie.deck):
        reported = AttitudeHistory(lie.report(sample) for sample in frame.attitude.samples)
        found = tracker.update(frame.image, reported).pose_of(target.name)
        if frame.in_view < 1.0:
            continue
        if found is None:
            looks.append(Look(posed=False))
            continue
        error = error_of(found.pose.rotation, found.pose.position, frame.rotation, frame.position)
        vector = np.array([*error.xyz, *error.rpy])
        nees, published = (
            float(vector @ np.linalg.solve(covariance, vector)) / 6
            for covariance in (found.pose.covariance, with_floor(found.pose))
        )
        too_far = error.distance > max(0.05, 0.01 * float(np.linalg.norm(frame.position)))
        looks.append(Look(True, too_far or error.angle_deg > 5.0, nees, published))
    return looks


def _sum_up(_quick: bool, parts: Sequence[Part], found: Sequence[list[Look]]) -> dict[str, Any]:
    rows: dict[str, Any] = {}
    for row in dict.fromkeys(part.args[0] for part in parts):
        looks = [look for part, looks in zip(parts, found, strict=True) if part.args[0] == row for look in looks]
        posed = [look for look in looks if look.posed]
        nees = [look.nees for look in posed]
        rows[row] = {
            "images": len(looks),
            "posed": round(len(posed) / len(looks), 4),
            "wrong": sum(look.wrong for look in looks),
            "nees_mean": round(float(np.mean(nees)), 2) if nees else None,
            "nees_median": round(float(np.median(nees)), 2) if nees else None,
            "nees_p95": round(float(np.percentile(nees, 95)), 2) if nees else None,
            "nees_published_mean": round(float(np.mean([look.nees_published for look in posed])), 2) if nees else None,
        }
    return rows


DECKS: Final = Case(_plan, _sum_up)
"""Posed, wrong and NEES where target and attitude disagree; images with the whole target in view."""
