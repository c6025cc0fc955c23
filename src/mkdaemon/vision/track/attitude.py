"""The vehicle's attitude at the moment an image was taken, and how the camera sits on the vehicle."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Iterable
from dataclasses import dataclass, replace
from math import hypot, isfinite, sqrt
from operator import attrgetter

import cv2
import numpy as np

from mkdaemon.frames import rotation_from_euler
from mkdaemon.vision.arrays import Array, Grey
from mkdaemon.vision.limits import LIMITS
from mkdaemon.vision.pose.pose import Pose, turn
from mkdaemon.vision.pose.rolling import skew
from mkdaemon.vision.pose.unknowns import TargetLevel


@dataclass(frozen=True, slots=True)
class AttitudeSample:
    """One attitude of the vehicle.

    Attributes:
        time: when it was true, monotonic [s].
        roll: right side down positive [rad; FLU].
        pitch: nose down positive [rad; FLU].
        yaw: nose left positive [rad; ENU].
    """

    time: float
    roll: float
    pitch: float
    yaw: float

    @property
    def is_number(self) -> bool:
        """Whether time and angles are finite."""
        return isfinite(self.time + self.roll + self.pitch + self.yaw)


@dataclass(frozen=True, slots=True, eq=False)
class Mounting:
    """Mounting of a camera on the vehicle.

    Attributes:
        flu_from_cam: `(3, 3)`, camera axes RDF.
        position_flu: lens in the body frame `(3,)` [m].
    """

    flu_from_cam: Array
    position_flu: Array


@dataclass(frozen=True, slots=True, eq=False)
class Turning:
    """Angular rate `(3,)` of a vehicle or its camera [rad/s; in its own axes], and its deviation, each axis."""

    rate: Array
    sd: float


@dataclass(frozen=True, slots=True, eq=False)
class ImageSight:
    """One image with what is known about its moment.

    Attributes:
        pixels: `(h, w)` uint8.
        time: middle of the exposure [s].
        enu_from_cam: the camera's attitude then `(3, 3)`, by the vehicle's.
        turning: how the camera turns then.
    """

    pixels: Grey
    time: float
    enu_from_cam: Array | None = None
    turning: Turning | None = None

    def without_attitude(self) -> ImageSight:
        """The image as a vehicle without attitude sees it."""
        return ImageSight(self.pixels, self.time)

    def turned_since(self, then: ImageSight) -> Array | None:
        """Camera now from camera then `(3, 3)`; none when one of both attitudes is unknown."""
        if self.enu_from_cam is None or then.enu_from_cam is None:
            return None
        return np.asarray(self.enu_from_cam.T @ then.enu_from_cam)


LEAST_SINE = 1e-12
"""Below, two directions are one."""
FARTHEST_SAMPLES = 0.055
"""Apart, samples say nothing about the turning in between [s]: a frame at 20 Hz is not too late."""
LEAST_TIME = 1e-3
"""Between two samples whose difference is a rate [s]."""
LEAST_SHARE, UNKNOWN_SHARE = 0.02, 1e-3
"""Of what the attitude says about a tilt: what an image has to say at least, and what counts where it says less."""


class AttitudeHistory:
    """Recent attitudes, asked for by time; samples that are not numbers are left out.

    Attributes:
        is_silent: whether no value was reported, not even an invalid one.
        samples: what is known, in order of time.
    """

    def __init__(self, samples: Iterable[AttitudeSample]) -> None:
        given = tuple(samples)
        self.is_silent = not given
        self.samples = tuple(sorted((s for s in given if s.is_number), key=attrgetter("time")))

    def _beside(self, time: float) -> tuple[AttitudeSample, ...]:
        """The samples before and after a time [s], as far as there are any."""
        k = bisect_left(self.samples, time, key=attrgetter("time"))
        return self.samples[max(k - 1, 0) : k + 1]

    def at(self, time: float, max_age: float) -> Array | None:
        """Attitude ENU from FLU `(3, 3)` at a time [s]; none when no sample is within `max_age` of it [s].

        Between two samples within reach the shorter way round is interpolated; outside them the nearest one is held.
        """
        beside = self._beside(time)
        if len(beside) > 1 and beside[1].time - beside[0].time <= 2 * max_age:
            start, end = map(_rotation, beside)
            share = (time - beside[0].time) / max(beside[1].time - beside[0].time, 1e-9)
            turned = cv2.Rodrigues(end @ start.T)[0] * share
            return np.asarray(cv2.Rodrigues(turned)[0] @ start)
        near = [s for s in beside if abs(s.time - time) <= max_age]
        return _rotation(min(near, key=lambda s: abs(s.time - time))) if near else None

    def turning_at(self, time: float) -> Turning | None:
        """Turn rate of the vehicle at a time [s] between two samples [FLU]; None between distant ones."""
        beside = self._beside(time)
        if len(beside) < 2 or beside[1].time - beside[0].time > FARTHEST_SAMPLES:
            return None
        start, end = map(_rotation, beside)
        turned = np.asarray(cv2.Rodrigues(start.T @ end)[0], dtype=np.float64).ravel()
        apart = max(beside[1].time - beside[0].time, LEAST_TIME)
        noise = sqrt(2.0) * LIMITS.edges.attitude_noise / apart
        # The rate half way between them changes until then.
        late = time - (beside[1].time + beside[0].time) / 2.0
        return Turning(turned / apart, hypot(noise, LIMITS.edges.acceleration_sd * late))


def _rotation(sample: AttitudeSample) -> Array:
    return rotation_from_euler(sample.roll, sample.pitch, sample.yaw)


def corrected(covariance: Array, observe: Array, surprise: Array, noise: Array) -> tuple[Array, Array, Array]:
    """A Kalman update of one state or of several: S = H P H^T + R, K = P H^T S^-1.

    Args:
        covariance: P, of the state `(..., n, n)`.
        observe: H, how what is observed moves with the state `(k, n)`.
        surprise: y, what was observed over what the state says `(..., k)`.
        noise: R, of the observation `(..., k, k)`.

    Returns:
        Step of the state, its covariance, and the log density of the surprise, -(y^T S^-1 y + ln det S) / 2.
    """
    across = covariance @ observe.T
    inverse = np.linalg.inv(observe @ across + noise)
    gain, column = across @ inverse, surprise[..., None]
    after = covariance - gain @ across.swapaxes(-1, -2)
    density = (np.log(np.linalg.det(inverse)) - (column.swapaxes(-1, -2) @ inverse @ column)[..., 0, 0]) / 2.0
    return (gain @ column)[..., 0], (after + after.swapaxes(-1, -2)) / 2.0, density


def updated(pose: Pose, observe: Array, surprise: Array, noise: Array) -> Pose:
    """The same of a pose; H is by place and rotation vector `(k, 6)`."""
    step, covariance, _ = corrected(pose.covariance, observe, surprise, noise)
    rotation, position = turn(pose.rotation, step[3:]), pose.position + step[:3]
    return replace(pose, rotation=rotation, position=position, covariance=covariance)


def fuse_normal(pose: Pose, level: TargetLevel) -> Pose:
    """Tell a pose what is known about its target's normal."""
    return updated(pose, *tilting(pose, level))


def angle_of(a: Array, b: Array) -> float:
    """Angle between two directions `(3,)` [rad]."""
    return float(np.arctan2(np.linalg.norm(skew(a) @ b), a @ b))


def turn_between(start: Array, end: Array) -> Array:
    """Rotation vector from one direction to another, both of length 1 `(3,)` [rad]."""
    axis = skew(start) @ end
    sine = float(np.linalg.norm(axis))
    return np.asarray(axis / sine * float(np.arctan2(sine, start @ end)) if sine > LEAST_SINE else axis)


def tilting(pose: Pose, level: TargetLevel) -> tuple[Array, Array, Array]:
    """Prior of a pose's normal, as `corrected` takes it.

    How two angles across it move with the pose `(2, 6)`, those to the expected one `(2,)` and their covariance [rad].
    """
    normal = pose.rotation[:, 2]
    across = np.linalg.svd(normal.reshape(1, 3))[2][1:]
    observe = np.hstack([np.zeros((2, 3)), across])
    return observe, across @ turn_between(normal, level.up), level.spread**2 * np.eye(2)


def without_normal(pose: Pose, level: TargetLevel) -> tuple[Pose, bool]:
    """Undo `fuse_normal`, by the variance -spread^2: the pose by the image alone, of a fit that was given a normal.

    About an axis that the image says next to nothing about, the pose stays as it is and hardly anything is known of it.

    Returns:
        The pose, and whether the image says as much about the tilt as the fit was given: it is not linear otherwise.
    """
    observe, surprise, _ = tilting(pose, level)
    variances, axes = np.linalg.eigh(observe @ pose.covariance @ observe.T)
    known = 1.0 / level.spread**2
    own = 1.0 / variances - known
    is_vague = own < LEAST_SHARE * known
    own = np.where(is_vague, UNKNOWN_SHARE * known, own)
    noise = np.diag(1.0 / (own - 1.0 / variances))
    alone = updated(pose, axes.T @ observe, np.where(is_vague, 0.0, axes.T @ surprise), noise)
    return alone, bool(own.min() >= known)
