"""A rolling shutter in the projection: points move while the rows of the image are exposed one after the other.

A point at P when the middle row is exposed is seen at P(t) = P - t w x P + t s e in the row of time t, with w the
angular rate of the camera, s the speed of the target along the optical axis e. Motion across that axis looks like a
turn and is part of w; motion along it looks like a tilt, which an image alone hardly tells apart from it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from mkdaemon.vision.pose.projection import Projection

Array = npt.NDArray[np.float64]

MOTIONS: Final = 4
"""Unknowns: w [rad/s], then s [m/s]."""
ROUNDS: Final = 2
"""A point's row says when it is exposed, and that where it is: so often."""


@dataclass(frozen=True, slots=True, eq=False)
class KnownMotion:
    """What is known about the motion before the image is looked at.

    Attributes:
        expected: angular rate [rad/s] and speed along the axis [m/s] `(4,)`.
        spread: standard deviation of each `(4,)`.
    """

    expected: Array
    spread: Array


def motion_of(place: Array, speed: Array, turning: Array) -> Array:
    """The motion `(4,)` of a camera.

    Args:
        place: of the target `(3,)` [m; RDF].
        speed: of the target in axes that do not turn with the camera `(3,)` [m/s].
        turning: angular rate of the camera `(3,)` [rad/s].
    """
    # -w x P = (v_x, v_y, 0) for the shortest w; what is left lies along P.
    across = np.array([speed[0], speed[1], 0.0])
    return np.array([*(turning - np.cross(place, across) / float(place @ place)), speed[2]])


def motion_at_rest() -> Array:
    """The motion `(4,)` of a camera that stands still."""
    return np.zeros(MOTIONS)


def exposed(points: Array, motion: Array, projection: Projection) -> tuple[Array, Array]:
    """Points `(n, 3)` [m; RDF] as they are when their rows are exposed, and when that is `(n,)` [s].

    Args:
        points: when the middle row is exposed.
        motion: `(4,)`, angular rate [rad/s] and speed along the axis [m/s].
        projection: of the lens.
    """
    intrinsics = projection.intrinsics
    middle = (intrinsics.height - 1) / 2
    moved = points
    times = np.zeros(len(points))
    for _ in range(ROUNDS):
        pixels, _ = projection.project(moved)
        times = (np.clip(pixels[:, 1], 0.0, intrinsics.height - 1.0) - middle) * intrinsics.line_time
        moved = at_times(points, motion, times)
    return moved, times


def at_times(points: Array, motion: Array, times: Array) -> Array:
    """Points `(n, 3)` carried to the times `(n,)` of their rows."""
    carried: Array = points - times[:, None] * np.cross(motion[:3], points)
    carried[:, 2] += times * motion[3]
    return carried


def motion_jacobian(point_jacobian: Array, points: Array, times: Array) -> Array:
    """Derivative `(n, 4)` by the motion, of what has the derivative `(n, 3)` by the point."""
    # j . (-t w x P) = -t w . (P x j)
    turning = -times[:, None] * np.cross(points, point_jacobian)
    return np.column_stack([turning, times * point_jacobian[:, 2]])
