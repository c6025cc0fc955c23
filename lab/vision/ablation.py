"""What every gate, fit, search and memory of the tracker earns: the same images with one of them switched off.

Each is switched off by the limits handed to the tracker, nothing is patched. Images are rendered once and shown to all
variants, so that differences are counted image by image: `lost` are posed by the whole pipeline only, `won` by the
variant only. Of n images that differ, chance makes a difference of sqrt(n); `noise` is twice that.
"""

from __future__ import annotations

import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Final

import numpy as np

from lab.campaign import Part, run_parts
from lab.vision.ablationscenes import FLOWN, SCENES, Setting, View, by_scene, settings, views
from lab.vision.stills import SeedSet, error_of, target_named
from lab.vision.variants import VARIANTS, WHOLE, Variant
from mkdaemon.vision.pose.pose import Pose
from mkdaemon.vision.tags.tagmap import TagMap
from mkdaemon.vision.track.attitude import LOOKING_DOWN
from mkdaemon.vision.track.tracker import Tracker

KNOWLEDGE: Final = {True: "with attitude", False: "without"}
"""What was known of an image."""


@dataclass(slots=True)
class Score:
    """What one variant made of the images of a scene.

    Attributes:
        posed: whether each image was posed.
        distance: errors of the posed ones [m].
        angle: and of their angles [deg].
        wrong: posed beyond 5 cm and 1 % of the range, or 5 degrees.
        seconds: of one core.
    """

    posed: list[bool] = field(default_factory=list)
    distance: list[float] = field(default_factory=list)
    angle: list[float] = field(default_factory=list)
    wrong: int = 0
    seconds: float = 0.0

    def add(self, pose: Pose | None, view: View) -> None:
        """Compare one pose with the truth."""
        self.posed.append(pose is not None)
        if pose is None:
            return
        error = error_of(pose.rotation, pose.position, view.rotation, view.position)
        self.distance.append(error.distance)
        self.angle.append(error.angle_deg)
        too_far = error.distance > max(0.05, 0.01 * float(np.linalg.norm(view.position)))
        self.wrong += too_far or error.angle_deg > 5.0

    def extend(self, other: Score) -> None:
        """Add the images of another part."""
        self.posed += other.posed
        self.distance += other.distance
        self.angle += other.angle
        self.wrong += other.wrong
        self.seconds += other.seconds

    def against(self, whole: Score) -> dict[str, Any]:
        """The figures, and how they differ from the whole pipeline's."""
        mine, theirs = np.array(self.posed), np.array(whole.posed)
        lost, won = int((theirs & ~mine).sum()), int((mine & ~theirs).sum())
        return {
            "posed": round(float(mine.mean()), 4),
            "lost": lost,
            "won": won,
            "noise": round(2.0 * float(np.sqrt(lost + won)), 1),
            "wrong": self.wrong,
            "median_cm": _median(self.distance, 100.0),
            "p95_cm": _percentile(self.distance, 95, 100.0),
            "median_deg": _median(self.angle, 1.0),
            "p95_deg": _percentile(self.angle, 95, 1.0),
            "ms": round(1000.0 * self.seconds / max(len(mine), 1), 2),
        }


def plan(quick: bool, seeds: SeedSet, variants: Sequence[Variant] = VARIANTS) -> list[Part]:
    """The parts of the campaign; every scene is seen with attitude and without.

    Args:
        quick: a fraction of the images.
        seeds: which scenes.
        variants: what is switched off.
    """
    return [Part(look, (setting, variants), setting.images) for setting in settings(quick, seeds)]


def look(setting: Setting, variants: Sequence[Variant]) -> dict[tuple[str, bool], Score]:
    """The images of a setting, seen by every variant: scores by its name and whether the attitude was known."""
    target = target_named(setting.target)
    taken_for = {False: target, True: replace(target, bend=0.0)}
    trackers = {
        (v.name, known): Tracker(
            TagMap((taken_for[v.is_flat],)), setting.lens, LOOKING_DOWN, v.tracker, v.detector, v.limits
        )
        for v in (WHOLE, *variants)
        for known in (True, False)
    }
    scores = {key: Score() for key in trackers}
    for view in views(setting):
        for key, tracker in trackers.items():
            if not setting.is_flight:
                tracker.reset()
            attitude = view.attitude if key[1] else None
            start = time.process_time()
            found = None
            for turn in range(view.looks):
                # one pixel in the corner changes: equal images would be those of a frozen camera
                view.image.pixels[0, 0] ^= turn & 1
                found = found or tracker.update(view.image, attitude).pose_of(target.name)
            scores[key].seconds += time.process_time() - start
            scores[key].add(found.pose if found is not None else None, view)
    return scores


def run(quick: bool, seeds: SeedSet, jobs: int = 1, variants: Sequence[Variant] = VARIANTS) -> dict[str, Any]:
    """Run the campaign.

    Args:
        quick: a fraction of the images.
        seeds: which scenes.
        jobs: processes; the figures but the times do not depend on it.
        variants: what is switched off.
    """
    parts = plan(quick, seeds, variants)
    results: list[dict[tuple[str, bool], Score]] = run_parts("ablation", parts, jobs)
    whole = _by_scene(parts, results, WHOLE)
    return {
        "images": by_scene([part.args[0] for part in parts]),
        "whole": {scene: score.against(score) for scene, score in whole.items()},
        "without": [
            {
                "name": variant.name,
                "kind": variant.kind,
                "what": variant.what,
                **{s: score.against(whole[s]) for s, score in _by_scene(parts, results, variant).items()},
            }
            for variant in variants
        ],
    }


def table(figures: dict[str, Any]) -> str:
    """The figures as Markdown: images lost and won, followed and first ones, and all wrong poses.

    Args:
        figures: of `run`.
    """
    whole, images = figures["whole"], figures["images"]
    kinds = {"followed": FLOWN, "first": tuple(scene for scene in SCENES if scene not in FLOWN)}
    counts = {kind: sum(images[scene] for scene in scenes) for kind, scenes in kinds.items()}
    columns = {
        f"{kind}, {words}": [f"{scene} {words}" for scene in scenes if images[scene]]
        for kind, scenes in kinds.items()
        for words in KNOWLEDGE.values()
    }
    posed = [sum(images[s.split()[0]] * whole[s]["posed"] for s in scenes) for scenes in columns.values()]
    shares = [f"{100 * n / max(counts[c.split(',')[0]], 1):.1f} %" for c, n in zip(columns, posed, strict=True)]
    lines = [
        "| without | " + " | ".join(f"{c} ({counts[c.split(',')[0]]})" for c in columns) + " | wrong | time |",
        "|---|" + "---|" * (len(columns) + 2),
        "| nothing: posed | " + " | ".join(shares) + f" | {_wrong(whole, whole)} | |",
    ]
    for row in figures["without"]:
        cells = [_difference(row, scenes) for scenes in columns.values()]
        longer = 100 * (_mean_ms(row, whole) / _mean_ms(whole, whole) - 1)
        lines.append(f"| {row['name']} | " + " | ".join(cells) + f" | {_wrong(row, whole)} | {longer:+.0f} % |")
    return "\n".join(lines)


def _difference(row: dict[str, Any], scenes: Sequence[str]) -> str:
    lost, won = (sum(row[scene][what] for scene in scenes) for what in ("lost", "won"))
    return " ".join(f"{sign}{count}" for sign, count in (("-", lost), ("+", won)) if count) or "0"


def _wrong(row: dict[str, Any], scenes: Iterable[str]) -> int:
    return sum(row[scene]["wrong"] for scene in scenes)


def _mean_ms(row: dict[str, Any], scenes: Iterable[str]) -> float:
    return float(np.mean([row[scene]["ms"] for scene in scenes]))


def _by_scene(
    parts: Sequence[Part], results: Sequence[dict[tuple[str, bool], Score]], variant: Variant
) -> dict[str, Score]:
    """Scores by scene and attitude."""
    found: dict[str, Score] = {}
    for part, scores in zip(parts, results, strict=True):
        for known, words in KNOWLEDGE.items():
            found.setdefault(f"{part.args[0].scene} {words}", Score()).extend(scores[variant.name, known])
    return found


def _median(values: Sequence[float], scale: float) -> float | None:
    return _percentile(values, 50, scale)


def _percentile(values: Sequence[float], share: float, scale: float) -> float | None:
    return round(scale * float(np.percentile(values, share)), 4) if values else None
