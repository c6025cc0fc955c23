"""What must never be published: wrong poses and mirrored ones, on flights and on single views."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from lab.vision.flight import LOOKING_DOWN, VGA, fly
from lab.vision.parts import Case, Part, in_parts
from lab.vision.stills import SeedSet, Studio, error_of, is_flip, look_once, target_named
from mkdaemon.vision.pose.pose import Pose
from mkdaemon.vision.tags.tagmap import TagMap
from mkdaemon.vision.track.tracker import Tracker

Array = npt.NDArray[np.float64]

ATTITUDES: Final = {True: "with_attitude", False: "without_attitude"}


@dataclass(slots=True)
class Tally:
    """Counts of one campaign, or of a part of it.

    Attributes:
        frames: asked, by trouble.
        posed: published, by trouble.
        wrong: published beyond 5 cm or 5 degrees.
        flips: published mirrored.
        distance: 3-D errors [m].
        angle: angle errors [deg].
    """

    frames: Counter[str] = field(default_factory=Counter)
    posed: Counter[str] = field(default_factory=Counter)
    wrong: int = 0
    flips: int = 0
    distance: list[float] = field(default_factory=list)
    angle: list[float] = field(default_factory=list)

    def add(self, pose: Pose | None, rotation: Array, position: Array, trouble: str) -> None:
        """Compare one frame's pose with the truth."""
        self.frames[trouble or "none"] += 1
        if pose is None:
            return
        self.posed[trouble or "none"] += 1
        error = error_of(pose.rotation, pose.position, rotation, position)
        self.distance.append(error.distance)
        self.angle.append(error.angle_deg)
        self.wrong += error.is_wrong
        self.flips += is_flip(pose.rotation, pose.position, rotation)

    @classmethod
    def together(cls, tallies: Sequence[Tally]) -> Tally:
        """Several parts as one."""
        whole = cls()
        for one in tallies:
            whole.frames += one.frames
            whole.posed += one.posed
            whole.wrong += one.wrong
            whole.flips += one.flips
            whole.distance += one.distance
            whole.angle += one.angle
        return whole

    def summary(self) -> dict[str, Any]:
        """The figures."""
        frames, posed = self.frames.total(), self.posed.total()
        return {
            "frames": frames,
            "published": posed,
            "posed": round(posed / max(frames, 1), 4),
            "wrong": self.wrong,
            "flips": self.flips,
            "median_cm": round(float(np.median(self.distance)) * 100, 4) if posed else None,
            "p99_cm": round(float(np.percentile(self.distance, 99)) * 100, 3) if posed else None,
            "median_deg": round(float(np.median(self.angle)), 4) if posed else None,
            "p99_deg": round(float(np.percentile(self.angle, 99)), 3) if posed else None,
            "posed_by_trouble": {k: round(self.posed[k] / n, 3) for k, n in sorted(self.frames.items())},
        }


def _plan_flights(quick: bool, seeds: SeedSet) -> list[Part]:
    count = 2 if quick else 12
    return [Part(_flight, (name, seeds.base + seed), 240) for name in ("nested", "single") for seed in range(count)]


def _flight(name: str, seed: int) -> dict[bool, Tally]:
    """One flight, seen with and without attitude."""
    target = target_named(name)
    tallies = {True: Tally(), False: Tally()}
    trackers = {key: Tracker(TagMap((target,)), VGA, LOOKING_DOWN) for key in tallies}
    for frame in fly(target, seed):
        for with_attitude, tracker in trackers.items():
            found = tracker.update(frame.image, frame.attitude if with_attitude else None).pose_of(target.name)
            pose = found.pose if found is not None else None
            tallies[with_attitude].add(pose, frame.rotation, frame.position, frame.trouble)
    return tallies


def _sum_up_flights(quick: bool, parts: Sequence[Part], found: Sequence[dict[bool, Tally]]) -> dict[str, Any]:
    out: dict[str, Any] = {"flights": 2 if quick else 12, "seconds": 8, "fps": 30, "range_m": [0.35, 4.5]}
    for name in dict.fromkeys(part.args[0] for part in parts):
        mine = [tallies for part, tallies in zip(parts, found, strict=True) if part.args[0] == name]
        out[name] = {words: Tally.together([t[key] for t in mine]).summary() for key, words in ATTITUDES.items()}
    return out


def _plan_flips(quick: bool, seeds: SeedSet) -> list[Part]:
    views = 500 if quick else 5000
    return [Part(_views, (seeds.base + 500, part, count), count) for part, count in in_parts(views, 125)]


def _views(seed: int, part: int, count: int) -> dict[bool, Tally]:
    """Single images of the single tag, 1 to 12 m, tilted up to 57 degrees, each asked about twice."""
    target = target_named("single")
    studio = Studio(target, seed, fine=False, part=part)
    tallies = {True: Tally(), False: Tally()}
    for _ in range(count):
        rng = studio.rng
        still = studio.shoot(float(rng.uniform(1.0, 12.0)), float(rng.uniform(0, 1.0)))
        for with_attitude, tally in tallies.items():
            found = look_once(still, target, VGA, with_attitude=with_attitude).pose_of(target.name)
            tally.add(found.pose if found is not None else None, still.rotation, still.position, "")
    return tallies


def _sum_up_flips(_quick: bool, _parts: Sequence[Part], found: Sequence[dict[bool, Tally]]) -> dict[str, Any]:
    whole = {key: Tally.together([tallies[key] for tallies in found]) for key in ATTITUDES}
    return {
        "range_m": [1, 12],
        "tilt_deg": [0, 57],
        **{words: whole[key].summary() for key, words in ATTITUDES.items()},
        "asked": sum(tally.frames.total() for tally in whole.values()),
        "published": sum(tally.posed.total() for tally in whole.values()),
        "flipped": sum(tally.flips for tally in whole.values()),
    }


FLIGHTS: Final = Case(_plan_flights, _sum_up_flights)
"""Twelve random flights of 8 s at 30 fps with every trouble: share posed, wrong poses, flips."""
FLIPS: Final = Case(_plan_flips, _sum_up_flips)
"""Single images at all distances, with attitude and without: mirrored poses published."""
