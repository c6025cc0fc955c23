"""Measuring a followed target from a start and judging what came out: by attitude, track, image and inertia."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from mkdaemon.telemetry.vision import PoseRefusal
from mkdaemon.vision.limits import LIMITS
from mkdaemon.vision.pose.ambiguity import choose, prefers
from mkdaemon.vision.pose.gates import certainty_refusal
from mkdaemon.vision.pose.pose import Pose
from mkdaemon.vision.track.attitude import without_normal
from mkdaemon.vision.track.branches import Branches
from mkdaemon.vision.track.checks import Checks, with_angle_variance
from mkdaemon.vision.track.level import Sight


@dataclass(frozen=True, slots=True, eq=False)
class Verdict:
    """What is thought of a fit.

    Attributes:
        pose: to go on following the target with; none when a gate stopped it. Where only the attitude speaks against a
            target that is plainly there, that is the contradicting fit.
        refusal: why it is not published; none when it is.
        contradicting: a fit that the attitude refuses, and that nearly all edges agree with, whose cells are clear, or
            that the image prefers to the one with the attitude's tilt; none without one.
    """

    pose: Pose | None
    refusal: PoseRefusal | None
    contradicting: Pose | None = None


class Judge:
    """Measures and judges one target that is followed.

    Attributes:
        is_backed: whether the images before and inertia spoke for the newest pose.
    """

    def __init__(self, checks: Checks) -> None:
        self._checks = checks
        self._fitter, self._track = checks.fitter, checks.track
        self.is_backed = False

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
        pose = self._fitter.refine(seen.pixels, start, held)
        is_held, fitted = held is not None and start.rotation is predicted.rotation, pose
        alone = without_normal(pose, held.up, held.spread) if pose is not None and held is not None else None
        if alone is not None:
            pose, held = alone, None
        refused = checks.refusal(seen, pose) if pose is not None else PoseRefusal.NO_FIT
        if pose is not None and refused is None:
            if held is not None:
                checks.level.learn(seen, pose, held)
                return self._judge_with_attitude(seen, pose)
            if checks.level.knows(seen):
                # What the images before told of the deck; with this one in it the image would count twice.
                fused = checks.level.fuse(seen, pose)
                checks.level.learn(seen, pose)
                return self._judge_with_attitude(seen, fused)
            return self._judge_without_attitude(seen, pose)
        contradicting = pose if self._is_contradicted(pose, refused) else None
        if vertical is not None and contradicting is None:
            # A free fit may follow something lying over the target, and agrees with the image no better then: hold the
            # tilt and try again.
            leaning = fitted
            if not is_held:
                leaning = self._fitter.refine(seen.pixels, replace(start, rotation=predicted.rotation), vertical)
            leans = leaning is not None and checks.refusal(seen, leaning) is None
            off = pose if refused is PoseRefusal.ATTITUDE else None
            if leaning is not None and leans and (off is None or not prefers(off, leaning)):
                return self.add_inertia(seen, leaning)
            if off is not None and (leans or self._is_plainly_there(seen, off)):
                contradicting = off
        is_there = contradicting is not None and self._is_plainly_there(seen, contradicting)
        return Verdict(contradicting if is_there else None, refused, contradicting)

    def _is_plainly_there(self, seen: Sight, pose: Pose) -> bool:
        """Whether a large target whose cells are read clearly lies as a pose says, for all but the attitude."""
        if not self._checks.is_plain(seen, pose):
            return False
        return certainty_refusal(pose, has_attitude=False, is_plain=True) is None

    def _is_contradicted(self, pose: Pose | None, refused: PoseRefusal | None) -> bool:
        """Whether the attitude refuses a fit that nearly all edges agree with: nothing lies over such a target.

        A tilt that is held agrees with the attitude whatever the image says, and nobody would hear of it.
        """
        return pose is not None and refused is PoseRefusal.ATTITUDE and self._checks.is_whole(pose)

    def start_branches(self, seen: Sight, candidates: Sequence[Pose], *, decided: bool) -> Branches:
        """Branches that start in this image, the best candidate first."""
        return Branches.begin(seen.time, candidates, decided=decided, moving=self._fitter.target.moving)

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
        prior = before.best.course.predict_at(seen.time)
        if prior.angle_sd > certain.blind_angle_sd or prior.mahalanobis2(pose, 1.0) > certain.surprising:
            return Verdict(pose, refused)
        fused = prior.fuse(pose)
        return Verdict(fused, certainty_refusal(fused, has_attitude=True))

    def _judge_with_attitude(self, seen: Sight, pose: Pose) -> Verdict:
        """Judge a fit that agrees with the attitude, and carry the course on with it."""
        before = self._track.branches
        branches = before.after(seen.time, [pose]) if before is not None and before.is_decided else None
        verdict = self.add_inertia(seen, pose)
        if branches is None or branches.best.missed:
            branches = self.start_branches(seen, [pose], decided=True)
        self._track.branches = branches
        return verdict

    def _judge_without_attitude(self, seen: Sight, pose: Pose) -> Verdict:
        """Judge a fit by its mirror image, the images before and the vehicle's inertia."""
        checks, certain = self._checks, LIMITS.certainty
        branches = self._advance_branches(seen, checks.candidates(seen, pose))
        chosen, prior = branches.best.pose, branches.best.prior
        refused = None if chosen is pose else checks.refusal(seen, chosen)
        if refused is not None:
            return Verdict(None, refused)
        self._track.branches = branches
        self.is_backed = False
        if not branches.is_decided or branches.is_spoken_against:
            return Verdict(chosen, PoseRefusal.AMBIGUOUS)
        fused = with_angle_variance(prior.fuse(chosen) if prior is not None else chosen, branches.doubt)
        # The branches allow for errors that last; to be published a pose has to fit by its own covariance.
        surprises = prior is not None and prior.mahalanobis2(chosen, 1.0) > certain.surprising
        if branches.best.missed or surprises:
            return Verdict(fused, PoseRefusal.OFF_COURSE)
        self.is_backed = prior is not None and prior.angle_sd < certain.blind_angle_sd
        is_plain = self.is_backed or checks.is_plain(seen, fused)
        if not is_plain and chosen.source == "edges" and chosen.inliers < LIMITS.agreement.whole:
            return Verdict(fused, PoseRefusal.INLIERS)
        refused = certainty_refusal(fused, has_attitude=False, is_plain=is_plain, is_backed=self.is_backed)
        return Verdict(fused, refused)

    def _advance_branches(self, seen: Sight, candidates: Sequence[Pose]) -> Branches:
        """The branches of the track with the candidates of this image."""
        before, first = self._track.branches, candidates[0]
        if before is not None:
            return before.after(seen.time, candidates)
        if self._checks.shows_perspective(first):
            return self.start_branches(seen, candidates, decided=True)
        choice = choose(candidates, min_ratio=self._checks.cfg.min_ambiguity_ratio)
        best = choice.pose if choice is not None else min(candidates, key=lambda candidate: candidate.loss)
        order = [best, *(other for other in candidates if other is not best)]
        return self.start_branches(seen, order, decided=choice is not None)
