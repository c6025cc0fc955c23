"""How a target that should lie level really lies, as the vehicle's attitude sees it: a slow state of two angles.

A deck may be tilted, and the attitude may be biased by its mounting: together they are one disagreement between the
target's normal and the vertical. Poses that were found without it measure it; between them it drifts.
"""

from __future__ import annotations

from math import radians, sqrt
from typing import Final

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

PRIOR_SD: Final = radians(2.5)
"""Deviation of the normal from the vertical before an image measured it, each axis [rad].

Over a deck tilted by 5 degrees 1 degree gave 2 wrong poses of 340, 2 and 3 degrees none; with 4 degrees 3 of 42 first
poses far away lose their certainty.
"""
DRIFT: Final = radians(2.0)
"""Random walk of the normal [rad/sqrt(s)]; with 0.5 degrees a deck that rocks by 4 in 4 s was lost for 40 images."""
MOVED: Final = 9.0
"""Squared distance of a measured normal from which the deck has moved: chi-square(2), one in 90."""
LONGEST: Final = 10.0
"""Time without a measurement after which only the prior is known [s]."""


class Deck:
    """The normal of one target in the world, near the vertical.

    A Kalman filter of the horizontal part of the normal `(2,)`, east and north; for small tilts that is the tilt [rad].
    """

    def __init__(self) -> None:
        self._mean: Array = np.zeros(2)
        self._covariance: Array = PRIOR_SD**2 * np.eye(2)
        self._time = -np.inf

    @property
    def normal(self) -> Array:
        """The normal expected `(3,)`, ENU, length 1."""
        flat = float(self._mean @ self._mean)
        return np.array([*self._mean, sqrt(max(1.0 - flat, 0.0))])

    def sd(self, time: float) -> float:
        """Deviation of the normal at a time, along its worse axis [rad]; at most the prior's."""
        variance = float(np.linalg.eigvalsh(self._covariance)[-1]) + self._drifted(time)
        return min(sqrt(variance), PRIOR_SD)

    def measured(self, time: float, normal: Array, covariance: Array, *, is_sure: bool = True) -> None:
        """Take in a normal that an image measured.

        Args:
            time: of the image [s].
            normal: `(3,)`, ENU.
            covariance: of its horizontal part with the attitude's `(2, 2)` [rad^2].
            is_sure: whether a surprise means that the deck has moved; one that is not sure is left out.
        """
        self._drift_to(time)
        surprise = normal[:2] - self._mean
        expected = self._covariance + covariance
        if float(surprise @ np.linalg.solve(expected, surprise)) > MOVED:
            if not is_sure:
                return
            # It has moved: what was known before counts no more than the surprise is large.
            self._covariance = self._covariance + np.outer(surprise, surprise)
            expected = self._covariance + covariance
        gain = self._covariance @ np.linalg.inv(expected)
        self._mean = self._mean + gain @ surprise
        kept = self._covariance - gain @ self._covariance
        self._covariance = (kept + kept.T) / 2

    def _drifted(self, time: float) -> float:
        return DRIFT**2 * min(max(time - self._time, 0.0), LONGEST)

    def _drift_to(self, time: float) -> None:
        if time - self._time > LONGEST:
            self._mean, self._covariance = np.zeros(2), PRIOR_SD**2 * np.eye(2)
        else:
            self._covariance = self._covariance + self._drifted(time) * np.eye(2)
        self._time = max(time, self._time)
