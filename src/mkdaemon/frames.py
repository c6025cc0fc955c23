"""Coordinate frames and rotations: ENU world, FLU body, RDF camera.

Rotations read target-from-source, so neighbours match: ``enu_from_tag = enu_from_flu @ flu_from_cam @ cam_from_tag``.
Quaternions are ``(w, x, y, z)``, Hamilton convention, ``w >= 0`` after normalisation. See docs/frames.md.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

Vector = npt.NDArray[np.float64]
Matrix = npt.NDArray[np.float64]

EARTH_RADIUS_M = 6_378_137.0
"""Equatorial radius of WGS-84 [m] (NIMA TR8350.2)."""

WGS84_E2 = 6.694379990141e-3
"""First eccentricity squared of WGS-84 (NIMA TR8350.2)."""

FLU_FROM_RDF: Matrix = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
"""Axes of a forward-looking camera (right, down, forward) expressed in body FLU; `(3, 3)`."""


def rotation_from_euler(roll: float, pitch: float, yaw: float) -> Matrix:
    """Build world-from-body from intrinsic yaw, pitch, roll (Z-Y'-X'').

    Args:
        roll: about body forward, right side down positive [rad; FLU].
        pitch: about body left, nose down positive [rad; FLU].
        yaw: about up, nose left positive, zero looking along world x [rad; ENU].

    Returns:
        Rotation `(3, 3)`, ENU from FLU.
    """
    # R = Rz(yaw) Ry(pitch) Rx(roll), multiplied out.
    cr, sr = math.cos(roll), math.sin(roll)
    cp, sp = math.cos(pitch), math.sin(pitch)
    cy, sy = math.cos(yaw), math.sin(yaw)
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )


def euler_from_rotation(rotation: Matrix) -> tuple[float, float, float]:
    """Return `(roll, pitch, yaw)` [rad] of a rotation `(3, 3)`; inverse of `rotation_from_euler`.

    At pitch of ±90 degrees roll is reported as zero and yaw carries the rest.
    """
    sp = -float(rotation[2, 0])
    if abs(sp) > 1.0 - 1e-12:
        yaw = math.atan2(-float(rotation[0, 1]), float(rotation[1, 1]))
        return 0.0, math.copysign(math.pi / 2, sp), yaw
    return (
        math.atan2(float(rotation[2, 1]), float(rotation[2, 2])),
        math.asin(sp),
        math.atan2(float(rotation[1, 0]), float(rotation[0, 0])),
    )


def quaternion_from_rotation(rotation: Matrix) -> tuple[float, float, float, float]:
    """Return `(w, x, y, z)` of a rotation `(3, 3)` by Shepperd's method (J. Guidance and Control 1(3), 1978)."""
    m = rotation
    trace = float(m[0, 0] + m[1, 1] + m[2, 2])
    candidates = np.array([trace, m[0, 0], m[1, 1], m[2, 2]])
    k = int(candidates.argmax())
    if k == 0:
        q = np.array([1.0 + trace, m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1]])
    elif k == 1:
        q = np.array([m[2, 1] - m[1, 2], 1.0 + 2 * m[0, 0] - trace, m[0, 1] + m[1, 0], m[0, 2] + m[2, 0]])
    elif k == 2:
        q = np.array([m[0, 2] - m[2, 0], m[0, 1] + m[1, 0], 1.0 + 2 * m[1, 1] - trace, m[1, 2] + m[2, 1]])
    else:
        q = np.array([m[1, 0] - m[0, 1], m[0, 2] + m[2, 0], m[1, 2] + m[2, 1], 1.0 + 2 * m[2, 2] - trace])
    q /= np.linalg.norm(q)
    if q[0] < 0:
        q = -q
    return float(q[0]), float(q[1]), float(q[2]), float(q[3])


def rotation_from_quaternion(quaternion: tuple[float, float, float, float]) -> Matrix:
    """Return the rotation `(3, 3)` of `(w, x, y, z)`; the quaternion is normalised first.

    Raises:
        ValueError: the quaternion has no length.
    """
    norm = math.hypot(*quaternion)
    if not norm > 0.0:
        msg = "a quaternion of length zero has no rotation"
        raise ValueError(msg)
    # R = I + 2 w [v]x + 2 [v]x [v]x with v = (x, y, z). Source: J. Diebel, "Representing Attitude", Stanford 2006, 6.
    w, x, y, z = (part / norm for part in quaternion)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def wrap_angle(angle: float) -> float:
    """Wrap to (-pi, pi] [rad]."""
    wrapped = math.remainder(angle, 2 * math.pi)
    return math.pi if wrapped == -math.pi else wrapped


def yaw_enu_from_heading(heading: float) -> float:
    """Turn a compass heading (clockwise from north) into ENU yaw (counter-clockwise from east) [rad]."""
    return wrap_angle(math.pi / 2 - heading)


def enu_from_geodetic(
    latitude: float, longitude: float, altitude: float, origin: tuple[float, float, float]
) -> tuple[float, float, float]:
    """Project a geodetic point onto the local tangent plane by the principal radii of curvature at the origin.

    Good to millimetres within a kilometre of the origin, which is farther than a MikroKopter flies.

    Args:
        latitude: [rad].
        longitude: [rad].
        altitude: above the ellipsoid [m].
        origin: latitude [rad], longitude [rad], altitude [m] of the plane's origin.

    Returns:
        East, north, up [m].

    Source: Torge, Geodesy, 3rd ed., 4.1.3 (radii of curvature in meridian and prime vertical).
    """
    lat0, lon0, alt0 = origin
    w2 = 1.0 - WGS84_E2 * math.sin(lat0) ** 2
    prime_vertical = EARTH_RADIUS_M / math.sqrt(w2)
    meridian = EARTH_RADIUS_M * (1.0 - WGS84_E2) / w2**1.5
    east = wrap_angle(longitude - lon0) * math.cos(lat0) * (prime_vertical + alt0)
    north = (latitude - lat0) * (meridian + alt0)
    return east, north, altitude - alt0


def geodetic_from_enu(
    east: float, north: float, up: float, origin: tuple[float, float, float]
) -> tuple[float, float, float]:
    """Return latitude [rad], longitude [rad], altitude [m]; inverse of `enu_from_geodetic`."""
    lat0, lon0, alt0 = origin
    w2 = 1.0 - WGS84_E2 * math.sin(lat0) ** 2
    prime_vertical = EARTH_RADIUS_M / math.sqrt(w2)
    meridian = EARTH_RADIUS_M * (1.0 - WGS84_E2) / w2**1.5
    return (
        lat0 + north / (meridian + alt0),
        lon0 + east / ((prime_vertical + alt0) * math.cos(lat0)),
        alt0 + up,
    )
