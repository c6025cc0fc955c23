"""Inputs and outputs of the estimator: stick frames, views of a target, the estimate; and the faults of a view."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum
from functools import cached_property
from typing import Final

import numpy as np

from mkdaemon.control.estimator.model import D, H, P, S, T, V
from mkdaemon.control.linear import Array

GAS_CENTRE: Final = 127.0
"""Throttle of a centred stick [count of 254]; docs/protocol.md, "ExternalControl"."""
OLDEST: Final = 0.8
"""Older measurements are used no more [s]: three times the oldest image that is flown by; docs/lab/control.md."""
FUTURE: Final = 0.02
"""Largest time of a view ahead of our clock [s]: an error of time stamps that flights tolerate; docs/control.md."""
FARTHEST: Final = 1000.0
"""No camera sees a target from farther away, or knows it worse than to this [m; rad]."""
SKEWED: Final = 1e-3
"""How far a rotation may be from orthonormal, and a covariance from symmetric [share]: rounding, and no more."""
LEAST_UPRIGHT: Final = 0.8
"""Smallest share of the thrust that is taken to carry: 37 degrees of tilt."""
_IDENTITY: Final = np.eye(3)


def upright(tilt: Array) -> float:
    """Return the share of the thrust that carries the weight at a tilt (2,) [rad]."""
    return max(math.cos(tilt[0]) * math.cos(tilt[1]), LEAST_UPRIGHT)


@dataclass(frozen=True, slots=True)
class ThrottleUse:
    """Use of our throttle by the FlightCtrl.

    Attributes:
        cap: it flies with no more than this, because the pilot's stick is lower than ours [count of 254]; None where
            nothing caps ours, or it is not sure.
        is_ours: nothing that was reported contradicts that it flies with ours.
    """

    cap: float | None
    is_ours: bool


OURS: Final = ThrottleUse(None, is_ours=True)
"""Our throttle is in use, or no board reports it."""


@dataclass(frozen=True, slots=True)
class StickCommand:
    """A stick frame as it was written.

    Attributes:
        at: when its last byte left [s; monotonic].
        pitch: nose down positive [stick].
        roll: right side down positive [stick].
        yaw: nose left positive [stick].
        gas: what the motors get of it before voltage compensation, where nothing caps it [count of 254].
        use: what the FlightCtrl makes of that.
    """

    at: float
    pitch: float
    roll: float
    yaw: float
    gas: float
    use: ThrottleUse = OURS

    @property
    def acting_gas(self) -> float:
        """Throttle at the motors [count of 254]."""
        return self.gas if self.use.cap is None else min(self.gas, self.use.cap)


@dataclass(frozen=True)
class TargetView:
    """A target as an image showed it; what follows from it alone is computed once.

    Attributes:
        at: middle of the exposure [s; monotonic].
        position_flu: `point` in the body frame (3,) [m; FLU].
        target_from_flu: attitude of the vehicle in the target frame (3, 3).
        covariance: of the vehicle's pose in the target frame (6, 6): position [m] and rotation vector [rad].
        camera: whose image it was.
        calibration_sd: what of that covariance all images of this camera have in common: standard deviations along the
            line of sight [m], across it [m], of the angle [rad].
        is_placed: the vehicle's place in the target frame was measured, whatever its attitude: by motion capture. A
            camera measures where the target lies in the body frame.
        point: what it measures of the target [m; target frame]: its origin, or of a map the ground below the vehicle.
        is_of_map: tags of the target lie around the vehicle, which may lean.
    """

    at: float
    position_flu: Array
    target_from_flu: Array
    covariance: Array
    camera: str = ""
    calibration_sd: tuple[float, float, float] = (0.0, 0.0, 0.0)
    is_placed: bool = False
    point: tuple[float, float, float] = (0.0, 0.0, 0.0)
    is_of_map: bool = False

    @property
    def heading(self) -> float:
        """Heading of the forward axis in the target frame, counter-clockwise from x [rad]."""
        return math.atan2(self.target_from_flu[1, 0], self.target_from_flu[0, 0])

    @cached_property
    def place(self) -> Array:
        """The vehicle in the target frame (3,) [m]."""
        place: Array = self.point - self.target_from_flu @ self.position_flu
        return place

    @property
    def height(self) -> float:
        """Of the vehicle above the target; by a camera as if the vehicle were level [m]."""
        return float(self.place[2]) if self.is_placed else -float(self.position_flu[2])

    @property
    def aside(self) -> float:
        """Distance from the middle of the target over ground; over one target as if the vehicle were level [m]."""
        return math.hypot(*(self.place if self.is_placed or self.is_of_map else self.position_flu)[:2].tolist())

    @cached_property
    def sight_covariance(self) -> Array:
        """Covariance (3, 3) of `position_flu` [m2].

        With p the vehicle as seen from `point` and R its attitude, m = -R'p, so dm = -R'dp - R'[p]x dr.
        """
        r = self.target_from_flu
        p = -r @ self.position_flu
        cross = np.array([[0.0, -p[2], p[1]], [p[2], 0.0, -p[0]], [-p[1], p[0], 0.0]])
        jacobian = np.concatenate([-r.T, -r.T @ cross], axis=1)
        covariance: Array = jacobian @ self.covariance @ jacobian.T
        return covariance

    @cached_property
    def calibration_covariance(self) -> Array:
        """Share (3, 3) of `sight_covariance` that all images of this camera have in common [m2]."""
        along_sd, across_sd, _ = self.calibration_sd
        sight = self.position_flu / max(math.hypot(*self.position_flu.tolist()), 1e-9)
        along = np.multiply.outer(sight, sight)
        covariance: Array = along_sd**2 * along + across_sd**2 * (_IDENTITY - along)
        return covariance

    @cached_property
    def fault(self) -> ViewFault | None:
        """Why it cannot be used, at any time; None if it is sound."""
        rotation, covariance = self.target_from_flu, self.covariance
        place, turn, spread = self.position_flu.tolist(), rotation.ravel().tolist(), covariance.ravel().tolist()
        if not all(map(math.isfinite, (self.at, *place, *turn, *spread, *self.calibration_sd))):
            return ViewFault.NOT_FINITE
        widest = max(map(abs, spread))
        if max(map(abs, place)) > FARTHEST or widest > FARTHEST**2:
            return ViewFault.TOO_FAR
        (a, b, c), (d, e, f), (g, h, i) = rotation.tolist()
        is_mirrored = a * (e * i - f * h) + b * (f * g - d * i) + c * (d * h - e * g) < 0.0
        if is_mirrored or np.abs(rotation @ rotation.T - _IDENTITY).max() > SKEWED:
            return ViewFault.NO_ROTATION
        if np.abs(covariance - covariance.T).max() > SKEWED * widest or not _is_positive(covariance):
            return ViewFault.NO_COVARIANCE
        whole = covariance[:3, :3] if self.is_placed else self.sight_covariance
        is_too_wide = self.calibration_covariance.trace() > (1.0 + SKEWED) * whole.trace()
        return ViewFault.CALIBRATION if is_too_wide else None


class ViewFault(Enum):
    """Fault of a view; the value is the text shown."""

    NOT_FINITE = "it has numbers that are not finite"
    TOO_FAR = "it shows the target farther away, or knows it worse, than any camera does"
    NO_ROTATION = "its attitude is not a rotation"
    NO_COVARIANCE = "its covariance is not symmetric and positive definite"
    CALIBRATION = "its calibration is less certain than the pose that it is a part of"
    FUTURE = "it was taken in the future"
    TOO_OLD = "it is older than the estimate remembers"


def fault_of(view: TargetView, now: float) -> ViewFault | None:
    """Return why a view that arrives now [s; monotonic] cannot be used; None if it is sound."""
    if view.fault is not None:
        return view.fault
    if view.at > now + FUTURE:
        return ViewFault.FUTURE
    return ViewFault.TOO_OLD if view.at < now - OLDEST else None


def _is_positive(covariance: Array) -> bool:
    """Whether a symmetric matrix is positive definite: it has a Cholesky factor."""
    try:
        np.linalg.cholesky(covariance)
    except np.linalg.LinAlgError:
        return False
    return True


@dataclass(frozen=True, slots=True)
class Estimate:
    """The aircraft at one moment, in the frame of the target.

    Attributes:
        at: [s; monotonic].
        yaw: heading of the body's forward axis, counter-clockwise from x [rad].
        hover_gas: throttle that carries the aircraft [count of 254].
        axes: whole state of both horizontal axes (2, 9).
        vertical: whole state of the vertical axis (4,).
        position_sd: standard deviation of the position (3,) [m].
        age: time since the last image that was used [s]; infinite before the first.
    """

    at: float
    yaw: float
    hover_gas: float
    axes: Array
    vertical: Array
    position_sd: Array
    age: float

    @property
    def position(self) -> Array:
        """Where it is (3,) [m]."""
        return np.array([*self.axes[:, P], self.vertical[H]])

    @property
    def velocity(self) -> Array:
        """Relative to the target (3,) [m/s]."""
        return np.array([*self.axes[:, V], self.vertical[S]])

    @property
    def tilt(self) -> Array:
        """True tilt towards x and y, the way it accelerates (2,) [rad]."""
        return self.axes[:, T]

    @property
    def disturbance(self) -> Array:
        """Acceleration that the model does not explain, x and y (2,) [m/s2]."""
        return self.axes[:, D]
