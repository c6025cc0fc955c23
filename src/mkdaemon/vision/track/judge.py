"""Judging poses of a target, decoded or followed: by attitude, image, track and inertia."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import inf
from typing import Final, Literal

import numpy as np

from mkdaemon.config.vision import TrackerSection
from mkdaemon.telemetry.vision import PoseRefusal
from mkdaemon.vision.arrays import Array
from mkdaemon.vision.limits import HALF, LIMITS
from mkdaemon.vision.pose.ambiguity import prefers, residual_ratio
from mkdaemon.vision.pose.fitting import TargetFitter
from mkdaemon.vision.pose.gates import certainty_refusal, fit_refusal
from mkdaemon.vision.pose.pose import Pose, angle_between, turn
from mkdaemon.vision.pose.unknowns import TargetLevel
from mkdaemon.vision.track.attitude import ImageSight, corrected, fuse_normal, tilting, turn_between, without_normal
from mkdaemon.vision.track.branches import Branches
from mkdaemon.vision.track.level import LevelKnowledge

CERTAINTY: Final = LIMITS.certainty
Decision = Literal["unique", "image", "attitude", "track"]
"""What settled which reading of a target is true."""


@dataclass(frozen=True, slots=True, eq=False)
class FitVerdict:
    """Verdict on the fits of one image.

    Attributes:
        pose: to go on following the target with, or that contradicts the attitude; none when a gate stopped it.
        refusal: why it is not published; none when it is.
        alone: the fit by what the image alone says, where the attitude agrees with it or is unknown.
        branches: the readings of the target's images with this one; none where it tells nothing about them.
        decided_by: what settled which reading is true.
        ratio: residual of the best other reading over that of the pose; infinite without one.
    """

    pose: Pose | None
    refusal: PoseRefusal | None
    alone: Pose | None = None
    branches: Branches | None = None
    decided_by: Decision = "track"
    ratio: float = inf

    @property
    def contradicts(self) -> bool:
        """Whether the pose contradicts the attitude."""
        return self.pose is not None and self.refusal is PoseRefusal.ATTITUDE


FOLLOWED: Final = (None, PoseRefusal.AMBIGUOUS, PoseRefusal.ANGLE_UNCERTAIN, PoseRefusal.RESIDUAL)
"""What is thought of a first pose that is followed: the next images may decide, know how the camera climbs, or tell
more by all their pixels."""


class Judge:
    """Measures and judges one target; `level` is what the attitude says."""

    def __init__(self, fitter: TargetFitter, level: LevelKnowledge, cfg: TrackerSection) -> None:
        self.level = level
        self._fitter, self._cfg = fitter, cfg

    def measure(self, seen: ImageSight, start: Pose, before: Branches | None = None) -> FitVerdict:
        """Fit from one start, and judge the fit; `before` are the readings of the images before."""
        # Far away a tilt hardly shows: what the attitude knows of it belongs into the fit, which is not linear there.
        vertical = self.level.vertical(seen)
        held = vertical if self._fitter.is_small(start) else None
        fit = alone = leaning = self._fitter.refine(seen.pixels, start, held)
        is_free = held is None
        if fit is not None and held is not None:
            alone, says_more = without_normal(fit, held)
            if says_more:
                fit, held = alone, None
        refused = self.refusal(seen, fit, vertical) if fit is not None else PoseRefusal.NO_FIT
        if fit is not None and refused is None:
            if vertical is None:
                # Its mirror image, the images before and the vehicle's inertia judge it.
                candidates = self.candidates(seen, [fit])
                branches = self.branches(seen, candidates, before)
                refused = None if branches.pose is fit else self.refusal(seen, branches.pose, vertical)
                return (
                    self._judge_branches(seen, branches, candidates) if refused is None else FitVerdict(None, refused)
                )
            # The deck's tilt by the images before; with this one in it the image would count twice.
            fused = fuse_normal(fit, vertical) if held is None else fit
            return replace(self.judge_with_attitude(seen, fused, before), alone=alone)
        off = fit if refused is PoseRefusal.ATTITUDE else None
        # Nothing lies over a whole target; a held tilt agrees with the attitude whatever the image says.
        is_sure = off is not None and self.is_whole(off)
        if vertical is not None and not is_sure:
            # Elsewhere a free fit may follow what lies over the target or smears it: once more, with the tilt held.
            if is_free:
                leaning = self._fitter.refine(seen.pixels, start, vertical)
            if leaning is not None and self.refusal(seen, leaning, vertical) is None:
                if off is None or not self.prefers(seen, off, leaning, before):
                    return replace(self.judge_with_attitude(seen, leaning, before), branches=None)
                is_sure = True
        # What lies over a near target misleads its tilt, but not its place.
        is_there = off is not None and (is_sure or self.is_plainly_there(seen, off))
        return FitVerdict(off if is_there else None, refused)

    def prefers(self, seen: ImageSight, first: Pose, second: Pose, before: Branches | None) -> bool:
        """Whether image and inertia together prefer one fit to another, by more than light or blur do."""
        inertia = 0.0
        if before is not None and before.is_decided:
            course = before.course[0].predict_at(seen.time)
            inertia = (course.mahalanobis2(second) - course.mahalanobis2(first)) / 2.0
        return prefers(first, second, inertia)

    def first(self, seen: ImageSight, candidates: Sequence[Pose]) -> FitVerdict:
        """Judge poses from decoded tags; what the image alone would publish elsewhere contradicts the attitude."""
        vertical = self.level.vertical(seen)
        refusals = [self.refusal(seen, pose, vertical) for pose in candidates]
        pairs = zip(candidates, refusals, strict=True)
        fits = [pose for pose, why in pairs if why is None or why is PoseRefusal.ATTITUDE]
        if not fits:
            return FitVerdict(None, next(filter(None, refusals), PoseRefusal.NO_FIT))
        fits = self.candidates(seen, fits)
        verdict = alone = self._judge_alone(seen, fits)
        if vertical is not None:
            verdict = self._judge_beside(seen, fits, vertical)
            if alone.pose is not None and alone.refusal is None:
                chosen = verdict.pose if verdict.refusal is None else None
                if chosen is None or angle_between(alone.pose.rotation, chosen.rotation) > CERTAINTY.wrong_angle:
                    return FitVerdict(alone.pose, PoseRefusal.ATTITUDE)
                verdict = replace(verdict, decided_by=alone.decided_by, ratio=alone.ratio)
        return verdict if verdict.refusal in FOLLOWED else FitVerdict(None, verdict.refusal)

    def _judge_alone(self, seen: ImageSight, fits: Sequence[Pose]) -> FitVerdict:
        """Judge the first fits of a target by their image."""
        branches = self.branches(seen, fits)
        small = LIMITS.cells.small_px
        if not branches.is_decided and all(one.source == "edges" and self._cell_px(one) < small for one in fits):
            # All pixels of a small target tell more than its edges.
            grey = self._fitter.fit_grey_values(seen.pixels, fits)
            if grey and (by_grey := self.branches(seen, grey)).is_decided:
                fits, branches = grey, by_grey
        verdict = self._judge_branches(seen, branches, fits)
        return replace(verdict, decided_by="unique" if verdict.ratio == inf else "image")

    def _judge_beside(self, seen: ImageSight, fits: Sequence[Pose], vertical: TargetLevel) -> FitVerdict:
        """Judge the first fits of a target by image and attitude."""
        expected = np.array([corrected(one.covariance, *tilting(one, vertical))[2] for one in fits])
        branches = self.branches(seen, fits, log_prior=expected)
        pose = branches.pose
        if branches.is_decided and not self.is_partial(pose) and self.refusal(seen, pose, vertical) is None:
            pose = with_angle_variance(fuse_normal(pose, vertical), branches.doubt)
        else:
            # Something lying over one side gives a quad that is off by that much.
            best = min(fits, key=lambda pose: pose.loss)
            upright = turn(best.rotation, turn_between(best.rotation[:, 2], vertical.up))
            held = self._fitter.refine(seen.pixels, replace(best, rotation=upright), vertical)
            if held is None or self.refusal(seen, held, vertical, is_hidden=True) is not None:
                return FitVerdict(None, PoseRefusal.ATTITUDE)
            pose, branches = held, self.branches(seen, [held])
        refused = certainty_refusal(pose, has_attitude=True)
        return FitVerdict(pose, refused, branches=branches, decided_by="attitude")

    def branches(
        self,
        seen: ImageSight,
        candidates: Sequence[Pose],
        before: Branches | None = None,
        log_prior: Array | None = None,
    ) -> Branches:
        """The readings of the images before with this one, or such as start in it; see `Branches.begin`."""
        if before is not None:
            return before.after(seen.time, candidates)
        return Branches.begin(seen.time, candidates, log_prior, moving=self._fitter.target.moving)

    def judge_with_attitude(self, seen: ImageSight, pose: Pose, before: Branches | None) -> FitVerdict:
        """Judge a fit that agrees with the attitude; inertia is asked where the fit alone is too uncertain."""
        refused, branches = certainty_refusal(pose, has_attitude=True), self.branches(seen, [pose], before)
        if refused is not None and self._is_on_course(branches):
            pose = branches.prior.fuse(pose)
            refused = certainty_refusal(pose, has_attitude=True)
        return FitVerdict(pose, refused, branches=branches)

    def _is_on_course(self, branches: Branches) -> bool:
        """Whether a pose is where inertia expects it, by its own covariance: branches allow for errors that last."""
        is_hit = branches.is_decided and not branches.missed[0]
        # Chi-square(3): one in 900 is farther.
        return is_hit and branches.prior.mahalanobis2(branches.pose) <= CERTAINTY.deviations**2

    def _judge_branches(self, seen: ImageSight, branches: Branches, candidates: Sequence[Pose]) -> FitVerdict:
        """Judge the most likely hypothesis."""
        chosen = branches.pose
        if not branches.is_decided or branches.is_spoken_against:
            return FitVerdict(chosen, PoseRefusal.AMBIGUOUS, branches=branches)
        fused = with_angle_variance(branches.prior.fuse(chosen), branches.doubt)
        if not self._is_on_course(branches):
            return FitVerdict(fused, PoseRefusal.OFF_COURSE, branches=branches)
        is_partial = self.is_partial(chosen)
        is_plain = branches.prior.angle_sd < CERTAINTY.blind_angle_sd or self.is_plain(seen, fused)
        # Hidden parts, or a border faked by what hides them: the edges seen tell these apart.
        is_plain = is_plain or (is_partial and self._fitter.edges.evidence(seen.pixels, chosen).supports)
        if not is_plain and (is_partial or chosen.inliers < LIMITS.agreement.blind):
            return FitVerdict(fused, PoseRefusal.INLIERS, branches=branches)
        refused = certainty_refusal(fused, has_attitude=False)
        alone = fused if refused is None else None
        return FitVerdict(fused, refused, alone, branches, ratio=residual_ratio(chosen, candidates))

    def refusal(
        self, seen: ImageSight, pose: Pose, vertical: TargetLevel | None, *, is_hidden: bool = False
    ) -> PoseRefusal | None:
        """The first sign that a pose is wrong, and, beside a normal that is expected, has another one.

        Parts that are hidden (`is_hidden`) tell no tilted deck from a covered border.
        """
        refused = fit_refusal(pose, self._cfg)
        if refused is not None:
            return refused
        read = self._fitter.cells.evidence(seen.pixels, pose)
        if not read.vouches:
            return PoseRefusal.BITS
        if self.is_partial(pose):
            beside = self._fitter.cells.beside(seen.pixels, pose)
            if beside > HALF * LIMITS.ambiguity.decided or not read.has_code:
                return PoseRefusal.BITS
            # What lies over a target hides edges; one that is beside its place has other edges in view.
            if pose.inliers < LIMITS.agreement.blind and not self._fitter.edges.evidence(seen.pixels, pose).explains:
                return PoseRefusal.INLIERS
        is_off = vertical is not None and self.level.refuses(vertical, pose, is_hidden=is_hidden)
        return PoseRefusal.ATTITUDE if is_off else None

    def candidates(self, seen: ImageSight, fits: Sequence[Pose]) -> list[Pose]:
        """Distinct fits of one image, the best first, and its mirror image unless perspective rules it out."""
        # Starts may have run into one minimum; a branch without its rival would be believed unchallenged.
        best, *others = sorted(fits, key=lambda pose: pose.loss)
        if not self._has_no_rival(seen, best):
            rival = self._fitter.fit_mirrored(seen.pixels, best)
            others += [] if rival is None else [rival]
        distinct = [best]
        for one in others:
            if all(angle_between(one.rotation, pose.rotation) >= CERTAINTY.blind_angle_sd for pose in distinct):
                distinct.append(one)
        return distinct

    def _has_no_rival(self, seen: ImageSight, pose: Pose) -> bool:
        """Whether perspective rules the mirror image of a fit out, before an image is asked."""
        if pose.blur_px is not None and pose.blur_px > LIMITS.blur.smeared_px:
            return False
        if self._is_large(pose):
            return True
        is_whole = pose.inliers >= LIMITS.agreement.whole
        return is_whole and self._fitter.mirror_odds(seen.pixels, pose) >= LIMITS.ambiguity.decided

    def is_whole(self, pose: Pose) -> bool:
        """Whether nearly all edges of the target are seen and agree."""
        return pose.source == "edges" and pose.inliers >= LIMITS.agreement.whole

    def is_partial(self, pose: Pose) -> bool:
        """Whether some edges do not agree: something lies over the target, or the pose is beside it."""
        return pose.source == "edges" and not self.is_whole(pose)

    def is_plain(self, seen: ImageSight, pose: Pose) -> bool:
        """Whether the target is large and its cells are read clearly, so that hidden parts do not mislead."""
        return self._is_large(pose) and self._fitter.cells.evidence(seen.pixels, pose).is_clear

    def is_plainly_there(self, seen: ImageSight, pose: Pose) -> bool:
        """Whether a large target lies as a pose says, for all but the attitude."""
        return self.is_plain(seen, pose) and certainty_refusal(pose, has_attitude=False) is None

    def _is_large(self, pose: Pose) -> bool:
        """Whether perspective tells a pose from its mirror image, whatever is hidden."""
        return self._cell_px(pose) > LIMITS.cells.perspective_px

    def _cell_px(self, pose: Pose) -> float:
        """Side of a cell of the largest tag in the image [px]."""
        return self._fitter.side_px(pose) / self._fitter.target.tags[0].family.size_cells


def with_angle_variance(pose: Pose, variance: float) -> Pose:
    """The pose with this much more variance of every angle [rad^2]."""
    return replace(pose, covariance=pose.covariance + np.diag([0.0] * 3 + [variance] * 3))
