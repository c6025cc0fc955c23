"""Judging poses of a target, decoded anew or followed: by attitude, image, track and inertia."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import inf
from typing import Final

import numpy as np

from mkdaemon.telemetry.vision import PoseRefusal
from mkdaemon.vision.arrays import Array
from mkdaemon.vision.limits import LIMITS
from mkdaemon.vision.pose.ambiguity import Decision, log_odds, residual_ratio
from mkdaemon.vision.pose.gates import certainty_refusal
from mkdaemon.vision.pose.pose import Pose, angle_between, turn
from mkdaemon.vision.pose.unknowns import Level
from mkdaemon.vision.track.attitude import Sight, angle_of, normal_density, turn_between, without_normal
from mkdaemon.vision.track.branches import Branches
from mkdaemon.vision.track.checks import Checks, with_angle_variance


@dataclass(frozen=True, slots=True, eq=False)
class Verdict:
    """What is thought of the fits of one image.

    Attributes:
        pose: to go on following the target with; none when a gate stopped it. Refused by the attitude, the fit that
            contradicts it: the image prefers it to what agrees with the attitude.
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


FOLLOWED: Final = (None, PoseRefusal.AMBIGUOUS, PoseRefusal.ANGLE_UNCERTAIN)
"""What is thought of a first pose that is followed: the next images may decide, or know how the camera climbs."""


class Judge:
    """Measures and judges one target.

    Args:
        checks: the target's gates.
    """

    def __init__(self, checks: Checks) -> None:
        self._checks = checks
        self._fitter, self._track = checks.fitter, checks.track

    def measure(self, seen: Sight, start: Pose, predicted: Pose) -> Verdict:
        """Fit from one start and judge the fit.

        Args:
            seen: the image.
            start: where the fit begins.
            predicted: what the track expects.
        """
        checks = self._checks
        # Far away a tilt hardly shows: what the attitude knows of it belongs into the fit, which is not linear there.
        vertical = checks.level.vertical(seen)
        held = vertical if self._fitter.is_small(start) else None
        fit = fitted = alone = self._fitter.refine(seen.pixels, start, held)
        is_held = held is not None and start.rotation is predicted.rotation
        if fitted is not None and held is not None:
            alone, says_more = without_normal(fitted, held.up, held.spread)
            if says_more:
                fit, held = alone, None
        refused = checks.refusal(seen, fit) if fit is not None else PoseRefusal.NO_FIT
        if fit is not None and refused is None:
            if not checks.level.knows(seen):
                return self._judge_without_attitude(seen, fit)
            # What the images before told of the deck; with this one in it the image would count twice.
            fused = fit if held is not None else checks.level.fuse(seen, fit)
            return replace(self._judge_with_attitude(seen, fused), alone=alone)
        off = fit if refused is PoseRefusal.ATTITUDE else None
        # Nothing lies over a whole target; a held tilt agrees with the attitude whatever the image says.
        is_sure = off is not None and checks.is_whole(off)
        if vertical is not None and not is_sure:
            # A free fit may follow something lying over the target, and agrees with the image no better then: hold the
            # tilt and try again.
            leaning = fitted
            if not is_held:
                leaning = self._fitter.refine(seen.pixels, replace(start, rotation=predicted.rotation), vertical)
            if leaning is not None and checks.refusal(seen, leaning) is None:
                if off is None or not self.prefers(seen, off, leaning):
                    return self.add_inertia(seen, leaning)
                is_sure = True
        if off is not None and (is_sure or checks.is_plainly_there(seen, off)):
            return Verdict(off, PoseRefusal.ATTITUDE)
        return Verdict(None, refused)

    def prefers(self, seen: Sight, first: Pose, second: Pose) -> bool:
        """Whether an image and the vehicle's inertia together prefer one fit to another, by more than light or blur do.

        Args:
            seen: the image.
            first: a fit to it.
            second: another one; the image compares those of one kind.
        """
        odds = log_odds(first, second) if first.source == second.source else 0.0
        before = self._track.branches
        if before is not None and before.is_decided:
            course = before.course[0].predict_at(seen.time)
            odds += (course.mahalanobis2(second) - course.mahalanobis2(first)) / 2.0
        return odds > LIMITS.ambiguity.silent

    def first(self, seen: Sight, candidates: Sequence[Pose]) -> Verdict:
        """Judge poses from decoded tags.

        An attitude with both signs swapped agrees with the mirror image of a target in the middle of the image, which
        may be too uncertain to be published: what the image alone would publish elsewhere contradicts it.

        Args:
            seen: the image.
            candidates: fitted poses.
        """
        checks = self._checks
        refusals = [checks.refusal(seen, pose) for pose in candidates]
        pairs = zip(candidates, refusals, strict=True)
        fits = [pose for pose, why in pairs if why is None or why is PoseRefusal.ATTITUDE]
        if not fits:
            return Verdict(None, next(filter(None, refusals), PoseRefusal.NO_FIT))
        fits = checks.candidates(seen, fits)
        alone = self._judge_alone(seen.without_attitude(), fits)
        vertical = checks.level.vertical(seen)
        if vertical is None:
            return alone
        verdict = self._judge_beside(seen, fits, vertical)
        if alone.pose is None or alone.refusal is not None:
            return verdict
        chosen = verdict.pose if verdict.refusal is None else None
        if chosen is None or angle_between(alone.pose.rotation, chosen.rotation) > LIMITS.certainty.wrong_angle:
            return Verdict(alone.pose, PoseRefusal.ATTITUDE)
        return replace(verdict, decided_by=alone.decided_by, ratio=alone.ratio)

    def _judge_alone(self, seen: Sight, fits: Sequence[Pose]) -> Verdict:
        """Judge the first fits of a target by their image."""
        branches = self.start_branches(seen, fits)
        if not branches.is_decided:
            # All pixels of a small target tell more than its edges.
            small, checks = LIMITS.cells.small_px, self._checks
            is_small = all(pose.source == "edges" and checks.cell_px(pose) < small for pose in fits)
            grey = self._fitter.fit_grey_values(seen.pixels, fits) if is_small else []
            by_grey = self.start_branches(seen, grey) if grey else branches
            if by_grey.is_decided:
                fits, branches = grey, by_grey
        verdict = self._judge_branches(seen, branches, fits)
        return replace(
            verdict,
            pose=verdict.pose if verdict.refusal in FOLLOWED else None,
            decided_by="unique" if verdict.ratio == inf else "image",
        )

    def _judge_beside(self, seen: Sight, fits: Sequence[Pose], vertical: Level) -> Verdict:
        """Judge the first fits of a target by image and attitude."""
        checks, level = self._checks, self._checks.level
        log_prior = np.array([normal_density(pose, vertical.up, vertical.spread) for pose in fits])
        branches = self.start_branches(seen, fits, log_prior)
        pose = branches.pose
        if branches.is_decided and not checks.is_partial(pose) and checks.refusal(seen, pose) is None:
            pose = with_angle_variance(level.fuse(seen, pose), branches.doubt)
        else:
            # Something lying over one side gives a quad that is off by that much.
            best = min(fits, key=lambda pose: pose.loss)
            upright = turn(best.rotation, turn_between(best.rotation[:, 2], vertical.up))
            held = self._fitter.refine(seen.pixels, replace(best, rotation=upright), vertical)
            if held is None or checks.refusal(seen, held) is not None:
                return Verdict(None, PoseRefusal.ATTITUDE)
            if angle_of(held.rotation[:, 2], vertical.up) > level.hidden_gate(held):
                return Verdict(None, PoseRefusal.ATTITUDE)
            pose, branches = held, self.start_branches(seen, [held])
        refused = certainty_refusal(pose, has_attitude=True)
        return Verdict(pose if refused in FOLLOWED else None, refused, branches=branches, decided_by="attitude")

    def start_branches(self, seen: Sight, candidates: Sequence[Pose], log_prior: Array | None = None) -> Branches:
        """Branches that start in this image, by it and what else is told; a single candidate is believed."""
        return Branches.begin(seen.time, candidates, log_prior, moving=self._fitter.target.moving)

    def add_inertia(self, seen: Sight, pose: Pose) -> Verdict:
        """Judge a pose the attitude agrees with; what inertia knows is added where the pose alone is too uncertain.

        Args:
            seen: the image.
            pose: measured in it.
        """
        certain = LIMITS.certainty
        refused, before = certainty_refusal(pose, has_attitude=True), self._track.branches
        if refused is None or before is None or not before.is_decided:
            return Verdict(pose, refused)
        prior = before.course[0].predict_at(seen.time)
        if prior.angle_sd > certain.blind_angle_sd or prior.mahalanobis2(pose, 1.0) > certain.surprising:
            return Verdict(pose, refused)
        fused = prior.fuse(pose)
        return Verdict(fused, certainty_refusal(fused, has_attitude=True))

    def _judge_with_attitude(self, seen: Sight, pose: Pose) -> Verdict:
        """Judge a fit that agrees with the attitude, and carry the course on with it."""
        verdict, branches = self.add_inertia(seen, pose), self._track.branches
        branches = branches.after(seen.time, [pose]) if branches is not None and branches.is_decided else None
        if branches is None or branches.missed[0]:
            branches = self.start_branches(seen, [pose])
        return replace(verdict, branches=branches)

    def _judge_without_attitude(self, seen: Sight, pose: Pose) -> Verdict:
        """Judge a fit by its mirror image, the images before and the vehicle's inertia."""
        if self._track.branches is None:
            return Verdict(pose, PoseRefusal.AMBIGUOUS)
        candidates = self._checks.candidates(seen, [pose])
        branches = self._track.branches.after(seen.time, candidates)
        refused = None if branches.pose is pose else self._checks.refusal(seen, branches.pose)
        return self._judge_branches(seen, branches, candidates) if refused is None else Verdict(None, refused)

    def _judge_branches(self, seen: Sight, branches: Branches, candidates: Sequence[Pose]) -> Verdict:
        """Judge the likeliest reading of the images so far."""
        checks, certain = self._checks, LIMITS.certainty
        chosen, prior = branches.pose, branches.prior
        if not branches.is_decided or branches.is_spoken_against:
            return Verdict(chosen, PoseRefusal.AMBIGUOUS, branches=branches)
        fused = with_angle_variance(prior.fuse(chosen), branches.doubt)
        # The branches allow for errors that last; to be published a pose has to fit by its own covariance.
        if branches.missed[0] or prior.mahalanobis2(chosen, 1.0) > certain.surprising:
            return Verdict(fused, PoseRefusal.OFF_COURSE, branches=branches)
        is_backed, is_partial = prior.angle_sd < certain.blind_angle_sd, checks.is_partial(chosen)
        is_plain = is_backed or checks.is_plain(seen, fused)
        # Hidden parts, or a border faked by what hides them: the edges seen tell these apart.
        is_plain = is_plain or (is_partial and self._fitter.is_supported(seen.pixels, chosen))
        if is_partial and not is_plain:
            return Verdict(fused, PoseRefusal.INLIERS, branches=branches)
        refused = certainty_refusal(fused, has_attitude=False, is_plain=is_plain, is_backed=is_backed)
        alone = fused if refused is None else None
        return Verdict(fused, refused, alone, branches, ratio=residual_ratio(chosen, candidates))
