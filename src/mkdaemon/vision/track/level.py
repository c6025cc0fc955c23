"""Estimates the tilt of a target that should lie level, and an error of the vehicle's attitude: two pairs of angles.

A deck that is tilted lies so in the world; an attitude that is biased, or a mounting, is off in the vehicle. An image
measures their sum, the target's normal by the attitude; when the vehicle's heading turns, the error turns with it and
the deck does not.

A deck may rest or rock; an attitude may be wrong altogether, or be shaken, another one in every image. All four kinds
are followed, each as likely as its predictions make it. An attitude that is likelier wrong is left out, until it is
likelier right.

Source: interacting multiple models, Blom and Bar-Shalom, IEEE TAC 33(8), 1988.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import degrees, exp, hypot, log, radians, sqrt
from typing import Final

import numpy as np

from mkdaemon.config.vision import TrackerSection
from mkdaemon.vision.arrays import Array
from mkdaemon.vision.limits import LIMITS
from mkdaemon.vision.pose.pose import Pose, largest_variance
from mkdaemon.vision.pose.rolling import skew
from mkdaemon.vision.pose.unknowns import TargetLevel
from mkdaemon.vision.track.attitude import ImageSight, Mounting, angle_of, corrected
from mkdaemon.vision.track.branches import lasting_doubt

PRIOR_SD: Final = radians(2.5)
"""Deviation of the normal before an image measured it, each axis [rad]: half its variance is the attitude's."""
HALF_DEG: Final = degrees(PRIOR_SD / sqrt(2.0))
KINDS: Final = np.array(
    [
        [0.4745, HALF_DEG, 0.1, 0.25, 0.0],  # a deck that rests
        [0.4745, HALF_DEG, 2.0, 0.25, 0.0],  # a deck that rocks
        [0.05, 15.0, 6.0, 6.0, 0.0],  # an attitude that is wrong: a swapped sign turns with the vehicle
        [0.001, HALF_DEG, 0.1, 0.25, 5.0],  # one that is shaken: the wobble of a vibration behind a rolling shutter
    ]
)
"""Of each kind the probability, before an image was seen and of each that follows another one; the deviation of deck
and error before an image was seen; the random walk of the deck and of the error [deg/sqrt(s)]; the noise of the
attitude. All deviations are those of each axis [deg]."""
EXPECTED: Final = KINDS[:, 0]
SPREADS, NOISES = np.radians(KINDS[:, 1]), np.radians(KINDS[:, 4])
DRIFTS: Final = np.radians(KINDS[:, [2, 2, 3, 3]])
DECKS, WRONG = slice(2), 2
FOLLOWS: Final = np.array([[1, 1, 0, 0, 0], [1, 1, 0, 0, 0], [0, 0, 0, 0, 1], [0, 0, 0, 0, 0]])
"""Which kind begins where another one was, or, the last column, anywhere."""
MIXING: Final = 10.0
"""Mean time after which any kind may follow [s]; a deck that rests or rocks continues for twice this time."""
MISSED: Final = log(0.01 / radians(20.0) ** 2)
"""Density of the normal of a wrong fit, one of a hundred, spread over 20 degrees, as `attitude.corrected` tells it."""
LEAST_WEIGHT: Final = 1e-12
"""Of a kind that the images contradict."""
UP: Final = np.array([0.0, 0.0, 1.0])
MOST_LEAN: Final = 4.0 * PRIOR_SD
"""Of a level target by a right attitude [rad]."""
LONGEST: Final = 10.0
"""Time without a measurement after which only the prior is known [s]."""
FAST: Final = radians(0.5)
"""Deviation of an attitude from one image to the next, each axis [rad]: what lasts is in the state of the deck."""


@dataclass(frozen=True, slots=True, eq=False)
class _Belief:
    """Probability of each kind `(4,)`, and mean `(4, 4)` and covariance `(4, 4, 4)` of four angles by it [rad].

    The horizontal part of the deck's normal, east and north; the attitude's error about the vehicle's roll and pitch.
    """

    weight: Array
    mean: Array
    covariance: Array

    def expected(self, observe: Array) -> tuple[Array, float]:
        """The normal that is expected of a deck `(3,)` [ENU], and its deviation along its worse axis [rad].

        With what is observed by both decks m_i and P_i, the covariance is sum(w P) + sum(w m_i m_i^T) - m m^T.
        """
        weight = self.weight[DECKS] / self.weight[DECKS].sum()
        seen = self.mean[DECKS] @ observe.T
        mean = weight @ seen
        spread = observe @ np.einsum("i,ijk", weight, self.covariance[DECKS]) @ observe.T
        spread += (weight[:, None] * seen).T @ seen - mean[:, None] * mean
        normal = np.append(mean, sqrt(max(1.0 - float(mean @ mean), 0.0)))
        return normal, min(sqrt(largest_variance(spread)), PRIOR_SD)

    def later(self, passed: float) -> _Belief:
        """The same after some time [s]: another kind may have followed, and all drifts."""
        # A mixture moves on as one Gaussian for each kind, of the same mean and covariance as what led to it:
        # m_i = sum_j(w_ij m_j), P_i = sum_j(w_ij (P_j + m_j m_j^T)) - m_i m_i^T.
        # Source: H. Blom, Y. Bar-Shalom, IEEE Trans. Automatic Control 33 (1988), 780: interacting multiple models.
        stays = exp(-passed / MIXING)
        restarted = (1.0 - stays) * EXPECTED
        came = restarted[:, None] * FOLLOWS * np.append(self.weight, 1.0)
        came[:, :-1] += np.diag(stays * self.weight)
        came /= came.sum(axis=1, keepdims=True)
        mean = came[:, :-1] @ self.mean
        second = np.concatenate([self.covariance + self.mean[:, :, None] * self.mean[:, None], ANYHOW])
        spread = np.einsum("ij,jkl", came, second) - mean[:, :, None] * mean[:, None]
        return _Belief(stays * self.weight + restarted, mean, spread + (DRIFTS**2 * passed)[:, None] * np.eye(4))

    def measured(self, observe: Array, normal: Array, covariance: Array, *, may_be_deck: bool) -> _Belief:
        """Kalman updates, each weight times the density of its surprise; a kind that missed it learns nothing."""
        noise = covariance + (NOISES**2)[:, None, None] * np.eye(2)
        step, after, density = corrected(self.covariance, observe, normal - self.mean @ observe.T, noise)
        if not may_be_deck:
            density[DECKS] = -np.inf
        learns = (density > MISSED)[:, None]
        # Bayes: w_i is in proportion to w_i N(surprise_i), and to w_i exp(MISSED) for a kind that the fit missed.
        weight = np.exp(np.maximum(density, MISSED)) * self.weight
        weight = np.maximum(weight / weight.sum(), LEAST_WEIGHT)
        mean, spread = self.mean + learns * step, np.where(learns[:, None], after, self.covariance)
        return _Belief(weight, mean, spread)


PRIOR: Final = _Belief(EXPECTED, np.zeros((4, 4)), (SPREADS**2)[:, None, None] * np.eye(4))
"""Before anything was measured."""
ANYHOW: Final = PRIOR.covariance[WRONG : WRONG + 1]


class LevelKnowledge:
    """Knows where the normal of one target should point in an image, and learns how the target really lies.

    Args:
        is_level: whether the target lies level; the attitude says nothing about others.
        mounting: of the camera; none when unknown, and then the attitude says nothing.
        cfg: how well the attitude is known.

    Attributes:
        contradicted_deg: by how much images contradict the attitude [deg]; none while they do not.
    """

    def __init__(self, is_level: bool, mounting: Mounting | None, cfg: TrackerSection) -> None:
        self._cam_from_flu = mounting.flu_from_cam.T if is_level and mounting is not None else None
        self._spread = float(np.radians(cfg.attitude_sd_deg))
        self._gate = float(np.radians(cfg.attitude_gate_deg))
        self.forget()

    def forget(self) -> None:
        """Forget how the target lies."""
        self._belief, self._time, self._asked = PRIOR, -np.inf, (-np.inf, PRIOR)
        self.contradicted_deg: float | None = None

    def sight(self, seen: ImageSight) -> ImageSight:
        """The image with its attitude; without, while images contradict it. One without evidence for long is tried."""
        if not 0.0 <= seen.time - self._time <= LONGEST:
            self.contradicted_deg = None
        return seen if self.contradicted_deg is None else seen.without_attitude()

    def vertical(self, seen: ImageSight) -> TargetLevel | None:
        """The normal expected in camera axes, with its deviation; none where nothing is known."""
        known = self._attitude(seen)
        if known is None:
            return None
        normal, sd = self._at(seen.time).expected(known[1])
        return TargetLevel(known[0].T @ normal, hypot(min(self._spread, FAST), sd))

    def refuses(self, level: TargetLevel, pose: Pose, *, is_hidden: bool = False) -> bool:
        """Whether a pose is too far from the expectation; `is_hidden`: see `Judge.refusal`."""
        spread = min(float(np.sqrt(largest_variance(pose.covariance[3:, 3:]))), LIMITS.certainty.angle_sd)
        gate = self._gate + spread + (0.0 if is_hidden else level.spread)
        return angle_of(pose.rotation[:, 2], level.up) > gate

    def learn(self, seen: ImageSight, pose: Pose) -> bool:
        """Take in how the target lies, by a pose that the image alone decided; whether that leaves the attitude out."""
        known = self._attitude(seen)
        if known is None:
            return False
        enu_from_cam, observe = known
        normal, spread = enu_from_cam @ pose.rotation[:, 2], pose.covariance[3:, 3:]
        # A small turn w moves the normal n by w x n; its horizontal part is what the deck is known by.
        moved = -(enu_from_cam @ skew(pose.rotation[:, 2]))[:2]
        covariance = lasting_doubt(pose) * (moved @ spread @ moved.T) + self._spread**2 * np.eye(2)
        was_left_out, before = self.sight(seen) is not seen, self._at(seen.time)
        may_be_deck = angle_of(normal, UP) <= MOST_LEAN
        self._belief = before.measured(observe, normal[:2], covariance, may_be_deck=may_be_deck)
        self._time, self._asked = seen.time, (-np.inf, PRIOR)
        wrong = self._belief.weight[WRONG]
        odds = log(wrong / (self._belief.weight.sum() - wrong))
        is_left_out = odds > 0.0 if abs(odds) >= LIMITS.ambiguity.decided else was_left_out
        self.contradicted_deg = degrees(angle_of(normal, before.expected(observe)[0])) if is_left_out else None
        return is_left_out and not was_left_out

    def _attitude(self, seen: ImageSight) -> tuple[Array, Array] | None:
        """The camera's attitude `(3, 3)`, and how deck and error move the normal that it makes of an image `(2, 4)`."""
        if seen.enu_from_cam is None or self._cam_from_flu is None:
            return None
        # A small turn b of the vehicle moves a vertical normal by (R b) x up = (b'_north, -b'_east), b' = R b.
        (east, by_east), (north, by_north) = (seen.enu_from_cam @ self._cam_from_flu)[:2, :2].tolist()
        return seen.enu_from_cam, np.array([[1.0, 0.0, north, by_north], [0.0, 1.0, -east, -by_east]])

    def _at(self, time: float) -> _Belief:
        """What is known at a time, before anything is measured then."""
        if time != self._asked[0]:
            passed = time - self._time
            self._asked = time, self._belief.later(passed) if 0.0 <= passed <= LONGEST else PRIOR
        return self._asked[1]
