"""How a target that should lie level really lies, as the vehicle's attitude sees it: a slow state of two angles.

A deck may be tilted, and the attitude may be biased by its mounting: together they are one disagreement between the
target's normal and the vertical. Poses that were found without it measure it; between them it drifts.

How fast it drifts nobody knows before: a pad on the ground stays as it lies, a ship's deck rocks. Both are followed,
each as likely as its predictions make it. An image of a far target hardly tells a tilt; over a deck that rested while
it was seen better, what was learned then still counts.

Source: interacting multiple models, Blom and Bar-Shalom, IEEE TAC 33(8), 1988.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import exp, radians, sqrt
from typing import Final

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

PRIOR_SD: Final = radians(2.5)
"""Deviation of the normal from the vertical before an image measured it, each axis [rad].

Over a deck tilted by 5 degrees 1 degree gave 2 wrong poses of 340, 2 and 3 degrees none; with 4 degrees 3 of 42 first
poses far away lose their certainty.
"""
RESTING, MOVING = 0, 1
DRIFTS: Final = (radians(0.4), radians(2.0))
"""Random walk of the normal of a deck that rests, with what the attitude's error changes, and of one that moves
[rad/sqrt(s)]; with 0.5 degrees alone a deck that rocks by 4 in 4 s was lost for 40 images."""
CHANGE: Final = 20.0
"""Mean time for which a deck goes on resting or moving [s]."""
MOVED: Final = 9.0
"""Squared distance of a measured normal from which the deck has moved: chi-square(2), one in 90."""
LEAST_WEIGHT: Final = 1e-12
"""Of a kind that the images contradict; likelihoods of angles are some hundreds [1/rad^2]."""
LONGEST: Final = 10.0
"""Time without a measurement after which only the prior is known [s]."""


@dataclass(frozen=True, slots=True, eq=False)
class _Kind:
    """What is known if the deck rests, or if it moves.

    Attributes:
        weight: probability of that.
        mean: horizontal part of the normal `(2,)`.
        covariance: of `mean` `(2, 2)` [rad^2].
    """

    weight: float
    mean: Array
    covariance: Array


class Deck:
    """The normal of one target in the world, near the vertical.

    Two Kalman filters of the horizontal part of the normal `(2,)`, east and north; for small tilts that is the tilt
    [rad].
    """

    def __init__(self) -> None:
        self._kinds = _prior()
        self._time = -np.inf

    @property
    def normal(self) -> Array:
        """The normal expected `(3,)`, ENU, length 1."""
        mean, _ = _mixture(self._kinds)
        return np.array([*mean, sqrt(max(1.0 - float(mean @ mean), 0.0))])

    def sd(self, time: float) -> float:
        """Deviation of the normal at a time, along its worse axis [rad]; at most the prior's."""
        _, covariance = _mixture(self._at(time))
        return min(sqrt(float(np.linalg.eigvalsh(covariance)[-1])), PRIOR_SD)

    def measured(self, time: float, normal: Array, covariance: Array, *, is_sure: bool = True) -> None:
        """Take in a normal that an image measured.

        Args:
            time: of the image [s].
            normal: `(3,)`, ENU.
            covariance: of its horizontal part with the attitude's `(2, 2)` [rad^2].
            is_sure: whether a surprise means that the deck has moved; one that is not sure is left out.
        """
        kinds = self._at(time)
        self._kinds, self._time = kinds, max(time, self._time)
        mean, spread = _mixture(kinds)
        surprise = normal[:2] - mean
        if float(surprise @ np.linalg.solve(spread + covariance, surprise)) > MOVED:
            if not is_sure:
                return
            # It has moved: what was known before counts no more than the surprise is large.
            moving = kinds[MOVING]
            kinds = (kinds[RESTING], replace(moving, covariance=moving.covariance + np.outer(surprise, surprise)))
        found = [_corrected(kind, normal[:2], covariance) for kind in kinds]
        total = sum(kind.weight for kind in found)
        self._kinds = tuple(replace(kind, weight=kind.weight / total) for kind in found)

    def _at(self, time: float) -> tuple[_Kind, ...]:
        """Both kinds at a later time, before anything is measured."""
        passed = max(time - self._time, 0.0)
        if passed > LONGEST:
            return _prior()
        changes = (1.0 - exp(-2.0 * passed / CHANGE)) / 2.0
        grown = []
        for now, drift in enumerate(DRIFTS):
            parts = [
                replace(kind, weight=kind.weight * (1.0 - changes if then == now else changes))
                for then, kind in enumerate(self._kinds)
            ]
            mean, covariance = _mixture(parts)
            grown.append(_Kind(sum(part.weight for part in parts), mean, covariance + drift**2 * passed * np.eye(2)))
        return tuple(grown)


def _prior() -> tuple[_Kind, ...]:
    """Before anything was measured."""
    return tuple(_Kind(0.5, np.zeros(2), PRIOR_SD**2 * np.eye(2)) for _ in DRIFTS)


def _mixture(kinds: Sequence[_Kind]) -> tuple[Array, Array]:
    """Mean and covariance of a mixture: sum(w m) and sum(w (P + (m - mean) (m - mean)^T))."""
    total = max(sum(kind.weight for kind in kinds), LEAST_WEIGHT)
    mean = np.asarray(sum(kind.weight * kind.mean for kind in kinds) / total, np.float64)
    covariance = np.zeros((2, 2))
    for kind in kinds:
        off = kind.mean - mean
        covariance += kind.weight / total * (kind.covariance + np.outer(off, off))
    return mean, covariance


def _corrected(kind: _Kind, measured: Array, covariance: Array) -> _Kind:
    """A Kalman update, the weight times the likelihood of the surprise y: exp(-y^T S^-1 y / 2) / sqrt(det S)."""
    surprise, expected = measured - kind.mean, kind.covariance + covariance
    gain = kind.covariance @ np.linalg.inv(expected)
    kept = kind.covariance - gain @ kind.covariance
    likelihood = exp(-float(surprise @ np.linalg.solve(expected, surprise)) / 2.0) / sqrt(np.linalg.det(expected))
    weight = max(kind.weight * likelihood, LEAST_WEIGHT)
    return _Kind(weight, kind.mean + gain @ surprise, (kept + kept.T) / 2)
