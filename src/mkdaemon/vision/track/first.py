"""Deciding about poses from decoded tags, without a track or against it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import numpy.typing as npt

from mkdaemon.telemetry.vision import PoseRefusal
from mkdaemon.vision.limits import LIMITS
from mkdaemon.vision.pose.ambiguity import Choice, choose, prefers
from mkdaemon.vision.pose.gates import certainty_refusal
from mkdaemon.vision.pose.pose import Pose, angle_between
from mkdaemon.vision.track.checks import Checks, with_rival
from mkdaemon.vision.track.level import Sight

Array = npt.NDArray[np.float64]


OVERRULED: Final = (PoseRefusal.ATTITUDE, PoseRefusal.ANGLE_UNCERTAIN, PoseRefusal.POSITION_UNCERTAIN)
"""Refusals beside an attitude of what the image alone, by its stricter gates, may publish."""


@dataclass(frozen=True, slots=True, eq=False)
class FirstVerdict:
    """Which of several first poses is published; one of the two is none.

    Attributes:
        choice: the pose, with the attitude's knowledge in it.
        refusal: why there is none.
    """

    choice: Choice | None
    refusal: PoseRefusal | None


class FirstJudge:
    """Judges the first poses of one target.

    Args:
        checks: the target's gates.
    """

    def __init__(self, checks: Checks) -> None:
        self._checks = checks
        self._fitter = checks.fitter

    def choose(self, seen: Sight, candidates: Sequence[Pose]) -> FirstVerdict:
        """Decide about poses from decoded tags.

        Args:
            seen: the image.
            candidates: fitted poses.
        """
        checks, level = self._checks, self._checks.level
        refusals = [checks.refusal(seen, pose) for pose in candidates]
        believable = [
            pose for pose, why in zip(candidates, refusals, strict=True) if why in (None, PoseRefusal.ATTITUDE)
        ]
        if not believable:
            return _refused(refusals[0] if refusals else PoseRefusal.NO_FIT)
        tilts = [level.tilt(seen, pose) for pose in believable]
        known = [tilt for tilt in tilts if tilt is not None]
        conclusive = [pose for pose in believable if checks.is_conclusive(seen, pose)]
        if known and conclusive and min(known) > max(level.gate(seen, pose) for pose in believable):
            known = []  # the deck lies otherwise, and the image alone tells how
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
            return _refused(PoseRefusal.AMBIGUOUS)
        is_supported = False
        if choice.pose.source == "edges" and choice.pose.inliers < LIMITS.agreement.whole:
            # Hidden parts, or a border faked by what hides them: a held tilt tells these apart, or the edges seen.
            if known:
                return self._fit_level(seen, choice.pose)
            is_supported = self._fitter.is_supported(seen.pixels, choice.pose)
            if not is_supported:
                return _refused(PoseRefusal.INLIERS)
        if choice.decided_by in ("unique", "image"):
            # Both starts may have run into one minimum, or one of them into none: the mirrored pose of a small tag is
            # asked for by name.
            decided = self._decide_mirror(seen, choice.pose)
            if decided is None:
                return _refused(PoseRefusal.AMBIGUOUS)
            choice = replace(choice, pose=decided)
        fused = level.fuse(seen, choice.pose)
        refused = checks.refusal(seen, choice.pose) or certainty_refusal(
            fused, has_attitude=bool(known), is_plain=is_supported
        )
        return _refused(refused) if refused is not None else FirstVerdict(replace(choice, pose=fused), None)

    def contradicting(
        self, seen: Sight, candidates: Sequence[Pose], verdict: FirstVerdict, followed: Pose | None = None
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
        if followed is not None and self._is_preferred(followed, verdict):
            return followed
        is_overruled = verdict.choice is not None and verdict.choice.decided_by == "attitude"
        if not is_overruled and verdict.refusal not in OVERRULED:
            return None
        alone = self.choose(seen.without_attitude(), candidates).choice
        if alone is None:
            return None
        if verdict.choice is None:
            return alone.pose
        apart = angle_between(alone.pose.rotation, verdict.choice.pose.rotation)
        return alone.pose if apart > LIMITS.certainty.wrong_angle else None

    def _is_preferred(self, followed: Pose, verdict: FirstVerdict) -> bool:
        """Whether the image prefers the pose that a track led to; fits of two kinds do not compare."""
        if verdict.choice is None:
            return verdict.refusal in OVERRULED
        return prefers(followed, verdict.choice.pose)

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

    def _fit_level(self, seen: Sight, pose: Pose) -> FirstVerdict:
        """Fit once more with the tilt held: something lying over one side gives a quad that is off by that much."""
        vertical = self._checks.level.vertical(seen)
        if vertical is None:
            return _refused(PoseRefusal.ATTITUDE)
        held = self._fitter.refine(seen.pixels, self._checks.level.replace_tilt(seen, pose), vertical)
        if held is None or self._checks.refusal(seen, held) is not None:
            return _refused(PoseRefusal.ATTITUDE)
        tilt = self._checks.level.tilt(seen, held)
        if tilt is not None and tilt > self._checks.level.hidden_gate(held):
            return _refused(PoseRefusal.ATTITUDE)
        refused = certainty_refusal(held, has_attitude=True)
        return _refused(refused) if refused is not None else FirstVerdict(Choice(held, float("inf"), "attitude"), None)


def _refused(why: PoseRefusal | None) -> FirstVerdict:
    return FirstVerdict(None, why)
