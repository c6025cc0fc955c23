"""What every pose of a target is asked, whether a track expects it or not."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from mkdaemon.config.vision import TrackerSection
from mkdaemon.telemetry.vision import PoseRefusal
from mkdaemon.vision.limits import HALF, LIMITS
from mkdaemon.vision.pose.fitting import TargetFitter
from mkdaemon.vision.pose.gates import certainty_refusal, fit_refusal
from mkdaemon.vision.pose.pose import Pose, angle_between
from mkdaemon.vision.track.attitude import Mounting, Sight
from mkdaemon.vision.track.level import LevelKnowledge
from mkdaemon.vision.track.track import Track


class Checks:
    """The gates of one target.

    Attributes:
        fitter: measures the target.
        track: its memory.
        cfg: settings of the tracker.
        level: what the attitude says.
    """

    def __init__(
        self,
        fitter: TargetFitter,
        track: Track,
        cfg: TrackerSection,
        mounting: Mounting | None,
    ) -> None:
        self.fitter = fitter
        self.track = track
        self.cfg = cfg
        self.level = LevelKnowledge(fitter.target.level, mounting, cfg)

    def refusal(self, seen: Sight, pose: Pose) -> PoseRefusal | None:
        """The first sign that a pose is wrong; none without any.

        Args:
            seen: the image.
            pose: measured in it.
        """
        refused = fit_refusal(pose, self.cfg)
        if refused is not None:
            return refused
        if not self.fitter.evidence(seen.pixels, pose).vouches:
            return PoseRefusal.BITS
        if self.is_partial(pose):
            if self.fitter.beside(seen.pixels, pose) > HALF * LIMITS.ambiguity.decided:
                return PoseRefusal.BITS
            # What lies over a target hides edges; one that is beside its place has other edges in view.
            if self.has_few_edges(pose) and not self.fitter.explains_seen_edges(seen.pixels, pose):
                return PoseRefusal.INLIERS
        tilt = self.level.tilt(seen, pose)
        if tilt is not None and tilt > self.level.gate(seen, pose):
            return PoseRefusal.ATTITUDE
        return None

    def is_partial(self, pose: Pose) -> bool:
        """Whether some edges do not agree: something lies over the target, or the pose is beside it."""
        return pose.source == "edges" and not self.is_whole(pose)

    def has_few_edges(self, pose: Pose) -> bool:
        """Whether so few edges agree that something lies over the target, or edges were taken for their neighbours."""
        return pose.source == "edges" and pose.inliers < LIMITS.agreement.blind

    def candidates(self, seen: Sight, fits: Sequence[Pose]) -> list[Pose]:
        """Fits of one image and, where perspective does not rule it out, the mirror image of the best one.

        The starts of both may have run into one minimum; a branch without its rival would be believed unchallenged.
        """
        best, same = min(fits, key=lambda pose: pose.loss), LIMITS.certainty.blind_angle_sd
        rival = None if self.shows_perspective(best) else self.fitter.fit_mirrored(seen.pixels, best)
        if rival is None or any(angle_between(rival.rotation, pose.rotation) < same for pose in fits):
            return [*fits]
        return [*fits, rival]

    def cell_px(self, pose: Pose) -> float:
        """Side of a cell of the largest tag in the image [px]."""
        return self.fitter.side_px(pose) / self.fitter.target.tags[0].family.size_cells

    def shows_perspective(self, pose: Pose) -> bool:
        """Whether the image alone tells a pose from its mirror image: it is near, and not too blurred."""
        is_blurred = pose.blur_px is not None and pose.blur_px > LIMITS.blur.smeared_px
        return self.cell_px(pose) > LIMITS.cells.perspective_px and not is_blurred

    def is_whole(self, pose: Pose) -> bool:
        """Whether nearly all edges of the target are seen and agree."""
        return pose.source == "edges" and pose.inliers >= LIMITS.agreement.whole

    def is_plain(self, seen: Sight, pose: Pose) -> bool:
        """Whether the target is large and its cells are read clearly: hidden parts then mislead nobody."""
        return self.cell_px(pose) > LIMITS.cells.perspective_px and self.are_cells_clear(seen, pose)

    def is_plainly_there(self, seen: Sight, pose: Pose) -> bool:
        """Whether a large target whose cells are read clearly lies as a pose says, for all but the attitude."""
        return self.is_plain(seen, pose) and certainty_refusal(pose, has_attitude=False, is_plain=True) is None

    def are_cells_clear(self, seen: Sight, pose: Pose) -> bool:
        """Whether the cells are read clearly."""
        return self.fitter.evidence(seen.pixels, pose).is_clear


def with_angle_variance(pose: Pose, variance: float) -> Pose:
    """The pose with so much more variance of every angle [rad^2]."""
    covariance = pose.covariance.copy()
    covariance[3:, 3:] += variance * np.eye(3)
    return replace(pose, covariance=covariance)
