"""Tuning of the estimator: process noise and the spread of measurements.

Chosen on flights that no reported figure uses, of the simulator and of genuine firmware: docs/lab/control.md.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Final

import numpy as np

from mkdaemon.control.estimator.model import TH, US, T
from mkdaemon.control.linear import Array


@dataclass(frozen=True, slots=True)
class Tuning:
    """One set of noises.

    Attributes:
        velocity: noise of the velocity [m/s per root s].
        tilt: of the true tilt [rad per root s].
        believed: of the FlightCtrl's tilt [rad per root s].
        integral: of its integral [rad s per root s].
        rate: of the tilt rate [rad/s per root s].
        filtered: of the filtered stick [rad per root s].
        disturbance: random walk of the unexplained acceleration [m/s2 per root s]; gusts of light wind, 0.5 m/s for
            3 s, are 0.14, those of moderate wind 0.29.
        level: random walk of the accelerometers' tilt [rad per root s].
        climb: noise of the climb rate [m/s per root s].
        thrust: of the thrust [share per root s].
        vertical: random walk of the unexplained vertical acceleration [m/s2 per root s].
        attitude_sd: of the attitude that the boards report [rad].
        view_floor: of an image's lateral position [m], without the errors that all images share.
        height_floor: of an image's height [m].
        tilt_floor: of an image's tilt [rad].
        tilt_worst: a tilt less certain than this is not used [rad].
        stamp_sd: of the time stamps of images [s].
        yaw_floor: of an image's heading [rad].
        yaw_gain: share of a certain image's heading that is taken.
        innovation_rate: of the running mean of the innovations, a measurement.
        innovation_cap: largest squared innovation that counts.
        caution_rate: change of the caution by an image whose squared innovation is one more than expected.
        patience: consecutive refused images before the filter doubts its own state.
    """

    velocity: float = 0.023
    tilt: float = 0.0003
    believed: float = 0.0013
    integral: float = 0.001
    rate: float = 0.058
    filtered: float = 0.0127
    disturbance: float = 0.076
    level: float = 0.0005
    climb: float = 0.023
    thrust: float = 0.02
    vertical: float = 0.2
    attitude_sd: float = 0.004
    view_floor: float = 0.0003
    height_floor: float = 0.002
    tilt_floor: float = 0.001
    tilt_worst: float = 0.25
    stamp_sd: float = 0.004
    yaw_floor: float = 0.02
    yaw_gain: float = 0.2
    innovation_rate: float = 0.02
    innovation_cap: float = 25.0
    caution_rate: float = 0.0033
    patience: int = 3

    def towards(self, other: Tuning, share: float) -> Tuning:
        """Beliefs between these (share 0) and others (1): every noise goes by its ratio."""
        ours = {each.name: (getattr(self, each.name), getattr(other, each.name)) for each in fields(self)}
        return replace(self, **{name: a * (b / a) ** share for name, (a, b) in ours.items() if a != b})

    @property
    def first_covariance(self) -> Array:
        """Covariance of a horizontal axis before the first image (9, 9).

        The FlightCtrl's own tilt is near the true one, and its filtered stick near its own tilt.
        """
        spread = np.diag([0.6, 0.5, 0.15, 0.04, 0.03, 0.2, 0.06, 1.0, 0.02])
        spread[[TH, US], T] = spread[T, T]
        spread[US, TH] = spread[TH, TH]
        covariance: Array = spread @ spread.T
        return covariance

    @property
    def first_upright_spread(self) -> Array:
        """Standard deviations of the vertical axis at the start (4,)."""
        return np.array([0.05, 0.2, 0.05, 1.5])

    @property
    def doubt(self) -> Array:
        """Covariance to add to a horizontal axis that refused `patience` images (9, 9)."""
        return np.diag([0.3, 0.5, 0.05, 0.03, 0.02, 0.3, 0.03, 0.5, 0.01]) ** 2

    @property
    def upright_doubt(self) -> Array:
        """Covariance to add to the vertical axis that refused `patience` images (4, 4)."""
        return np.diag([0.5, 0.7, 0.1, 1.5]) ** 2

    def level_noise(self, step: float) -> Array:
        """Process noise of a horizontal axis over a step [s]: (9, 9)."""
        sizes = [0.0, self.velocity, self.tilt, self.believed, self.integral, self.rate, self.filtered]
        return np.diag([*sizes, self.disturbance, self.level]) ** 2 * step

    def upright_noise(self, step: float) -> Array:
        """Process noise of the vertical axis over a step [s]: (4, 4)."""
        return np.diag([0.0, self.climb, self.thrust, self.vertical]) ** 2 * step


NOMINAL: Final = Tuning()
"""Caution 0: the parameter set is known, and the air is calm; a third of the way to `ROBUST` is light wind."""
ROBUST: Final = Tuning(
    velocity=0.05, tilt=0.03, believed=0.015, rate=1.0, filtered=0.05, disturbance=0.3, climb=0.05, vertical=0.4
)
"""Caution 1: nothing is known of the model yet, and a pilot may fly; images count for more."""
