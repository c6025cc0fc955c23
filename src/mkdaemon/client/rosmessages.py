"""Messages of ROS 2 that the gateway publishes and a bag holds: one table of their fields, for every maker of types.

Our axes are those of REP 103: ENU world, FLU body, RDF cameras, radians, metres, so nothing is turned. Quaternions go
from (w, x, y, z) to ROS's fields by name. What a board does not tell is marked as unknown, as each type says.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Any, Final, Protocol

import numpy as np
import numpy.typing as npt

LAST_SECOND: Final = (1 << 31) - 1
"""Of a stamp in ROS [s; Unix time]."""
FULL_STICK: Final = 127.0
"""Count of a stick at its end; axes of a Joy go from -1 to 1."""

Doubles = npt.NDArray[np.float64]


class Maker(Protocol):
    """Makes messages: those of rclpy in the gateway, those of rosbags in a bag."""

    def new(self, kind: str, **fields: Any) -> Any:
        """Make a message, for example of `sensor_msgs/msg/Imu`."""


def vector(types: Maker, xyz: Iterable[float]) -> Any:
    """A `Vector3`."""
    x, y, z = xyz
    return types.new("geometry_msgs/msg/Vector3", x=float(x), y=float(y), z=float(z))


def point(types: Maker, xyz: Iterable[float]) -> Any:
    """A `Point`."""
    x, y, z = xyz
    return types.new("geometry_msgs/msg/Point", x=float(x), y=float(y), z=float(z))


def quaternion(types: Maker, wxyz: Iterable[float]) -> Any:
    """A `Quaternion` of (w, x, y, z)."""
    w, x, y, z = wxyz
    return types.new("geometry_msgs/msg/Quaternion", x=float(x), y=float(y), z=float(z), w=float(w))


def pose(types: Maker, xyz: Iterable[float], wxyz: Iterable[float]) -> Any:
    """A `Pose`."""
    return types.new("geometry_msgs/msg/Pose", position=point(types, xyz), orientation=quaternion(types, wxyz))


def pose_with_covariance(types: Maker, pose: Any, covariance: Doubles | Sequence[float]) -> Any:
    """A `PoseWithCovariance`; its rows and axes (36,) are ours."""
    spread = np.array(covariance, dtype=np.float64)
    return types.new("geometry_msgs/msg/PoseWithCovariance", pose=pose, covariance=spread)


def stamped_pose_with_covariance(types: Maker, header: Any, pose: Any, covariance: Sequence[float]) -> Any:
    """A `PoseWithCovarianceStamped`."""
    spread = pose_with_covariance(types, pose, covariance)
    return types.new("geometry_msgs/msg/PoseWithCovarianceStamped", header=header, pose=spread)


def transform(types: Maker, header: Any, child: str, xyz: Iterable[float], wxyz: Iterable[float]) -> Any:
    """A `TransformStamped`, one edge of the tree.

    Args:
        types: makes it.
        header: names the parent.
        child: frame, as ROS names it.
        xyz: origin of the child in the parent [m].
        wxyz: rotation parent from child.
    """
    moved = types.new("geometry_msgs/msg/Transform", translation=vector(types, xyz), rotation=quaternion(types, wxyz))
    return types.new("geometry_msgs/msg/TransformStamped", header=header, child_frame_id=child, transform=moved)


def tree(types: Maker, *edges: Any) -> Any:
    """A `TFMessage`."""
    return types.new("tf2_msgs/msg/TFMessage", transforms=list(edges))


def fix(types: Maker, header: Any, status: int, latitude: float, longitude: float, altitude: float | None) -> Any:
    """A `NavSatFix` [deg, m]; status 0 has a position, -1 has none."""
    return types.new(
        "sensor_msgs/msg/NavSatFix",
        header=header,
        status=types.new("sensor_msgs/msg/NavSatStatus", status=status, service=1),
        latitude=latitude,
        longitude=longitude,
        altitude=math.nan if altitude is None else float(altitude),
        position_covariance=np.zeros(9),
        position_covariance_type=0,
    )


def imu(
    types: Maker, header: Any, wxyz: Iterable[float], rates: Iterable[float] | None = None, variance: float = 0.0
) -> Any:
    """An `Imu`: the boards send no accelerations.

    Args:
        types: makes it.
        header: of it.
        wxyz: orientation, ENU from FLU.
        rates: turn rates [rad/s; FLU]; None where they are not known.
        variance: of each rate [(rad/s)2].
    """
    nothing = vector(types, (0.0, 0.0, 0.0))
    missing = np.array([-1.0] + [0.0] * 8)
    return types.new(
        "sensor_msgs/msg/Imu",
        header=header,
        orientation=quaternion(types, wxyz),
        orientation_covariance=np.zeros(9),
        angular_velocity=nothing if rates is None else vector(types, rates),
        angular_velocity_covariance=missing if rates is None else np.eye(3).ravel() * variance,
        linear_acceleration=nothing,
        linear_acceleration_covariance=missing,
    )


def battery_state(types: Maker, header: Any, voltage: float, current: float | None, cells: int = 0) -> Any:
    """A `BatteryState` [V, A]: current is negative when discharging; what the boards do not know is NaN."""
    return types.new(
        "sensor_msgs/msg/BatteryState",
        header=header,
        voltage=voltage,
        temperature=math.nan,
        current=math.nan if current is None else -current,
        charge=math.nan,
        capacity=math.nan,
        design_capacity=math.nan,
        percentage=math.nan,
        power_supply_status=2,
        power_supply_health=0,
        power_supply_technology=3,
        present=True,
        cell_voltage=np.full(cells, np.nan, dtype=np.float32),
        cell_temperature=np.zeros(0, dtype=np.float32),
        location="",
        serial_number="",
    )


def joy(types: Maker, header: Any, counts: Sequence[float], *, button: bool) -> Any:
    """A `Joy` of sticks in counts: pitch, roll, yaw, throttle as shares of the way, FLU, and one button."""
    return types.new(
        "sensor_msgs/msg/Joy",
        header=header,
        axes=np.array(counts, dtype=np.float32) / np.float32(FULL_STICK),
        buttons=np.array([int(button)], dtype=np.int32),
    )
