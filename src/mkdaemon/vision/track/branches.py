"""Readings of a target's past, each a way of the lens carried on by the vehicle's inertia, and how likely each is.

Shaking turns a camera but hardly moves it. A constant-velocity Kalman filter on the place of the lens, seen from the
target, predicts the target's tilt against the line of sight without any attitude of the vehicle.

A pose and its mirror image explain one image of a small tag nearly as well. Each is a branch with its own course, and
every image adds what its residuals say for or against it. A course is one hypothesis; that a new course begins at the
fit is the other one. Three densities of the place z from which a candidate sees the target compare them:

* it is joined: N(z; course, S), S the covariance of both;
* it is missed, because the fit is wrong: the share of its points that disagrees, at least `LEAST_WRONG`, times a
  density that is even over the volume in which such a fit may lie. That is where the course may be, widened by what a
  fit misses by: det(C + (SCATTER r)^2 I)^-1/2, C the covariance of the course, r the range;
* a new course begins at z: `LEAVES` times a density that is even over what a fit misses by. It ends no branch: the old
  course goes on as missed, and the images that follow decide between both.

A course that knows less than a fit misses by cannot call a fit wrong: a course that was not joined for a second, or one
image old and close to the target. Without C in the volume it could, again and again, as its covariance grew.

Sources: white-noise acceleration model, Bar-Shalom, Li and Kirubarajan, Estimation with Applications to Tracking, 6.2;
multiple hypothesis tracking, Reid, IEEE TAC 24(6), 1979.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from mkdaemon.vision.arrays import Array, Bools
from mkdaemon.vision.limits import LIMITS
from mkdaemon.vision.pose.ambiguity import CAUTION, evidence, log_odds
from mkdaemon.vision.pose.pose import LEAST_NORM, Pose, inverse, moved
from mkdaemon.vision.pose.rolling import skew
from mkdaemon.vision.track.attitude import corrected, updated

AGREEMENT, AMBIGUITY, CERTAINTY = LIMITS.agreement, LIMITS.ambiguity, LIMITS.certainty
DECIDED = AMBIGUITY.decided
MOST_ODDS = 3.0 * DECIDED
"""Odds do not grow beyond [nats]: three images that decide lead out of a wrong branch."""
ACCELERATION_PSD = 1.0
"""Of a vehicle over a target at rest: 1.3 m/s^2 that last for 0.3 s [m^2/s^3]."""
MOVING_PSD = 25.0
"""The same where the target moves by itself, as a deck or another vehicle does [m^2/s^3]."""
LEAST_INLIERS = 1e-3
"""Share of points that agree; a fit with fewer has no place."""
FLOOR = 0.002
"""Deviation of the lens from what a pose says that is always possible, of the range."""
KEPT = 6
"""Branches that are followed: a pose, its mirror image and neither, each seen in the newest image or missed in it."""
ONE2 = 1.0
"""Squared distance of two states, in deviations of the likelier one, up to which they are one reading."""
SCATTER = 0.1
"""Deviation of a place that a wrong fit gives, of the range: six degrees of tilt."""
LEAST_WRONG = 0.01
"""Probability that a fit is wrong though all its points agree: a smeared view, a saddle between both readings."""
LEAVES = 0.001
"""Probability that a target leaves its course from one image to the next, once in half a minute."""
ANYWHERE = 1e8
"""Variance of a place about which nothing is known [m^2]."""


@dataclass(frozen=True, slots=True, eq=False)
class Course:
    """Position [m] and velocity [m/s] of the lens in the target's frame, by one history or by each of several.

    Attributes:
        time: [s].
        state: `(..., 6)`.
        covariance: of it `(..., 6, 6)`.
        psd: of the acceleration that is expected [m^2/s^3].
    """

    time: float
    state: Array
    covariance: Array
    psd: float = ACCELERATION_PSD

    @classmethod
    def begin(cls, time: float, centre: Array, spread: Array, psd: float = ACCELERATION_PSD) -> Course:
        """Start from places, at an unknown velocity; as `places` gives them."""
        covariance = np.zeros((len(centre), 6, 6))
        covariance[:, :3, :3] = spread
        covariance[:, 3:, 3:] = LIMITS.edges.speed_sd**2 * np.eye(3)
        return cls(time, np.hstack([centre, np.zeros_like(centre)]), covariance, psd)

    def __getitem__(self, which: Any) -> Course:
        """Some of several histories, as arrays are indexed."""
        return Course(self.time, self.state[which], self.covariance[which], self.psd)

    @property
    def centre(self) -> Array:
        """Position of the lens `(..., 3)` [m; target]."""
        return self.state[..., :3]

    @property
    def angle_sd(self) -> float:
        """Deviation of the direction from which the target is seen, by one history [rad]."""
        distance = max(float(np.linalg.norm(self.centre)), LEAST_NORM)
        sight, spread = self.centre / distance, self.covariance[:3, :3]
        # Of the three variances of the place the one along the sight is no direction.
        return float(np.sqrt((np.trace(spread) - sight @ spread @ sight) / 2)) / distance

    def predict_at(self, time: float) -> Course:
        """The same course at a later time, before anything is seen: P' = F P F^T + Q, Q of a white acceleration."""
        dt = time - self.time
        # Source: Bar-Shalom et al., Estimation with Applications to Tracking and Navigation, 2001, 6.2.2.
        move = np.eye(6) + dt * np.eye(6, k=3)
        mixed = np.eye(6, k=3) + np.eye(6, k=-3)
        noise = self.psd * (np.diag([dt**3 / 3] * 3 + [dt] * 3) + dt**2 / 2 * mixed)
        return Course(time, self.state @ move.T, move @ self.covariance @ move.T + noise, self.psd)

    def join(self, centre: Array, spread: Array) -> tuple[Course, Array]:
        """The course after a place, and the logarithm of the density of that place before; as `places` gives them."""
        step, covariance, density = corrected(self.covariance, np.eye(3, 6), centre - self.centre, spread)
        return Course(self.time, self.state + step, covariance, self.psd), density

    def mahalanobis2(self, pose: Pose) -> float:
        """Squared distance of a pose from one history by what both say of themselves, three degrees of freedom."""
        (centre,), (spread,) = places([pose], 1.0)
        error = centre - self.centre
        return float(error @ np.linalg.solve(self.covariance[:3, :3] + spread, error))

    def fuse(self, pose: Pose) -> Pose:
        """A pose with what one history knew before it about where the lens is: c = -R^T p; dc = -R^T dp - R^T [p]x w.

        A pose that surprises the course makes it as uncertain as the surprise is large: the ratio of Birge, Physical
        Review 40 (1932), 207.
        """
        known = max(1.0, self.mahalanobis2(pose) / 3.0) * self.covariance[:3, :3]
        back = pose.rotation.T
        jacobian = np.hstack([-back, -back @ skew(pose.position)])
        return updated(pose, jacobian, self.centre + back @ pose.position, known + 1e-12 * np.eye(3))


@dataclass(frozen=True, slots=True, eq=False)
class Branches:
    """The n likeliest readings of the past, the best first.

    Attributes:
        course: of each, after the newest image.
        weight: log odds of each against the best, zero or less `(n,)`.
        missed: whether no candidate of the newest image belongs to it `(n,)`.
        together: what the newest images together say against each reading, however little each says `(n,)` [nats].
        prior: course of the best before the newest image; anywhere before the first.
        pose: the candidate of that image that belongs to the best; the nearest where it was missed.
    """

    course: Course
    weight: Array
    missed: Bools
    together: Array
    prior: Course
    pose: Pose

    @staticmethod
    def begin(
        time: float, candidates: Sequence[Pose], log_prior: Array | None = None, *, moving: bool = False
    ) -> Branches:
        """Start from the m candidates of one image at a time [s]; a single one is known to be true.

        `log_prior`: logarithm of the density of each by what is known beside the image `(m,)`.
        """
        course = Course.begin(time, *places(candidates), MOVING_PSD if moving else ACCELERATION_PSD)
        weight = (0.0 if log_prior is None else log_prior) - _evidence(candidates)
        missed, together = np.zeros(len(weight), dtype=bool), np.zeros(len(weight))
        anywhere = replace(course, covariance=np.array([ANYWHERE * np.eye(6)] * len(weight)))
        return _likeliest(course, weight, missed, together, anywhere, candidates)

    def moved(self, by: Array) -> Branches:
        """The same readings against another point of the rigid target, `by` from its origin `(3,)` [m; target]."""
        shift = np.append(by, np.zeros(3))
        course, prior = (replace(one, state=one.state - shift) for one in (self.course, self.prior))
        return replace(self, course=course, prior=prior, pose=moved(self.pose, by))

    @property
    def lead(self) -> float:
        """Log odds of the likeliest branch against the next that means another pose."""
        rivals = self.weight[self._apart > CERTAINTY.wrong_angle]
        return -float(rivals.max()) if rivals.size else MOST_ODDS

    @property
    def is_decided(self) -> bool:
        """Whether the most likely branch is used."""
        return self.lead >= DECIDED

    @property
    def is_spoken_against(self) -> bool:
        """Whether images together say more against the likeliest branch than what it leads by beyond `decided`."""
        return bool(self.together[0] > min(self.lead - DECIDED, DECIDED))

    @property
    def doubt(self) -> float:
        """Variance of the direction from what is left of other branches close to the likeliest [rad^2]."""
        apart = self._apart
        odds = np.exp(self.weight) * (apart <= CERTAINTY.wrong_angle)
        return float((odds * apart**2).sum() / odds.sum())

    @property
    def _apart(self) -> Array:
        """Angle between the directions from which the likeliest branch and each of them see the target [rad]."""
        return _angles(self.course.centre[:1], self.course.centre).ravel()

    def after(self, time: float, candidates: Sequence[Pose]) -> Branches:
        """Go on with the m candidates of a new image: each branch is joined by each of them, or missed."""
        prior, (centre, spread) = self.course.predict_at(time), places(candidates)
        # Multiple hypotheses after D. Reid, IEEE Trans. Automatic Control 24(6), 1979: each branch with each candidate.
        # Three densities of the place of the lens, all per m^3, so that they compare (constant factors left out):
        # joined N(z; course, S); a leap LEAVES / scatter^3; missed (1 - inliers) / sqrt(det(P + scatter^2 I)).
        joined, density = prior[:, None].join(centre, spread)
        scatter = np.array([SCATTER * pose.range_m for pose in candidates])
        leaps = np.log(LEAVES) - 3.0 * np.log(scatter)
        started, leapt = Course.begin(time, centre, spread), (density <= leaps)[..., None]
        joins = np.maximum(density, leaps) - _evidence(candidates)
        nearest = density.argmax(axis=1)
        wrong = np.log([max(1.0 - pose.inliers, LEAST_WRONG) for pose in candidates])[nearest]
        around = prior.covariance[:, :3, :3] + (scatter[nearest] ** 2)[:, None, None] * np.eye(3)
        misses = wrong - np.linalg.slogdet(around)[1] / 2.0
        # Of every branch first all that join it, then the one that missed.
        state = np.concatenate([np.where(leapt, started.state, joined.state), prior.state[:, None]], axis=1)
        covariance = np.where(leapt[..., None], started.covariance, joined.covariance)
        covariance = np.concatenate([covariance, prior.covariance[:, None]], axis=1)
        course = Course(time, state.reshape(-1, 6), covariance.reshape(-1, 6, 6), prior.psd)
        weight = (self.weight[:, None] + np.column_stack([joins, misses])).ravel()
        parent, chosen = np.divmod(np.arange(len(weight)), len(candidates) + 1)
        missed = chosen == len(candidates)
        chosen[missed] = nearest
        together = self._summed_against(centre, candidates)[chosen]
        return _likeliest(course, weight, missed, together, prior[parent], [candidates[k] for k in chosen])

    def _summed_against(self, centre: Array, candidates: Sequence[Pose]) -> Array:
        """What images together say against the reading of each candidate, their own image included `(m,)` [nats]."""
        # A reading is where the target is seen from: one history of it may begin with a leap from the other.
        apart = _angles(self.course.centre, centre)
        near = np.maximum(CERTAINTY.wrong_angle, apart.min(axis=0))
        # Where both readings are nearly one, what was said against one of them says nothing.
        before = np.where(apart <= near, self.together[:, None], np.inf).min(axis=0)
        odds = [min((log_odds(a, b) for b in candidates if b is not a), default=0.0) for a in candidates]
        return np.asarray(np.clip(AMBIGUITY.remembered * before - odds, 0.0, MOST_ODDS))


def places(poses: Sequence[Pose], caution: float | None = None) -> tuple[Array, Array]:
    """Positions of the lens by poses `(m, 3)` [m; target], and covariances `(m, 3, 3)`, `caution` times the poses'."""
    centre, spread = np.empty((len(poses), 3)), np.empty((len(poses), 3, 3))
    for k, pose in enumerate(poses):
        factor = CAUTION * shared_doubt(pose) if caution is None else caution
        _, centre[k], covariance = inverse(pose, factor * pose.covariance)
        spread[k] = covariance[:3, :3] + (FLOOR * pose.range_m) ** 2 * np.eye(3)
    return centre, spread


def shared_doubt(pose: Pose) -> float:
    """Factor on a pose's variance for what images in a row teach: what lies over some points of it stays there."""
    return 1.0 / max(pose.inliers, LEAST_INLIERS) ** AGREEMENT.power


def lasting_doubt(pose: Pose) -> float:
    """The same for a state that only images teach: where points disagree, they do so alike from image to image."""
    return shared_doubt(pose) * (CAUTION if pose.inliers < AGREEMENT.whole else 1.0)


def _evidence(candidates: Sequence[Pose]) -> Array:
    """What one image takes off the log odds of each fit for the sake of the best, zero or more `(m,)`."""
    best = min(candidates, key=lambda pose: pose.loss)
    return np.array([0.0 if pose is best else evidence(best, pose) for pose in candidates])


def _angles(some: Array, others: Array) -> Array:
    """Angles between directions `(n, 3)` and `(m, 3)`, `(n, m)` [rad]."""
    a, b = (x / np.maximum(np.linalg.norm(x, axis=1, keepdims=True), LEAST_NORM) for x in (some, others))
    return np.asarray(np.arccos(np.clip(a @ b.T, -1.0, 1.0)))


def _likeliest(
    course: Course, weight: Array, missed: Bools, together: Array, prior: Course, poses: Sequence[Pose]
) -> Branches:
    """The few of many branches that are followed, by the attributes of each."""
    # Copies of a reading are one, or they would crowd out others, which would then count as impossible.
    step = course.state[:, None] - course.state
    is_same = ((step @ np.linalg.inv(course.covariance)) * step).sum(axis=-1) < ONE2
    is_followed = (weight > weight.max() - MOST_ODDS) | ~missed
    left, odds = [k for k in np.argsort(-weight, kind="stable").tolist() if is_followed[k]], dict[int, float]()
    while left:
        likeliest, *others = left
        left = [k for k in others if not is_same[likeliest, k]]
        odds[likeliest] = float(np.logaddexp.reduce(weight[[likeliest, *(k for k in others if k not in left)]]))
    # Of those whose difference would be wrong each has a place first; before others those that join the newest image.
    apart, kept = _angles(course.centre, course.centre), list[int]()
    for k in sorted(odds, key=lambda k: bool(missed[k])):
        if len(kept) < KEPT and bool((apart[k, kept] > CERTAINTY.wrong_angle).all()):
            kept.append(k)
    kept += [k for k in odds if k not in kept][: KEPT - len(kept)]
    kept.sort(key=lambda k: -odds[k])
    best = kept[0]
    lead = np.maximum(np.array([odds[k] - odds[best] for k in kept]), -MOST_ODDS)
    return Branches(course[kept], lead, missed[kept], together[kept], prior[best], poses[best])
