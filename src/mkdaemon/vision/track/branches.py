"""Both readings of a far target kept alive over consecutive images until they can be told apart.

A pose and its mirror image explain one image of a small tag nearly as well. Each is a branch with its own course;
every image adds what its residuals say for or against, in odds, and what inertia says about which of the new candidates
is the old one. A branch that has won stays chosen without asking every image anew.

All three things that may become of a branch are densities of the place z from which a candidate sees the target, so
that they compare whatever the range and however long nothing was seen:

* it is joined: N(z; course, S), S the covariance of both;
* it is missed, because the fit is wrong: the share of its points that disagrees, at least `LEAST_WRONG`, times a
  density that is even over what a fit misses by;
* the target has left the course, which begins anew: `LEAVES` times the same density.

Source: multiple hypothesis tracking, Reid, IEEE TAC 24(6), 1979.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import log

import numpy as np
import numpy.typing as npt

from mkdaemon.vision.limits import LIMITS
from mkdaemon.vision.pose.ambiguity import log_odds
from mkdaemon.vision.pose.pose import Pose
from mkdaemon.vision.track.attitude import angle_of
from mkdaemon.vision.track.course import ACCELERATION_PSD, MOVING_PSD, Course

Array = npt.NDArray[np.float64]

BRANCHES = LIMITS.branches
KEPT = 6
"""Branches that are followed: a pose, its mirror image and neither, each seen in the newest image or missed in it."""
SCATTER = 0.1
"""Deviation of a place that a wrong fit gives, of the range: six degrees of tilt."""
LEAST_WRONG = 0.01
"""Probability that a fit is wrong though all its points agree: a smeared view, a saddle between both readings."""
LEAVES = 0.001
"""Probability that a target leaves its course from one image to the next, once in half a minute."""


@dataclass(frozen=True, slots=True, eq=False)
class Branch:
    """One reading of the past.

    Attributes:
        course: after the newest image.
        prior: the same before it was seen.
        pose: the candidate of the newest image that belongs to it.
        weight: log odds against the best branch, zero or less.
        missed: whether no candidate belongs to it; `pose` is the nearest.
        together: what the newest images together say against this reading, however little each of them says [nats].
    """

    course: Course
    prior: Course
    pose: Pose
    weight: float
    missed: bool = False
    together: float = 0.0

    def next(self, time: float, candidates: Sequence[Pose], together: Sequence[float]) -> list[Branch]:
        """Everything that may have become of this branch in a new image; `together` of every candidate."""
        prior = self.course.predict_at(time)
        likeliest = min(candidates, key=lambda pose: pose.loss)
        found = []
        for pose, against_it in zip(candidates, together, strict=True):
            anywhere = -3.0 * log(SCATTER * pose.range_m)
            joins, leaps = prior.log_density(pose), log(LEAVES) + anywhere
            course = prior.correct(pose) if joins > leaps else Course.begin(time, pose, prior.psd)
            weight = self.weight - _evidence(likeliest, pose) + max(joins, leaps)
            found.append(Branch(course, prior, pose, weight, together=against_it))
        k = max(range(len(candidates)), key=lambda j: prior.log_density(candidates[j]))
        nearest = candidates[k]
        misses = log(max(1.0 - nearest.inliers, LEAST_WRONG)) - 3.0 * log(SCATTER * nearest.range_m)
        return [*found, Branch(prior, prior, nearest, self.weight + misses, missed=True, together=together[k])]


@dataclass(frozen=True, slots=True, eq=False)
class Branches:
    """Readings of the past.

    Attributes:
        ranked: the likeliest first; at least one.
    """

    ranked: tuple[Branch, ...]

    @classmethod
    def begin(cls, time: float, candidates: Sequence[Pose], *, decided: bool, moving: bool = False) -> Branches:
        """Start from the candidates of one image.

        Args:
            time: of the image [s].
            candidates: at least one, the best first.
            decided: whether the first is already known to be true.
            moving: whether the target moves by itself.
        """
        psd = MOVING_PSD if moving else ACCELERATION_PSD
        found: list[Branch] = []
        for pose in candidates:
            against = BRANCHES.certain if decided and found else _evidence(candidates[0], pose)
            course = Course.begin(time, pose, psd)
            found.append(Branch(course, course, pose, -against))
        return cls(_prune(found))

    @property
    def best(self) -> Branch:
        """The likeliest."""
        return self.ranked[0]

    @property
    def lead(self) -> float:
        """Log odds of the likeliest branch against the next that means another pose."""
        rivals = [b.weight for b in self.ranked[1:] if _apart(self.best, b) > LIMITS.certainty.wrong_angle]
        return -max(rivals, default=-BRANCHES.certain)

    @property
    def is_decided(self) -> bool:
        """Whether the likeliest branch is believed."""
        return self.lead >= LIMITS.ambiguity.decided

    @property
    def is_spoken_against(self) -> bool:
        """Whether images speak against the likeliest branch, the newest by itself or several together.

        Together they may say no more than what it leads by beyond `decided`: a course that a poor fit threw aside lets
        its rival lead by one jump, whatever image after image says.
        """
        spare = min(self.lead - LIMITS.ambiguity.decided, LIMITS.ambiguity.decided)
        return self.best.together > spare

    @property
    def doubt(self) -> float:
        """Variance of the direction from what is left of other branches close to the likeliest [rad^2]."""
        odds = np.exp([b.weight for b in self.ranked])
        apart = np.array([_apart(self.best, b) for b in self.ranked])
        close = apart <= LIMITS.certainty.wrong_angle
        return float((odds * apart**2)[close].sum() / odds[close].sum())

    def after(self, time: float, candidates: Sequence[Pose]) -> Branches:
        """Go on with the candidates of a new image."""
        together = [self._sum_against(pose, candidates) for pose in candidates]
        found = [grown for branch in self.ranked for grown in branch.next(time, candidates, together)]
        return Branches(_prune(found))

    def _sum_against(self, pose: Pose, candidates: Sequence[Pose]) -> float:
        """What images together say against the reading that a candidate belongs to, its own image included [nats].

        A reading is where the target is seen from, not one history of it: that may begin with a leap from the other.
        """
        place = -pose.rotation.T @ pose.position
        apart = [angle_of(branch.course.centre, place) for branch in self.ranked]
        near = max(LIMITS.certainty.wrong_angle, min(apart))
        # Where both readings are nearly one, what was said against one of them says nothing.
        before = min(branch.together for branch, angle in zip(self.ranked, apart, strict=True) if angle <= near)
        odds = min((log_odds(pose, other) for other in candidates if other is not pose), default=0.0)
        return float(np.clip(BRANCHES.remembered * before - odds, 0.0, BRANCHES.certain))


def _evidence(better: Pose, worse: Pose) -> float:
    """What one image adds to the log odds of the better of two fits, zero or more."""
    if better is worse:
        return 0.0
    trusted = BRANCHES.trusted_share * (log_odds(better, worse) - BRANCHES.silent)
    return float(np.clip(trusted, 0.0, LIMITS.ambiguity.decided))


def _apart(a: Branch, b: Branch) -> float:
    """Angle between the directions from which two branches see the target [rad]."""
    return angle_of(a.course.centre, b.course.centre)


def _prune(found: list[Branch]) -> tuple[Branch, ...]:
    """The likeliest few that differ, their weights against the best; other answers come before more of the same.

    Histories of one answer may be more than are kept. What they crowd out would count as impossible: a branch would be
    believed because nobody followed its rival, or a target that leapt off every course would never be joined again. So
    answers that the newest image gave come before those that missed it: histories that drift apart are answers each,
    and six of them that miss image after image would leave no place for one that joins.
    """
    top = max(branch.weight for branch in found)
    lost = top - BRANCHES.certain
    order = sorted((b for b in found if b.weight > lost or not b.missed), key=lambda branch: -branch.weight)
    answers: list[Branch] = []
    for branch in sorted(order, key=lambda branch: branch.missed):
        if all(_apart(branch, other) > LIMITS.certainty.wrong_angle for other in answers):
            answers.append(branch)
    kept = answers[:KEPT]
    kept += [branch for branch in order if branch not in kept][: KEPT - len(kept)]
    kept.sort(key=lambda branch: -branch.weight)
    return tuple(replace(branch, weight=max(branch.weight - top, -BRANCHES.certain)) for branch in kept)
