"""Poses, refusals and tags of the cameras and sources of a recording, for `mkctl log report --against`.

A recording is untrusted: a value that is no pose is left out.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any, Final

import numpy as np

from mkdaemon.frames import rotation_from_quaternion
from mkdaemon.telemetry.position import report_key
from mkdaemon.view.report.alignment import PoseTrack, TagView
from mkdaemon.view.report.baseline import NO_TAG, OTHER_TAGS, Images
from mkdaemon.view.report.said import number_of, numbers_of, part_of, text_of

FASTEST: Final = 300.0
"""Images a second; more missing numbers than that are no lost images, but another count."""
MOST_IMAGES: Final = 2_000_000
"""Missing images that are counted: 18 hours at 30 a second."""
SAME_IMAGE: Final = 1e-3
"""Values of one image have one stamp; a camera that starts again counts from 1 again [s]."""
OLDEST: Final = 10.0
"""Of a report [s], as its model allows."""
FARTHEST: Final = 1e4
"""A pose beyond it is none [m]."""
MOST_TAGS: Final = 500
"""Of a map."""
BY_REPORT: Final = "report"
"""How a `VisionPose` of a source was measured."""
OWN_FRAME: Final = ""
"""Target of reports that the daemon did not publish as poses: the frame of their source."""
_SIDES: Final = ("fx", "fy", "cx", "cy", "width", "height")
Outcome = tuple[float, int, str]
"""Time [s] and number of an image, and why it gave no pose; empty for a pose."""


@dataclass
class Sights:
    """What one camera or source published.

    Attributes:
        poses: by target, rows of time [s], position, quaternion, latency [s], image.
        refused: by target, time [s], image and reason.
        tagged: images with tags: time [s], image and `OTHER_TAGS`.
        passed_over: images that were dropped or lost, as counted: the first and the last count.
        setup: properties and targets.
        is_source: it is a source of `[[positions]]`: most of its reports are not published, so none is missing.
    """

    poses: dict[str, list[list[float]]] = field(default_factory=lambda: defaultdict(list))
    refused: dict[str, list[Outcome]] = field(default_factory=lambda: defaultdict(list))
    tagged: list[Outcome] = field(default_factory=list)
    passed_over: list[float] = field(default_factory=list)
    setup: Mapping[str, Any] = field(default_factory=dict)
    is_source: bool = False

    def take_pose(self, at: float, fields: Mapping[str, Any]) -> None:
        """Take a `VisionPose`."""
        position = numbers_of(fields, "position_target", 3)
        self.is_source = self.is_source or text_of(fields, "source") == BY_REPORT
        self._keep(text_of(fields, "target"), at, fields, position, "quaternion_target_from_flu", "latency")

    def take_report(self, at: float, fields: Mapping[str, Any]) -> None:
        """Take a `PositionReport`, which is as old as it says when it arrives."""
        self.is_source = True
        age = min(max(number_of(fields, "age") or 0.0, 0.0), OLDEST)
        self._keep(OWN_FRAME, at - age, fields, numbers_of(fields, "position", 3), "quaternion", "age")

    def _keep(
        self, target: str, at: float, fields: Mapping[str, Any], position: list[float], turn: str, late: str
    ) -> None:
        quaternion, image = numbers_of(fields, turn, 4), number_of(fields, "sequence")
        if not position or not quaternion or image is None:
            return
        if max(map(abs, position)) < FARTHEST and 0.5 < math.hypot(*quaternion) < 2.0:
            self.poses[target].append([at, *position, *quaternion, number_of(fields, late) or 0.0, image])

    def take_refused(self, at: float, fields: Mapping[str, Any]) -> None:
        """Take a `PoseRefused`."""
        if (image := number_of(fields, "sequence")) is not None:
            why = text_of(fields, "refusal") or "refused"
            self.refused[text_of(fields, "target")].append((at, int(image), why))

    def take_tags(self, at: float, fields: Mapping[str, Any]) -> None:
        """Take `Tags`."""
        if (image := number_of(fields, "sequence")) is not None:
            self.tagged.append((at, int(image), OTHER_TAGS))

    def take_stats(self, at: float, fields: Mapping[str, Any]) -> None:
        """Take `VisionStats`."""
        count = (number_of(fields, "dropped") or 0.0) + (number_of(fields, "lost") or 0.0)
        self.passed_over = [*self.passed_over[:1], count]

    def take_setup(self, at: float, fields: Mapping[str, Any]) -> None:
        """Take a `CameraSetup`."""
        self.setup = fields

    def track(self, target: str) -> PoseTrack:
        """Poses against a target."""
        rows = np.array(self.poses.get(target, []), dtype=float).reshape(-1, 10)
        rows = rows[np.unique(rows[:, 0], return_index=True)[1]]
        turns = np.array([rotation_from_quaternion((w, x, y, z)) for w, x, y, z in rows[:, 4:8].tolist()])
        return PoseTrack(rows[:, 0], rows[:, 1:4], turns.reshape(-1, 3, 3), rows[:, 8])

    def sight(self, target: str) -> TagView:
        """What is seen; the middle of the target, always in view, where the recording has no setup."""
        lens = [side for name in _SIDES if (side := number_of(self.setup, f"lens.{name}")) is not None]
        w, x, y, z = numbers_of(self.setup, "quaternion_flu_from_cam", 4) or (0.0, 0.0, 0.0, 0.0)
        is_mounted = math.hypot(w, x, y, z) > 0.5
        shapes = part_of(self.setup, "targets")
        prints = [
            corners
            for shape in (shapes if isinstance(shapes, list) else [])
            if text_of(shape, "name") == target and isinstance(part_of(shape, "tags"), list)
            for tag in shape["tags"][:MOST_TAGS]
            if all(corners := [numbers_of(tag, f"corners.{k}", 3) for k in range(4)])
        ]
        tags = np.array(prints or [[[0.0] * 3] * 4], dtype=float)
        normals = np.cross(tags[:, 1] - tags[:, 0], tags[:, 0] - tags[:, 3])
        lengths = np.linalg.norm(normals, axis=1, keepdims=True)
        centres = tags.mean(axis=1)
        return TagView(
            centres=centres,
            normals=np.where(lengths > 0.0, normals / np.maximum(lengths, 1e-12), (0.0, 0.0, 1.0)),
            radii=np.linalg.norm(tags - centres[:, None], axis=2).max(axis=1),
            arm=np.array(numbers_of(self.setup, "position_flu", 3) or np.zeros(3)),
            flu_from_cam=rotation_from_quaternion((w, x, y, z)) if is_mounted else np.eye(3),
            lens=np.array(lens) if is_mounted and len(lens) == len(_SIDES) else None,
            is_fisheye=text_of(self.setup, "lens.model") == "fisheye",
        )

    def images(self, target: str) -> Images:
        """Every image, also those that nothing was published of: their numbers are missing."""
        posed = [(row[0], int(row[9]), "") for row in self.poses.get(target, [])]
        found: list[Outcome] = []
        for row in sorted([*self.tagged, *self.refused.get(target, []), *posed]):
            if found and row[1] == found[-1][1] and row[0] - found[-1][0] < SAME_IMAGE:
                found[-1:] = [row] if not row[2] or found[-1][2] == OTHER_TAGS else found[-1:]
            else:
                found.append(row)
        times, outcomes, missing = [row[0] for row in found], [row[2] for row in found], 0
        for (begin, first, _), (end, last, _) in pairwise(found):
            between = last - first - 1
            if not self.is_source and 0 < between <= min(FASTEST * (end - begin), MOST_IMAGES - missing):
                times += np.linspace(begin, end, between + 2)[1:-1].tolist()
                outcomes += [NO_TAG] * between
                missing += between
        passed_over = max(self.passed_over[-1] - self.passed_over[0], 0.0) if self.passed_over else 0.0
        weight = 1.0 - min(passed_over / max(missing, 1), 1.0)
        order = np.argsort(times, kind="stable")
        weights = np.array([weight if outcome == NO_TAG else 1.0 for outcome in outcomes])
        return Images(np.array(times)[order], [outcomes[k] for k in order], weights[order])


Take = Callable[[Sights, float, Mapping[str, Any]], None]
_TAKES: Final[dict[str, Take]] = {
    "pose": Sights.take_pose,
    "refused": Sights.take_refused,
    "tags": Sights.take_tags,
    "stats": Sights.take_stats,
    "setup": Sights.take_setup,
}
"""By the last part of `vision/<camera>/...`."""


def taken_by(suffix: str) -> tuple[str, Take] | None:
    """Name of the camera or source whose values a key has, and what takes them; None for another key."""
    parts = suffix.split("/")
    if len(parts) != 3:
        return None
    _, name, last = parts
    if suffix == report_key(name):
        return name, Sights.take_report
    return (name, _TAKES[last]) if parts[0] == "vision" and last in _TAKES else None
