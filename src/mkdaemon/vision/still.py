"""Tags and poses of single images: nothing is known before, everything is tried, what is doubtful says so."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from mkdaemon.config.vision import DetectorSection, TrackerSection
from mkdaemon.telemetry.vision import PoseRefusal
from mkdaemon.vision.camera.intrinsics import Intrinsics
from mkdaemon.vision.camera.tone import in_light
from mkdaemon.vision.limits import HALF, LIMITS
from mkdaemon.vision.pose.ambiguity import choose
from mkdaemon.vision.pose.edgefit import EdgeFit
from mkdaemon.vision.pose.fitting import TargetFitter
from mkdaemon.vision.pose.gates import fit_refusal
from mkdaemon.vision.pose.pose import FLOOR_RANGE, Pose, angle_between, with_floor
from mkdaemon.vision.pose.projection import Projection
from mkdaemon.vision.tags.cover import covered_cells
from mkdaemon.vision.tags.detection import Detection, Stage
from mkdaemon.vision.tags.detector import Detector
from mkdaemon.vision.tags.tagfamily import find_family
from mkdaemon.vision.tags.tagmap import Tag, TagMap, Target, single

Array = npt.NDArray[np.float64]
Grey = npt.NDArray[np.uint8]

ANY_ID_FALSE_RATE = 2e-6
"""Chance that a random quad reads as some code of the family, one bit corrected: with all 587 ids of tag36h11 allowed,
the limit for a short whitelist would refuse even one wrong bit."""
WHOLE_TAGS: tuple[Stage, ...] = ("decimate1", "log", "decimate2", "linear")
"""The searches of a still; a broken outline needs a track or an attitude to be trusted."""
STRETCH_ITERATIONS = 12
"""Tilt and ratio hang together: the fit creeps along their valley."""


@dataclass(frozen=True, slots=True, eq=False)
class StillPose:
    """A pose from one image alone.

    Attributes:
        target: name of the target.
        pose: camera from target.
        ambiguity: residual of the mirrored pose over this one; infinite without a rival.
        ambiguous: nothing in the image tells this pose from its mirror; it would not be published in flight.
        refusal: the gate it fails; none when it passes all.
    """

    target: str
    pose: Pose
    ambiguity: float
    ambiguous: bool
    refusal: PoseRefusal | None

    @property
    def covariance(self) -> Array:
        """`(6, 6)` over position [m] and rotation vector [rad], camera axes, calibration floor included."""
        return with_floor(self.pose)


@dataclass(frozen=True, slots=True, eq=False)
class StillTag:
    """A decoded tag, and its own pose where tags stand alone."""

    found: Detection
    pose: StillPose | None


@dataclass(frozen=True, slots=True, eq=False)
class StillResult:
    """Everything one image gave: tags, and poses of the targets."""

    tags: tuple[StillTag, ...]
    poses: tuple[StillPose, ...]


class StillEye:
    """Looks at images one by one.

    Args:
        intrinsics: calibration; without one there are tags and no poses.
        tagmap: targets to look for, or
        tag_size: side of every tag, each standing alone [m].
        families: families of tags that stand alone.
        ids: codes of tags that stand alone; None for all.

    Raises:
        VisionError: unknown family or id.
        ConfigError: a tag size nobody prints.
    """

    def __init__(
        self,
        intrinsics: Intrinsics | None,
        *,
        tagmap: TagMap | None = None,
        tag_size: float | None = None,
        families: Sequence[str] = ("tag36h11",),
        ids: Iterable[int] | None = None,
    ) -> None:
        self._tagmap = tagmap
        self._tag_size = tag_size
        self._cfg = TrackerSection()
        self._projection = Projection(intrinsics) if intrinsics is not None else None
        self._gamma = intrinsics.gamma if intrinsics is not None else 1.0
        self._fitters: dict[tuple[str, int] | str, TargetFitter] = {}
        self._edges: dict[tuple[str, int] | str, EdgeFit] = {}
        wanted = None if ids is None else frozenset(ids)
        if tagmap is not None:
            self._detector = Detector(tagmap.whitelist, covered=covered_cells(tagmap))
        else:
            whitelist = {name: wanted or frozenset(range(find_family(name).ids)) for name in families}
            cfg = DetectorSection() if wanted else DetectorSection(max_false_rate=ANY_ID_FALSE_RATE)
            self._detector = Detector(whitelist, cfg)
        if tag_size is not None:
            single(tag_size, 0)  # says what is wrong with the size before any image

    @property
    def warning(self) -> str:
        """What is lost when the best detector is not installed."""
        return self._detector.warning

    def look(self, pixels: Grey) -> StillResult:
        """Find everything in `(h, w)` uint8."""
        pixels = in_light(pixels, self._gamma)
        found = self._search(pixels)
        if self._tagmap is not None:
            return StillResult(tuple(StillTag(tag, None) for tag in found), tuple(self._targets(pixels, found)))
        tags = tuple(StillTag(tag, self._alone(pixels, tag)) for tag in found)
        return StillResult(tags, tuple(tag.pose for tag in tags if tag.pose is not None))

    def _search(self, pixels: Grey) -> list[Detection]:
        """The searches for unbroken quads, the finest first; each adds what the ones before did not see.

        Largest tag first.
        """
        found: list[Detection] = []
        for stage in (stage for stage in WHOLE_TAGS if stage in self._detector.stages):
            for tag in self._detector.search_all(pixels, stage):
                middle = tag.corners.mean(axis=0)
                known = (other for other in found if (other.family, other.tag_id) == (tag.family, tag.tag_id))
                if all(np.linalg.norm(middle - k.corners.mean(axis=0)) > HALF * tag.side_px for k in known):
                    found.append(tag)
        return sorted(found, key=lambda tag: -tag.side_px)

    def _targets(self, pixels: Grey, found: Sequence[Detection]) -> list[StillPose]:
        if self._tagmap is None:
            return []
        owners = self._tagmap.owners
        poses = []
        for target in self._tagmap.targets:
            tags: dict[int, tuple[Tag, Detection]] = {}
            for detection in found:
                owner, tag = owners[detection.family, detection.tag_id]
                if owner is target:
                    tags.setdefault(id(tag), (tag, detection))
            pose = self._measure(pixels, target.name, target, list(tags.values()))
            if pose is not None:
                poses.append(pose)
        return poses

    def _alone(self, pixels: Grey, found: Detection) -> StillPose | None:
        if self._tag_size is None:
            return None
        target = single(self._tag_size, found.tag_id, family=found.family)
        return self._measure(pixels, (found.family, found.tag_id), target, [(target.tags[0], found)])

    def _measure(
        self, pixels: Grey, key: tuple[str, int] | str, target: Target, tags: list[tuple[Tag, Detection]]
    ) -> StillPose | None:
        """The best candidate of one target, with what speaks against it."""
        if self._projection is None or not tags:
            return None
        fitter = self._fitters.get(key)
        if fitter is None:
            fitter = self._fitters.setdefault(key, TargetFitter(target, self._projection))
        candidates = self._fit_with_lens_in_doubt(pixels, key, target, fitter.cold(pixels, tags))
        candidates.sort(key=lambda pose: pose.loss)
        if not candidates:
            return None
        choice = choose(candidates, min_ratio=self._cfg.min_ambiguity_ratio)
        best = choice.pose if choice is not None else candidates[0]
        rivals = [
            pose for pose in candidates if angle_between(pose.rotation, best.rotation) > LIMITS.ambiguity.same_pose
        ]
        ratio = float(np.sqrt(rivals[0].loss / max(best.loss, 1e-12))) if rivals else float("inf")
        return StillPose(
            f"{tags[0][1].family}:{tags[0][1].tag_id}" if isinstance(key, tuple) else target.name,
            best,
            ratio,
            choice is None,
            fit_refusal(best, self._cfg),
        )

    def _fit_with_lens_in_doubt(
        self, pixels: Grey, key: tuple[str, int] | str, target: Target, candidates: list[Pose]
    ) -> list[Pose]:
        """Fit once more with the ratio of the focal lengths free within its calibration, where a residual asks for it.

        A frontal tag cannot tell a wrong ratio from a tilt by its sides, only by its perspective; a fit that takes the
        ratio as exact trades degrees of tilt for tenths of a pixel.
        """
        if self._projection is None or any(pose.source != "edges" for pose in candidates):
            return candidates
        if min((pose.rms_px for pose in candidates), default=0.0) < LIMITS.health.drift_px:
            return candidates
        fit = self._edges.get(key)
        if fit is None:
            fit = self._edges.setdefault(key, EdgeFit(target, self._projection))
        doubted = [fit.fit(pixels, pose, iterations=STRETCH_ITERATIONS, stretch_sd=FLOOR_RANGE) for pose in candidates]
        fitted = [pose for pose in doubted if pose is not None]
        return fitted if len(fitted) == len(candidates) else candidates
