"""How a target that should lie level really lies, as the vehicle's attitude sees it: a slow state of two angles.

A deck may be tilted, and the attitude may be biased by its mounting: together they are one disagreement between the
target's normal and the vertical. Poses that were found without it measure it; between them it drifts.

How fast it drifts nobody knows before: a pad on the ground stays as it lies, a ship's deck rocks. Both are followed,
each as likely as its predictions make it. An image of a far target hardly tells a tilt; over a deck that rested while
it was seen better, what was learned then still counts.

Source: interacting multiple models, Blom and Bar-Shalom, IEEE TAC 33(8), 1988.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import exp, hypot, radians, sqrt
from typing import Final

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

PRIOR_SD: Final = radians(2.5)
"""Deviation of the normal from the vertical before an image measured it, each axis [rad].

Over a deck tilted by 5 degrees 1 degree gave 2 wrong poses of 340, 2 and 3 degrees none; with 4 degrees 3 of 42 first
poses far away lose their certainty.
"""
MOVING: Final = 1
DRIFTS: Final = np.radians([0.4, 2.0])
"""Random walk of the normal of a deck that rests, with what the attitude's error changes, and of one that moves
[rad/sqrt(s)]; with 0.5 degrees alone a deck that rocks by 4 in 4 s was lost for 40 images."""
CHANGE: Final = 20.0
"""Mean time for which a deck goes on resting or moving [s]."""
MOVED: Final = 9.0
"""Squared distance of a measured normal from which the deck has moved: chi-square(2), one in 90."""
LEAST_WEIGHT: Final = 1e-12
"""Of a kind that the images contradict."""
LONGEST: Final = 10.0
"""Time without a measurement after which only the prior is known [s]."""


@dataclass(frozen=True, slots=True, eq=False)
class _Belief:
    """What is known if the deck rests, and if it moves.

    Attributes:
        weight: probability of either `(2,)`.
        mean: horizontal part of the normal, of either `(2, 2)`.
        covariance: of `mean`, of either `(2, 2, 2)` [rad^2].
    """

    weight: Array
    mean: Array
    covariance: Array

    def mixture(self) -> tuple[Array, Array]:
        """Mean m and covariance of both: sum(w P) + sum(w m_i m_i^T) - m m^T."""
        mean = self.weight @ self.mean
        weighted = self.weight[:, None] * self.mean
        covariance = self.weight @ self.covariance.reshape(2, 4)
        return mean, covariance.reshape(2, 2) + weighted.T @ self.mean - mean[:, None] * mean

    def later(self, passed: float) -> _Belief:
        """The same after some time [s]: the deck may have begun to move, or to rest, and drifts."""
        change = (1.0 - exp(-2.0 * passed / CHANGE)) / 2.0
        joint = np.array([[1.0 - change, change], [change, 1.0 - change]]) * self.weight
        weight = joint.sum(axis=1)
        share = joint / weight[:, None]
        mean = share @ self.mean
        second = share @ (self.covariance + self.mean[:, :, None] * self.mean[:, None]).reshape(2, 4)
        spread = second.reshape(2, 2, 2) - mean[:, :, None] * mean[:, None]
        return _Belief(weight, mean, spread + (DRIFTS**2 * passed)[:, None, None] * np.eye(2))

    def corrected(self, measured: Array, covariance: Array) -> _Belief:
        """Two Kalman updates; each weight times the likelihood of its surprise, exp(-y^T S^-1 y / 2) / sqrt(det S)."""
        surprise = (measured - self.mean)[:, :, None]
        expected = self.covariance + covariance
        inverse = np.linalg.inv(expected)
        gain = self.covariance @ inverse
        kept = self.covariance - gain @ self.covariance
        distance2 = (surprise.transpose(0, 2, 1) @ inverse @ surprise).ravel()
        likelihood = np.exp((distance2.min() - distance2) / 2.0) * np.sqrt(np.linalg.det(inverse))
        weight = np.maximum(self.weight * likelihood / likelihood.max(), LEAST_WEIGHT)
        mean = self.mean + (gain @ surprise)[:, :, 0]
        return _Belief(weight / weight.sum(), mean, (kept + kept.transpose(0, 2, 1)) / 2.0)


PRIOR: Final = _Belief(np.full(2, 0.5), np.zeros((2, 2)), np.stack([PRIOR_SD**2 * np.eye(2)] * 2))
"""Before anything was measured."""


class Deck:
    """The normal of one target in the world, near the vertical.

    Two Kalman filters of the horizontal part of the normal `(2,)`, east and north; for small tilts that is the tilt
    [rad].
    """

    def __init__(self) -> None:
        self._belief = PRIOR
        self._time = -np.inf

    @property
    def normal(self) -> Array:
        """The normal expected `(3,)`, ENU, length 1."""
        east, north = (self._belief.weight @ self._belief.mean).tolist()
        return np.array([east, north, sqrt(max(1.0 - east**2 - north**2, 0.0))])

    def sd(self, time: float) -> float:
        """Deviation of the normal at a time, along its worse axis [rad]; at most the prior's."""
        _, ((east, both), (_, north)) = (part.tolist() for part in self._at(time).mixture())
        # The larger eigenvalue of a symmetric matrix of two rows.
        variance = (east + north) / 2.0 + hypot((east - north) / 2.0, both)
        return min(sqrt(variance), PRIOR_SD)

    def measured(self, time: float, normal: Array, covariance: Array, *, is_sure: bool = True) -> None:
        """Take in a normal that an image measured.

        Args:
            time: of the image [s].
            normal: `(3,)`, ENU.
            covariance: of its horizontal part with the attitude's `(2, 2)` [rad^2].
            is_sure: whether a surprise means that the deck has moved; one that is not sure is left out.
        """
        belief = self._at(time)
        self._belief, self._time = belief, max(time, self._time)
        mean, spread = belief.mixture()
        surprise = normal[:2] - mean
        if float(surprise @ np.linalg.solve(spread + covariance, surprise)) > MOVED:
            if not is_sure:
                return
            # It has moved: what was known before counts no more than the surprise is large.
            grown = belief.covariance.copy()
            grown[MOVING] += np.outer(surprise, surprise)
            belief = _Belief(belief.weight, belief.mean, grown)
        self._belief = belief.corrected(normal[:2], covariance)

    def _at(self, time: float) -> _Belief:
        """What is known at a time, before anything is measured then."""
        passed = max(time - self._time, 0.0)
        if passed > LONGEST:
            return PRIOR
        return self._belief.later(passed) if passed > 0.0 else self._belief
