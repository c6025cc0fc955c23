"""A mounting turned by what a flight says, as the camera file writes it."""

from __future__ import annotations

from math import radians

import cv2
import numpy as np
import numpy.typing as npt

from mkdaemon.config.camera import MountSection
from mkdaemon.frames import euler_from_rotation, rotation_from_euler

Array = npt.NDArray[np.float64]


def turned_rpy_deg(mount: MountSection, turn: Array) -> tuple[float, float, float]:
    """Angles of a mount [deg] after a turn by the rotation vector `(3,)` [rad; body], `rpy_deg` of the camera file."""
    roll, pitch, yaw = (radians(angle) for angle in mount.rpy_deg)
    after = np.asarray(cv2.Rodrigues(turn.reshape(3, 1))[0]) @ rotation_from_euler(roll, pitch, yaw)
    roll, pitch, yaw = (float(np.degrees(angle)) for angle in euler_from_rotation(after))
    return roll, pitch, yaw
