"""A rolling shutter in the projection: points move while the rows of the image are exposed one after the other.

A point at P when the middle row is exposed is seen at P(t) = P - t w x P + t s e in the row of time t, with w the
angular rate of the camera, s the speed of the target along the optical axis e. Motion across that axis looks like a
turn and is part of w; motion along it looks like a tilt, which an image alone hardly tells apart from it.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from mkdaemon.vision.arrays import Array
from mkdaemon.vision.pose.projection import Projection

ROUNDS: Final = 2
"""A point's row says when it is exposed, and that where it is: so often."""


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


def exposed(points: Array, motion: Array | None, projection: Projection) -> tuple[Array, Array]:
    """Points `(n, 3)` [m; RDF] as they are when their rows are exposed, and when that is `(n,)` [s].

    Args:
        points: when the middle row is exposed.
        motion: `(4,)`, angular rate [rad/s] and speed along the axis [m/s]; none under a global shutter.
        projection: of the lens.
    """
    times = np.zeros(len(points))
    if motion is None:
        return points, times
    intrinsics = projection.intrinsics
    middle = (intrinsics.height - 1) / 2
    moved = points
    for _ in range(ROUNDS):
        pixels, _ = projection.project(moved)
        times = (np.clip(pixels[:, 1], 0.0, intrinsics.height - 1.0) - middle) * projection.line_time
        moved = at_times(points, motion, times)
    return moved, times


def at_times(points: Array, motion: Array, times: Array) -> Array:
    """Points `(n, 3)` carried to the times `(n,)` of their rows."""
    carried: Array = points - times[:, None] * (points @ skew(motion[:3]).T)
    carried[:, 2] += times * motion[3]
    return carried


def at_rest(along: Array, point: Array, moved: Array, motion: Array, line_time: float) -> Array:
    """Directions in the image `(n, 2)` [px] along which a shift is seen, as they are for points that stand still.

    A point that moves to another row is exposed at another time: a shift of du at rest is seen as (I - T v e_y^T)^-1 du
    with v the speed in the image and T the time of a line, so that n . shift = (n + T (n . v) / (1 - T v_y) e_y) . du.

    Args:
        along: directions in the image `(n, 2)`.
        point: derivative of the pixels by the points `(n, 2, 3)` [px/m].
        moved: the points as they are exposed `(n, 3)` [m; RDF].
        motion: of the camera `(4,)`.
        line_time: [s].
    """
    drift = moved @ skew(motion[:3])
    drift[:, 2] += motion[3]
    speed = (point @ drift[:, :, None])[:, :, 0]
    still = along.copy()
    still[:, 1] += line_time * (along * speed).sum(axis=1) / (1.0 - line_time * speed[:, 1])
    return still


def before_motion(by_point: Array, motion: Array, times: Array) -> Array:
    """Derivative `(n, 3)` by points at rest, of what has the derivative `(n, 3)` by the points as they are exposed."""
    # dP(t) = dP - t w x dP
    rest: Array = by_point - times[:, None] * (by_point @ skew(motion[:3]))
    return rest


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
    """Derivative `(4, n)` by the motion, of what has the derivative `(n, 3)` by the points `(n, 3)`, at rest."""
    # j . (-t w x P) = -t w . (P x j)
    return np.concatenate([-times * cross(points, by_point).T, (times * by_point[:, 2])[None]])


def beyond_motion(by_motion: Array, by_place: Array, times: Array, position: Array) -> Array:
    """Derivative `(5, n)` by what the motion lacks: the angular acceleration [rad/s^2], a speed across [m/s].

    An acceleration a bends the image by a t^2 / 2, which is t / 2 times what the rates do. A speed e across the line of
    sight is in the motion as a turn, which is right at the target's origin P0 only; either axis moves points by what is
    beyond that turn, t (e - w x P) with w = P0 x e / P0^2.

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
