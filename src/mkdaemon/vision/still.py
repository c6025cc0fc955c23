"""Tags and poses of single images, and how they are drawn: nothing is known before, what is doubtful says so."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Final

import cv2
import numpy as np

from mkdaemon.config.vision import TrackerSection
from mkdaemon.telemetry.vision import PoseRefusal
from mkdaemon.vision.arrays import Array, Grey
from mkdaemon.vision.camera.calibration_file import Intrinsics
from mkdaemon.vision.camera.image import in_light
from mkdaemon.vision.limits import HALF, LIMITS
from mkdaemon.vision.pose.ambiguity import evidence, residual_ratio
from mkdaemon.vision.pose.fitting import TargetFitter
from mkdaemon.vision.pose.gates import fit_refusal
from mkdaemon.vision.pose.pose import FLOOR_RANGE, Pose, angle_between, solve
from mkdaemon.vision.pose.projection import NEAR_M, Projection
from mkdaemon.vision.tags.cellread import Detection
from mkdaemon.vision.tags.detector import Detector, Look
from mkdaemon.vision.tags.tagfamily import find_family
from mkdaemon.vision.tags.tagmap import TagMap, Target, single

ANY_ID_FALSE_RATE = 2e-6
"""Chance that a random quad reads as one of 587 codes, one bit corrected; the limit of few codes refuses that bit."""
WHOLE_TAGS: Final = (Look("grey"), Look("log"), Look("light", decimate=2))
"""The searches of a still; a broken outline needs a track or an attitude to be trusted."""


@dataclass(frozen=True, slots=True, eq=False)
class StillPose:
    """A pose from one image alone, camera from target.

    Attributes:
        ambiguity: residual of the mirrored pose over this one; infinite without a rival.
        ambiguous: nothing in the image tells this pose from its mirror; it would not be published in flight.
        refusal: the gate it fails; none when it passes all.
    """

    target: str
    pose: Pose
    ambiguity: float
    ambiguous: bool
    refusal: PoseRefusal | None


@dataclass(frozen=True, slots=True, eq=False)
class StillTag:
    """A decoded tag, and its own pose where tags stand alone."""

    found: Detection
    pose: StillPose | None


@dataclass(frozen=True, slots=True, eq=False)
class StillResult:
    """Everything one image gave: tags, the largest first, and poses of the targets."""

    tags: tuple[StillTag, ...]
    poses: tuple[StillPose, ...]


class StillEye:
    """Looks at images one by one: for targets, or for tags that stand alone, of some families and codes.

    Without the lens of an image, or a size [m] of tags that stand alone, there are no poses.

    Raises:
        VisionError: unknown family or id.
        ConfigError: an implausible tag size.
    """

    def __init__(
        self,
        *,
        tagmap: TagMap | None = None,
        tag_size: float | None = None,
        families: Sequence[str] = ("tag36h11",),
        ids: Iterable[int] | None = None,
    ) -> None:
        self._tagmap, self._tag_size, self._cfg = tagmap, tag_size, TrackerSection()
        self._fitters: dict[tuple[str, Intrinsics, float], TargetFitter] = {}
        wanted = None if ids is None else frozenset(ids)
        alone = {name: wanted or frozenset(range(find_family(name).ids)) for name in families}
        max_chance = LIMITS.read.max_chance if tagmap is not None or wanted else ANY_ID_FALSE_RATE
        self.detector = Detector(alone if tagmap is None else tagmap.whitelist, max_chance=max_chance)
        if tag_size is not None:
            single(tag_size, 0)  # says what is wrong with the size before any image

    def look(self, pixels: Grey, intrinsics: Intrinsics | None = None) -> StillResult:
        """Find everything in `(h, w)` uint8, taken by a lens."""
        pixels = pixels if intrinsics is None else in_light(pixels, intrinsics.gamma)
        found = self._search(pixels)
        if self._tagmap is None:
            poses = alone = [self._alone(pixels, tag, intrinsics) for tag in found]
        else:
            poses = [self._pose(pixels, target, found, intrinsics) for target in self._tagmap.targets]
            alone = [None] * len(found)
        return StillResult(tuple(map(StillTag, found, alone)), tuple(pose for pose in poses if pose is not None))

    def _search(self, pixels: Grey) -> list[Detection]:
        """The searches for unbroken quads, the finest first; each adds what the ones before did not see."""
        found: list[Detection] = []
        for look in WHOLE_TAGS:
            for tag in self.detector.search_all(pixels, *look):
                middle = tag.corners.mean(axis=0)
                known = (other.corners.mean(axis=0) for other in found if other.code == tag.code)
                if all(np.linalg.norm(middle - other) > HALF * tag.side_px for other in known):
                    found.append(tag)
        return sorted(found, key=lambda tag: -tag.side_px)

    def _alone(self, pixels: Grey, found: Detection, intrinsics: Intrinsics | None) -> StillPose | None:
        if self._tag_size is None:
            return None
        target = single(self._tag_size, found.tag_id, family=found.family)
        return self._pose(pixels, replace(target, name=f"{found.family}:{found.tag_id}"), [found], intrinsics)

    def _pose(
        self, pixels: Grey, target: Target, found: Sequence[Detection], intrinsics: Intrinsics | None
    ) -> StillPose | None:
        """The best candidate of one target, with what speaks against it."""
        own = {tag.code: tag for tag in target.tags}
        largest = {one.code: one for one in reversed(found)}
        tags = [(own[code], one) for code, one in reversed(largest.items()) if code in own]
        if intrinsics is None or not tags:
            return None
        fitter = self._fitter(target, intrinsics)
        starts = solve(tags, fitter.projection)
        candidates = fitter.cold(pixels, starts)
        if not candidates:
            return None
        if all(pose.source == "edges" and pose.rms_px >= LIMITS.health.drift_px for pose in candidates):
            # Residuals doubt the lens. The sides of a frontal tag tell no wrong ratio from a tilt: it costs degrees.
            candidates = self._fitter(target, intrinsics, FLOOR_RANGE).cold(pixels, starts)
        best, *others = sorted(candidates, key=lambda pose: pose.loss)
        same, decided = LIMITS.certainty.blind_angle_sd, LIMITS.ambiguity.decided
        rivals = (pose for pose in others if angle_between(pose.rotation, best.rotation) > same)
        is_ambiguous = any(evidence(best, rival) < decided for rival in rivals)
        return StillPose(target.name, best, residual_ratio(best, others), is_ambiguous, fit_refusal(best, self._cfg))

    def _fitter(self, target: Target, intrinsics: Intrinsics, aspect_sd: float = 0.0) -> TargetFitter:
        """Measures a target by a lens whose focal lengths have a ratio of such a deviation."""
        key = target.name, intrinsics, aspect_sd
        if key not in self._fitters:
            self._fitters[key] = TargetFitter(target, Projection(intrinsics, aspect_sd=aspect_sd))
        return self._fitters[key]


Colour = tuple[int, int, int]

SIDES: tuple[Colour, ...] = ((60, 60, 255), (80, 220, 80), (255, 160, 60), (220, 220, 220))
"""Top, right, bottom, left of the print, and the axes x, y, z [blue-green-red]: a turned tag shows at a glance."""


def draw(pixels: Grey, result: StillResult, intrinsics: Intrinsics | None) -> Grey:
    """Tags with ids, and the axes of poses where the lens is known, over `(h, w)`: blue-green-red `(h, w, 3)` uint8."""
    picture = draw_tags(pixels, ((str(tag.found.tag_id), tag.found.corners) for tag in result.tags))
    if intrinsics is not None:
        for pose in (found.pose for found in result.poses):
            # as long as a tenth of the distance; none that reach behind the lens
            length = 0.1 * pose.range_m
            points = length * np.vstack([np.zeros(3), np.eye(3)]) @ pose.rotation.T + pose.position
            if float(points[:, 2].min()) > NEAR_M:
                seen, _ = Projection(intrinsics).project(points)
                for end, colour in zip(seen[1:], SIDES[:3], strict=True):
                    _line(picture, seen[0], end, colour)
    return picture


def draw_tags(pixels: Grey, tags: Iterable[tuple[str, Array]]) -> Grey:
    """Labels and outlines `(4, 2)` [px] of tags over `(h, w)` uint8: blue-green-red `(h, w, 3)` uint8."""
    picture = np.asarray(cv2.cvtColor(pixels, cv2.COLOR_GRAY2BGR), dtype=np.uint8)
    scale = _scale(picture)
    for label, corners in tags:
        for start, end, colour in zip(corners, np.roll(corners, -1, axis=0), SIDES, strict=True):
            _line(picture, start, end, colour)
        x, y = corners[3] + (0.0, 14.0 * scale)
        at = (round(float(x)), round(float(y)))
        for colour, width in (((0, 0, 0), 3), ((60, 230, 255), 1)):
            cv2.putText(picture, label, at, cv2.FONT_HERSHEY_SIMPLEX, 0.6 * scale, colour, width, cv2.LINE_AA)
    return picture


def _line(picture: Grey, start: Array, end: Array, colour: Colour) -> None:
    a, b = (tuple(int(v) for v in np.clip(np.rint(point * 16), -(2**20), 2**20)) for point in (start, end))
    cv2.line(picture, (a[0], a[1]), (b[0], b[1]), colour, max(round(2 * _scale(picture)), 1), cv2.LINE_AA, shift=4)


def _scale(picture: Grey) -> float:
    """Of lines and letters, by the width of an image."""
    return float(max(picture.shape[1] / 1000.0, 0.5))
