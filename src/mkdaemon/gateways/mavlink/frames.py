"""The axes of MAVLink and ours: NED and FRD there, ENU and FLU here; the only place where an axis turns.

The local frame of the gateway is that of the target in sight: "north" is the top of its print, "east" its right side,
"down" into the paper; its origin is the middle of the print.
"""

from __future__ import annotations

import math

from mkdaemon.frames import wrap_angle

Vector3 = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]

_HALF = math.sqrt(0.5)


def ned_from_enu(vector: Vector3) -> Vector3:
    """East, north, up to north, east, down; and back, for it is its own inverse."""
    return (vector[1], vector[0], -vector[2])


def frd_from_flu(vector: Vector3) -> Vector3:
    """Forward, left, up to forward, right, down; and back, for it is its own inverse."""
    return (vector[0], -vector[1], -vector[2])


def multiplied(a: Quaternion, b: Quaternion) -> Quaternion:
    """The rotation `b`, then `a`."""
    aw, ax, ay, az = a
    bw, bx, by, bz = b
    return (
        aw * bw - ax * bx - ay * by - az * bz,
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
    )


def ned_from_frd(enu_from_flu: Quaternion) -> Quaternion:
    """The same attitude between the axes of MAVLink; w is not negative."""
    turned = multiplied(multiplied((0.0, _HALF, _HALF, 0.0), enu_from_flu), (0.0, 1.0, 0.0, 0.0))
    w, x, y, z = turned
    return (-w, -x, -y, -z) if w < 0.0 else turned


def frd_from_local(flu_from_target: Quaternion) -> Quaternion:
    """Orientation of the local frame, north, east and down of the target, in the body; w is not negative."""
    turned = multiplied(multiplied((0.0, 1.0, 0.0, 0.0), flu_from_target), (0.0, -_HALF, -_HALF, 0.0))
    w, x, y, z = turned
    return (-w, -x, -y, -z) if w < 0.0 else turned


def compass_from_yaw(yaw: float) -> float:
    """A yaw counter-clockwise from east as a heading clockwise from north, in (-pi, pi]; and back."""
    return wrap_angle(math.pi / 2 - yaw)


def heading_cdeg(yaw: float) -> int:
    """A yaw counter-clockwise from east as a compass heading, 0 to 35999 [cdeg]."""
    return round(math.degrees(compass_from_yaw(yaw)) * 100) % 36_000


def degrees_e7(degrees: float) -> int:
    """Latitude or longitude as MAVLink has it [1e-7 deg]."""
    return round(degrees * 1e7)
