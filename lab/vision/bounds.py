"""Cramer-Rao bounds of the self-calibration: what no unbiased estimator can beat, whatever it does with a flight.

For readings y = H x + e with e of covariance C, and unknowns x of which P is known beforehand, no unbiased estimate has
a covariance below (H^T C^-1 H + P)^-1. All errors here are drawn by `lab.vision.descent.Descent`, so that C is known.
"""

from __future__ import annotations

from collections.abc import Callable
from math import radians
from typing import Final

import numpy as np
import numpy.typing as npt

from lab.vision.descent import BAROMETER, NOISE, WANDER

Array = npt.NDArray[np.float64]

WANDER_TIME, BAROMETER_TIME = 1.0, 10.0
"""Correlation times of the wander of an attitude and of a barometer [s]."""
STEP_SD: Final = 0.05 / np.sqrt(12.0)
"""Of a reading in steps of 5 cm [m]."""
DELAY_SD: Final = 0.1
"""Of when a reading arrives [s]."""
PERIOD, LOOKS = 0.2, 0.1
"""Between readings of a barometer, and between images [s]."""
FREE: Final = 1e-4
"""Information about what is not known at all."""
UNKNOWN: Final = radians(5.0), radians(2.5), 0.08
"""Of mounting and deck [rad], scale of the attitude [share], deviations as `selfcal.camerafilter`."""


def scale_sd(height: Callable[[float], float], seconds: float) -> float:
    """Least deviation of the share by which all heights are too large, by a barometer.

    Args:
        height: of the flight at a time [m].
        seconds: how long it takes.
    """
    times = np.arange(0.0, seconds, PERIOD)
    heights = np.array([height(float(time)) for time in times])
    unknowns = np.column_stack([heights, np.ones_like(times), np.gradient(heights, PERIOD)])
    noise = wandering(times, BAROMETER, BAROMETER_TIME) + STEP_SD**2 * np.eye(len(times))
    return float(_sd(unknowns, noise, np.array([0.0, FREE, DELAY_SD**-2]))[0])


def mounting_sd(angles: Callable[[float], Array], seconds: float) -> float:
    """Least deviation of a mounting's roll beside a deck of unknown tilt, images being exact [rad].

    The attitude's constant bias is part of the mounting.

    Args:
        angles: roll, pitch, yaw `(3,)` of the vehicle at a time [rad].
        seconds: how long it flies.
    """
    times = np.arange(0.0, seconds, LOOKS)
    roll, pitch, yaw = np.array([angles(float(time)) for time in times]).T
    one, none, cos, sin = np.ones_like(times), np.zeros_like(times), np.cos(yaw), np.sin(yaw)
    of_roll = np.column_stack([one, none, cos, sin, roll])
    of_pitch = np.column_stack([none, one, -sin, cos, pitch])
    noise = wandering(times, WANDER, WANDER_TIME) + NOISE**2 * np.eye(len(times))
    mounting, deck, scale = UNKNOWN
    known = 1.0 / np.array([mounting, mounting, deck, deck, scale]) ** 2
    both = np.kron(np.eye(2), noise).astype(np.float64)
    return float(_sd(np.vstack([of_roll, of_pitch]), both, known)[0])


def wandering(times: Array, sd: float, time: float) -> Array:
    """Covariance `(n, n)` of a wander (Ornstein-Uhlenbeck) of a deviation and a correlation time."""
    found: Array = sd**2 * np.exp(-np.abs(np.subtract.outer(times, times)) / time)
    return found


def _sd(unknowns: Array, noise: Array, known: Array) -> Array:
    """Deviations of unknowns `(k,)` by readings `(n, k)` with a noise `(n, n)` and information beforehand `(k,)`."""
    information = unknowns.T @ np.linalg.solve(noise, unknowns) + np.diag(known)
    deviations: Array = np.sqrt(np.diag(np.linalg.inv(information)))
    return deviations
