"""Where the aircraft is: as the flight core believes, as a camera saw it, or by GPS."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from mkdaemon.frames import rotation_from_euler, rotation_from_quaternion
from mkdaemon.stamp import Stamp
from mkdaemon.telemetry.control import ControlEstimate
from mkdaemon.telemetry.state import Attitude, Position
from mkdaemon.telemetry.vision import VisionPose

Array = npt.NDArray[np.float64]

SIGMAS: Final = 3.0
"""The ellipsoid holds the aircraft with 97 % where the estimate is right about itself."""
HOME: Final = "home"
"""Name of the frame of a place by GPS: east, north, up of where the motors were started."""


@dataclass(frozen=True, slots=True)
class AircraftPlace:
    """Where the aircraft is drawn.

    Attributes:
        position: in the frame (3,) [m].
        rotation: frame from body (3, 3).
        frame: name of the target, or `HOME`.
        source: `estimate`, `pose` or `gps`.
        spread: ellipsoid at `SIGMAS`: the unit sphere is turned and stretched by it (3, 3) [m]; None where not known.
        stamp: when it was so.
    """

    position: Array
    rotation: Array
    frame: str
    source: str
    spread: Array | None
    stamp: Stamp

    @property
    def at(self) -> float:
        """When it was so [s; the daemon's monotonic]."""
        return self.stamp.monotonic


def place_of_estimate(estimate: ControlEstimate, attitude: Attitude | None) -> AircraftPlace:
    """The place that the flight core believes; level where no attitude is known."""
    roll, pitch = (0.0, 0.0) if attitude is None else (attitude.roll, attitude.pitch)
    variances = [axis[0] for axis in estimate.covariance] if estimate.covariance else np.square(estimate.position_sd)
    return AircraftPlace(
        np.array(estimate.position),
        rotation_from_euler(roll, pitch, estimate.yaw),
        estimate.target,
        "estimate",
        np.diag(SIGMAS * np.sqrt(variances)),
        estimate.stamp,
    )


def place_of_pose(pose: VisionPose) -> AircraftPlace:
    """The place that a camera saw."""
    variances, axes = np.linalg.eigh(np.array(pose.covariance).reshape(6, 6)[:3, :3])
    return AircraftPlace(
        np.array(pose.position_target),
        rotation_from_quaternion(pose.quaternion_target_from_flu),
        pose.target,
        "pose",
        axes * (SIGMAS * np.sqrt(np.maximum(variances, 0.0))),
        pose.stamp,
    )


def place_of_gps(position: Position, attitude: Attitude) -> AircraftPlace | None:
    """The place by GPS, its height by barometer; None until home is known."""
    if position.position_enu is None:
        return None
    turn = rotation_from_euler(attitude.roll, attitude.pitch, attitude.yaw)
    return AircraftPlace(np.array(position.position_enu), turn, HOME, "gps", None, position.stamp)
