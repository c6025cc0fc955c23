"""Judging poses of a target, decoded anew or followed: by attitude, image, track and inertia."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

from mkdaemon.telemetry.vision import PoseRefusal
from mkdaemon.vision.limits import LIMITS
from mkdaemon.vision.pose.ambiguity import Choice, choose, prefers
from mkdaemon.vision.pose.gates import certainty_refusal
from mkdaemon.vision.pose.pose import Pose, angle_between, turn
from mkdaemon.vision.track.attitude import Sight, angle_of, turn_between, without_normal
from mkdaemon.vision.track.branches import Branches
from mkdaemon.vision.track.checks import Checks, with_angle_variance, with_rival


@dataclass(frozen=True, slots=True, eq=False)
class Verdict:
    """What is thought of a fit.

    Attributes:
        pose: to go on following the target with; none when a gate stopped it. Where only the attitude speaks against a
            target that is plainly there, that is the contradicting fit.
        refusal: why it is not published; none when it is.
        contradicting: a fit that the attitude refuses, and that nearly all edges agree with, whose cells are clear, or
            that the image prefers to the one with the attitude's tilt; none without one.
        alone: the fit by what the image alone says, where the attitude agrees with it.
    """

    pose: Pose | None
    refusal: PoseRefusal | None
    contradicting: Pose | None = None
    alone: Pose | None = None


class Judge:
    """Measures and judges one target that is followed.

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
        pose = self._fitter.refine(seen.pixels, start, held)
        is_held, fitted = held is not None and start.rotation is predicted.rotation, pose
        alone = pose
        if pose is not None and held is not None:
            alone, says_more = without_normal(pose, held.up, held.spread)
            if says_more:
                pose, held = alone, None
        refused = checks.refusal(seen, pose) if pose is not None else PoseRefusal.NO_FIT
        if pose is not None and alone is not None and refused is None:
            if checks.level.knows(seen):
                # What the images before told of the deck; with this one in it the image would count twice.
                fused = pose if held is not None else checks.level.fuse(seen, pose)
                return replace(self._judge_with_attitude(seen, fused), alone=alone)
            return self._judge_without_attitude(seen, pose)
        contradicting, off = None, pose if refused is PoseRefusal.ATTITUDE else None
        if off is not None and checks.is_whole(off):
            # Nothing lies over such a target; a held tilt agrees with the attitude whatever the image says.
            contradicting = off
        elif vertical is not None:
            # A free fit may follow something lying over the target, and agrees with the image no better then: hold the
            # tilt and try again.
            leaning = fitted
            if not is_held:
                leaning = self._fitter.refine(seen.pixels, replace(start, rotation=predicted.rotation), vertical)
            leans = leaning is not None and checks.refusal(seen, leaning) is None
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

    def start_branches(self, seen: Sight, candidates: Sequence[Pose]) -> Branches:
        """Branches that start in this image, the best candidate first; a single one is believed."""
        return Branches.begin(seen.time, candidates, moving=self._fitter.target.moving)

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
        self._track.branches = branches
        return verdict

    def _judge_without_attitude(self, seen: Sight, pose: Pose) -> Verdict:
        """Judge a fit by its mirror image, the images before and the vehicle's inertia."""
        checks, certain = self._checks, LIMITS.certainty
        if self._track.branches is None:
            return Verdict(pose, PoseRefusal.AMBIGUOUS)
        branches = self._track.branches.after(seen.time, checks.candidates(seen, pose))
        chosen, prior = branches.pose, branches.prior
        refused = None if chosen is pose else checks.refusal(seen, chosen)
        if refused is not None:
            return Verdict(None, refused)
        self._track.branches = branches
        if not branches.is_decided or branches.is_spoken_against:
            return Verdict(chosen, PoseRefusal.AMBIGUOUS)
        fused = with_angle_variance(prior.fuse(chosen), branches.doubt)
        # The branches allow for errors that last; to be published a pose has to fit by its own covariance.
        if branches.missed[0] or prior.mahalanobis2(chosen, 1.0) > certain.surprising:
            return Verdict(fused, PoseRefusal.OFF_COURSE)
        is_backed = prior.angle_sd < certain.blind_angle_sd
        is_plain = is_backed or checks.is_plain(seen, fused)
        if not is_plain and checks.is_partial(chosen):
            return Verdict(fused, PoseRefusal.INLIERS)
        refused = certainty_refusal(fused, has_attitude=False, is_plain=is_plain, is_backed=is_backed)
        return Verdict(fused, refused)


OVERRULED: Final = (PoseRefusal.ATTITUDE, PoseRefusal.ANGLE_UNCERTAIN, PoseRefusal.POSITION_UNCERTAIN)
"""Refusals beside an attitude of what the image alone, by its stricter gates, may publish."""


class FirstJudge:
    """Judges the first poses of one target.

    Args:
        checks: the target's gates.
    """

    def __init__(self, checks: Checks) -> None:
        self._checks = checks
        self._fitter = checks.fitter

    def choose(self, seen: Sight, candidates: Sequence[Pose]) -> Choice | PoseRefusal:
        """Decide about poses from decoded tags.

        Args:
            seen: the image.
            candidates: fitted poses.

        Returns:
            The one to publish, with the attitude's knowledge in it, or why there is none.
        """
        checks, level = self._checks, self._checks.level
        refusals = [checks.refusal(seen, pose) for pose in candidates]
        believable = [
            pose for pose, why in zip(candidates, refusals, strict=True) if why in (None, PoseRefusal.ATTITUDE)
        ]
        if not believable:
            return next(filter(None, refusals), PoseRefusal.NO_FIT)
        tilts = [level.tilt(seen, pose) for pose in believable]
        known = [tilt for tilt in tilts if tilt is not None]
        choice = choose(
            believable,
            min_ratio=checks.cfg.min_ambiguity_ratio,
            tilt_errors=known or None,
            tilt_gate=max(level.gate(seen, pose) for pose in believable),
        )
        if choice is None and known:
            return self._fit_level(seen, min(believable, key=lambda pose: pose.loss))
        choice = choice or self._choose_by_all_pixels(seen, believable)
        if choice is None:
            return PoseRefusal.AMBIGUOUS
        is_supported = False
        if choice.pose.source == "edges" and choice.pose.inliers < LIMITS.agreement.whole:
            # Hidden parts, or a border faked by what hides them: a held tilt tells these apart, or the edges seen.
            if known:
                return self._fit_level(seen, choice.pose)
            is_supported = self._fitter.is_supported(seen.pixels, choice.pose)
            if not is_supported:
                return PoseRefusal.INLIERS
        if choice.decided_by in ("unique", "image"):
            # Both starts may have run into one minimum, or one of them into none: the mirrored pose of a small tag is
            # asked for by name.
            decided = self._decide_mirror(seen, choice.pose)
            if decided is None:
                return PoseRefusal.AMBIGUOUS
            choice = replace(choice, pose=decided)
        fused = level.fuse(seen, choice.pose)
        refused = checks.refusal(seen, choice.pose) or certainty_refusal(
            fused, has_attitude=bool(known), is_plain=is_supported
        )
        return refused or replace(choice, pose=fused)

    def contradicting(
        self, seen: Sight, candidates: Sequence[Pose], verdict: Choice | PoseRefusal, followed: Pose | None = None
    ) -> Pose | None:
        """The pose that the image alone would publish, where the attitude refuses it or chose its mirror image.

        An attitude with both signs swapped agrees with the mirror image of a target in the middle of the image, which
        may be too uncertain to be published. What a track led to, and the image prefers to the mirror image that the
        attitude chose, contradicts it too.

        Args:
            seen: the image.
            candidates: fitted poses.
            verdict: about them.
            followed: what the track led to and the attitude refuses though nearly all edges agree with it.
        """
        chosen = verdict.pose if isinstance(verdict, Choice) else None
        is_refused = verdict in OVERRULED
        # Fits of two kinds do not compare.
        if followed is not None and (is_refused if chosen is None else prefers(followed, chosen)):
            return followed
        if not is_refused and not (isinstance(verdict, Choice) and verdict.decided_by == "attitude"):
            return None
        alone = self.choose(seen.without_attitude(), candidates)
        if not isinstance(alone, Choice):
            return None
        is_apart = chosen is None or angle_between(alone.pose.rotation, chosen.rotation) > LIMITS.certainty.wrong_angle
        return alone.pose if is_apart else None

    def _decide_mirror(self, seen: Sight, pose: Pose) -> Pose | None:
        """Compare a first pose that has no rival with its mirror image; none when nothing decides."""
        rivals = self._checks.candidates(seen, pose)
        choice = choose(rivals, min_ratio=self._checks.cfg.min_ambiguity_ratio)
        choice = choice or self._choose_by_all_pixels(seen, rivals)
        if choice is not None:
            return choice.pose
        return self._nearer_to_level(seen, rivals) if self._checks.level.knows(seen) else None

    def _choose_by_all_pixels(self, seen: Sight, rivals: Sequence[Pose]) -> Choice | None:
        """Choose between edge fits of a small target by all its pixels; none where nothing decides."""
        small = LIMITS.cells.small_px
        if any(rival.source != "edges" or self._checks.cell_px(rival) >= small for rival in rivals):
            return None
        grey = self._fitter.fit_grey_values(seen.pixels, rivals)
        return choose(grey, min_ratio=self._checks.cfg.min_ambiguity_ratio) if grey else None

    def _nearer_to_level(self, seen: Sight, rivals: Sequence[Pose]) -> Pose:
        """The rival that agrees better with the attitude; where both might, with the doubt in its covariance."""
        level = self._checks.level
        best, other = rivals if level.log_odds(seen, *rivals) > 0.0 else reversed(rivals)
        if (level.tilt(seen, other) or 0.0) > level.gate(seen, other):
            return best
        return with_rival(best, other, level.log_odds(seen, best, other))

    def _fit_level(self, seen: Sight, pose: Pose) -> Choice | PoseRefusal:
        """Fit once more with the tilt held: something lying over one side gives a quad that is off by that much."""
        checks, level = self._checks, self._checks.level
        vertical = level.vertical(seen)
        if vertical is None:
            return PoseRefusal.ATTITUDE
        upright = turn(pose.rotation, turn_between(pose.rotation[:, 2], vertical.up))
        held = self._fitter.refine(seen.pixels, replace(pose, rotation=upright), vertical)
        if held is None or checks.refusal(seen, held) is not None:
            return PoseRefusal.ATTITUDE
        if angle_of(held.rotation[:, 2], vertical.up) > level.hidden_gate(held):
            return PoseRefusal.ATTITUDE
        return certainty_refusal(held, has_attitude=True) or Choice(held, float("inf"), "attitude")
