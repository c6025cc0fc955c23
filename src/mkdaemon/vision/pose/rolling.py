"""A rolling shutter: how the rows of an image are exposed one after the other, and what is known of their line time.

A point at P when the middle row is exposed is seen at P(t) = P - t w x P + t s e in the row of time t, with w the
angular rate of the camera, s the speed of the target along the optical axis e. Motion across that axis looks like a
turn and is part of w; motion along it looks like a tilt, which an image alone hardly tells apart from it.

An image shows the product of motion and line time, and not either. If the line time T is unknown, fits reckon
with a nominal one, T0, and with the motion m T / T0 in place of m. Before the image is looked at that has the mean
E[T] m / T0 and the variance (E[T^2] var(m) + var(T) m^2) / T0^2.

Where the motion is known besides (the attitude turns, the range changes) what an image alone says about m T / T0 is
linear in T: least squares over the images, each believed as far as it agrees with those before.
"""

from __future__ import annotations

from math import sqrt
from typing import Final

import numpy as np

from mkdaemon.vision.arrays import Array, UnknownsEstimate
from mkdaemon.vision.limits import LIMITS

MOTIONS: Final = 4
"""Unknowns: angular rates [rad/s], then the speed along the axis [m/s]."""
LONGEST: Final = 60e-6
"""Line time of the slowest cameras [s]: 30 ms for 480 rows."""
NOMINAL: Final = LONGEST / 2.0
MOVING2: Final = 25.0
"""Squared deviations from rest from which a motion is one: at rest it is passed in one image of 20,000."""
HIDDEN: Final = 0.1
"""Share of the line time by which an estimate is wrong, for any number of images; chosen on three flights."""
PRIOR: Final = 3.0
"""Information before any image: an even chance from 0 to twice the nominal line time has the variance 1 / 3."""
FEWEST: Final = 10
"""Images before a line time of zero is accepted."""


class Shutter:
    """The line time of one camera.

    Args:
        line_time: that its file tells [s]; none where it does not.
        reach_px: half of its rows times its focal length: what a turn by 1 rad/s moves in a line time of 1 s [px].

    Attributes:
        line_time: that fits reckon with [s]; 0 for a global shutter.
    """

    def __init__(self, line_time: float | None, reach_px: float = 0.0) -> None:
        self.line_time = NOMINAL if line_time is None else line_time
        self._reach_px = reach_px
        self._images = 0
        # Sums over images, in units of the nominal line time: information, and its product with the line time.
        self._known, self._agreed = 0.0, 0.0
        self._mean, self._variance = 1.0, 1.0 / PRIOR if line_time is None else 0.0

    @property
    def rolls(self) -> bool:
        """Whether rows are, or may be, exposed one after the other."""
        return self.line_time > 0.0

    @property
    def is_open(self) -> bool:
        """Whether images may still tell the line time."""
        return self.rolls and self._variance > 0.0

    @property
    def estimate(self) -> tuple[float, float]:
        """Line time and its deviation [s]."""
        return self._mean * self.line_time, sqrt(self._variance) * self.line_time

    @property
    def words(self) -> str:
        """The estimate, for the text of an alarm."""
        if self._images < FEWEST:
            return f"unknown (0 to {1e6 * LONGEST:.0f} us) until a large target was seen in motion"
        line_time, sd = self.estimate
        return f"{1e6 * line_time:.0f} +- {1e6 * sd:.0f} us by {self._images} images"

    @property
    def scale(self) -> float:
        """Root mean square of the line time over the nominal one."""
        return sqrt(self._mean**2 + self._variance)

    def motion(self, known: UnknownsEstimate) -> UnknownsEstimate:
        """Estimate of the motion times the line time over the nominal one."""
        covariance = self.scale**2 * known.covariance + self._variance * np.diag(known.mean**2)
        return UnknownsEstimate(self._mean * known.mean, covariance)

    def learn(self, known: UnknownsEstimate, seen: UnknownsEstimate) -> None:
        """Take in an image.

        Args:
            known: of the motion, without the image.
            seen: by the image alone.
        """
        if not self.is_open or float(known.mean @ known.information @ known.mean) < MOVING2:
            return
        # Linear regression of k in seen = k known, k the line time over the nominal one: with the weight W of the
        # residual, information sum(m^T W m) and k = (PRIOR 1 + sum(m^T W y)) / (PRIOR + sum(m^T W m)).
        weight = np.linalg.inv(seen.covariance + self.scale**2 * known.covariance)
        surprise = seen.mean - self._mean * known.mean
        # A surprise beyond its deviation widens both by the ratio of Birge, Physical Review 40 (1932), 207.
        weight /= max(1.0, float(surprise @ weight @ surprise) / MOTIONS)
        self._images += 1
        self._known += float(known.mean @ weight @ known.mean)
        self._agreed += float(known.mean @ weight @ seen.mean)
        self._mean = max((PRIOR + self._agreed) / (PRIOR + self._known), 0.0)
        # What no number of images averages out is a share of the line time itself.
        self._variance = 1.0 / (PRIOR + self._known) + (HIDDEN * self._mean) ** 2
        most = (self._mean + 2.0 * sqrt(self._variance)) * self.line_time * self._reach_px * LIMITS.edges.turning_sd
        if self._images >= FEWEST and most < LIMITS.edges.located_px:
            self.line_time = 0.0


def motion_of(place: Array, speed: Array, turning: Array) -> Array:
    """The motion `(4,)` of a camera.

    Args:
        place: of the target `(3,)` [m; RDF].
        speed: of the target in axes that do not turn with the camera `(3,)` [m/s].
        turning: angular rate of the camera `(3,)` [rad/s].
    """
    # v = -w x P + s e: the turn has no part along P, so s = v . P / P_z, and the shortest w makes up the rest.
    along = float(speed @ place) / float(place[2])
    across = speed - np.array([0.0, 0.0, along])
    return np.array([*(turning - skew(place) @ across / float(place @ place)), along])


def skew(vector: Array) -> Array:
    """The matrix `(3, 3)` whose product with b is the cross product of a vector `(3,)` with b."""
    x, y, z = vector
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def cross(a: Array, b: Array) -> Array:
    """Products of vectors `(n, 3)`; written out, numpy's cross is slow."""
    ax, ay, az = a.T
    bx, by, bz = b.T
    product = np.empty_like(a)
    product[:, 0] = ay * bz - az * by
    product[:, 1] = az * bx - ax * bz
    product[:, 2] = ax * by - ay * bx
    return product


def motion_jacobian(by_point: Array, points: Array, times: Array) -> Array:
    """Derivative `(4, n)` by the motion, of what has the derivative `(n, 3)` by the points `(n, 3)`.

    A point that moves to another row is exposed at another time; that is left out, 1 to 3 % of the derivative.
    """
    # j . (-t w x P) = -t w . (P x j)
    return np.concatenate([-times * cross(points, by_point).T, (times * by_point[:, 2])[None]])


def beyond_motion(by_motion: Array, by_place: Array, times: Array, position: Array) -> Array:
    """Derivative `(5, n)` by what the motion lacks: the angular acceleration [rad/s^2], a speed across [m/s].

    An acceleration a bends the image by a t^2 / 2, which is t / 2 times what the rates do. A speed e across the line of
    sight is in the motion as a turn, right at the target's origin P0 only: t (e - w x P) is beyond, w = P0 x e / P0^2.

    Args:
        by_motion: derivative by the motion `(4, n)`.
        by_place: derivative by the target's position `(n, 3)`.
        times: of the points `(n,)` [s].
        position: of the target `(3,)` [m; RDF].
    """
    rates = by_motion[:3]
    # With n . u x P = u . P x n the turn in place of a speed e is the rows of the rates times P0 x e / P0^2.
    instead = skew(position)[:, :2] / float(position @ position)
    return np.concatenate([rates * (times / 2), times * by_place[:, :2].T + instead.T @ rates])
