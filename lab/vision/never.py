"""What must never be published: wrong poses and mirrored ones, on flights and on single views."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any, Final, NamedTuple

import numpy as np

from lab.vision.flight import LOOKING_DOWN, VGA, fly
from lab.vision.looks import Shown
from lab.vision.parts import Case, Part, in_parts
from lab.vision.stills import PoseError, SeedSet, Studio, error_of, is_flip, look_once, target_named
from mkdaemon.vision.tags.tagmap import TagMap
from mkdaemon.vision.track.follower import TargetPose
from mkdaemon.vision.track.tracker import Tracker

ATTITUDES: Final = {"with_attitude": True, "without_attitude": False}


class Seen(NamedTuple):
    """An image: what troubled it, and how far what was published is off; None where nothing was."""

    trouble: str
    error: PoseError | None
    is_flip: bool = False


Looks = Mapping[str, Sequence[Seen]]
"""Of a part, by whether the eyes had an attitude."""


def _seen(found: TargetPose | None, shown: Shown, trouble: str = "none") -> Seen:
    """Compare one image's pose with the truth."""
    if found is None:
        return Seen(trouble, None)
    rotation, position = found.pose.rotation, found.pose.position
    error = error_of(rotation, position, shown.rotation, shown.position)
    return Seen(trouble, error, is_flip(rotation, position, shown.rotation))


def summary(seen: Sequence[Seen]) -> dict[str, Any]:
    """The figures; wrong is beyond 5 cm or 5 degrees."""
    errors = [one.error for one in seen if one.error is not None]
    asked, posed = Counter(one.trouble for one in seen), Counter(one.trouble for one in seen if one.error is not None)
    figures: dict[str, Any] = {
        "frames": len(seen),
        "published": len(errors),
        "posed": round(len(errors) / max(len(seen), 1), 4),
        "wrong": sum(error.is_wrong for error in errors),
        "flips": sum(one.is_flip for one in seen),
    }
    for unit, scale, values in (
        ("cm", 100, [error.distance for error in errors]),
        ("deg", 1, [error.angle_deg for error in errors]),
    ):
        figures[f"median_{unit}"] = round(float(np.median(values)) * scale, 4) if values else None
        figures[f"p99_{unit}"] = round(float(np.percentile(values, 99)) * scale, 3) if values else None
    return figures | {"posed_by_trouble": {name: round(posed[name] / n, 3) for name, n in sorted(asked.items())}}


def together(found: Sequence[Looks]) -> dict[str, list[Seen]]:
    """Several parts as one."""
    return {words: [one for looks in found for one in looks[words]] for words in ATTITUDES}


def _plan_flights(quick: bool, seeds: SeedSet) -> list[Part]:
    count = 2 if quick else 12
    return [Part(_flight, (name, seeds.base + seed), 240) for name in ("nested", "single") for seed in range(count)]


def _flight(name: str, seed: int) -> Looks:
    """One flight, seen with and without attitude."""
    target = target_named(name)
    looks: dict[str, list[Seen]] = {words: [] for words in ATTITUDES}
    trackers = {words: Tracker(TagMap((target,)), VGA, LOOKING_DOWN) for words in ATTITUDES}
    for frame in fly(target, seed):
        for words, has_attitude in ATTITUDES.items():
            result = trackers[words].update(frame.image, frame.attitude if has_attitude else None)
            looks[words].append(_seen(result.pose_of(target.name), frame, frame.trouble or "none"))
    return looks


def _sum_up_flights(quick: bool, parts: Sequence[Part], found: Sequence[Looks]) -> dict[str, Any]:
    out: dict[str, Any] = {"flights": 2 if quick else 12, "seconds": 8, "fps": 30, "range_m": [0.35, 4.5]}
    for name in dict.fromkeys(part.args[0] for part in parts):
        whole = together([looks for part, looks in zip(parts, found, strict=True) if part.args[0] == name])
        out[name] = {words: summary(seen) for words, seen in whole.items()}
    return out


def _plan_flips(quick: bool, seeds: SeedSet) -> list[Part]:
    views = 500 if quick else 5000
    return [Part(_views, (seeds.base + 500, part, count), count) for part, count in in_parts(views, 125)]


def _views(seed: int, part: int, count: int) -> Looks:
    """Single images of the single tag, 1 to 12 m, tilted up to 57 degrees, each asked about twice."""
    target = target_named("single")
    studio = Studio(target, seed, fine=False, part=part)
    looks: dict[str, list[Seen]] = {words: [] for words in ATTITUDES}
    for _ in range(count):
        rng = studio.rng
        still = studio.shoot(float(rng.uniform(1.0, 12.0)), float(rng.uniform(0, 1.0)))
        for words, has_attitude in ATTITUDES.items():
            found = look_once(still, target, VGA, with_attitude=has_attitude)
            looks[words].append(_seen(found.pose_of(target.name), still))
    return looks


def _sum_up_flips(_quick: bool, _parts: Sequence[Part], found: Sequence[Looks]) -> dict[str, Any]:
    figures = {words: summary(seen) for words, seen in together(found).items()}
    counts = {"asked": "frames", "published": "published", "flipped": "flips"}
    whole = {name: sum(one[of] for one in figures.values()) for name, of in counts.items()}
    return {"range_m": [1, 12], "tilt_deg": [0, 57], **figures, **whole}


FLIGHTS: Final = Case(_plan_flights, _sum_up_flights)
"""Twelve random flights of 8 s at 30 fps with every trouble: share posed, wrong poses, flips."""
FLIPS: Final = Case(_plan_flips, _sum_up_flips)
"""Single images at all distances, with attitude and without: mirrored poses published."""
