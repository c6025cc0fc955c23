"""Parts of the gateway's messages and of a bag's: stamps, headers, frames, poses; without rclpy.

Our axes are those of REP 103: ENU world, FLU body, RDF cameras, radians, metres, so nothing is turned. Quaternions go
from (w, x, y, z) to ROS's fields by name. What a board does not send is marked as unknown, as each type says.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any, Final, Protocol

import numpy as np
import numpy.typing as npt

from mkdaemon.stamp import NANOSECONDS, Stamp

LAST_SECOND: Final = (1 << 31) - 1
"""Of a stamp in ROS [s; Unix time]."""
TARGET: Final = "target/"
"""Prefix of the frame of a target."""


Doubles = npt.NDArray[np.float64]


class Types(Protocol):
    """Makes messages, those of rclpy in the gateway and of rosbags in a bag, and fields whose types differ there."""

    def new(self, kind: str, **fields: Any) -> Any:
        """Make a message, for example of `sensor_msgs/msg/Imu`; a field that is not given is zero or empty."""

    def octets(self, raw: bytes) -> Any:
        """Make the value of a field `uint8[]`."""

    def octet(self, value: int) -> Any:
        """Make the value of a field `byte`."""


@dataclass(frozen=True, slots=True)
class Frames:
    """Names of frames by REP 105.

    Attributes:
        prefix: before every one of them, for several aircraft in one tree, for example `mk1/`.
    """

    prefix: str = ""

    @property
    def map(self) -> str:
        """ENU, origin at home."""
        return f"{self.prefix}map"

    @property
    def odom(self) -> str:
        """The same; what corrects odometry would stand between both."""
        return f"{self.prefix}odom"

    @property
    def body(self) -> str:
        """FLU, the vehicle."""
        return f"{self.prefix}base_link"

    def camera(self, name: str) -> str:
        """RDF, a camera."""
        return f"{self.prefix}{name}_optical_frame"

    def target(self, name: str) -> str:
        """A target: x to the right of its print, y to its top, z out of the paper."""
        return f"{self.prefix}{TARGET}{name}"

    def of_edge(self, name: str) -> str:
        """A frame as the daemon's `tf` names it."""
        if name == "body":
            return self.body
        kind, mark, camera = name.partition("/")
        return self.camera(camera) if mark and kind == "camera" else self.target(name.removeprefix(TARGET))


@dataclass(frozen=True, slots=True)
class ConversionScene:
    """What a conversion may look at beside its value.

    Attributes:
        types: makes messages.
        frames: names of frames.
        latest: newest value of each key, by its suffix.
        vehicle: its name.
    """

    types: Types
    frames: Frames = Frames()
    latest: Mapping[str, Any] = field(default_factory=lambda: MappingProxyType({}))
    vehicle: str = ""


def name_part(name: str) -> str:
    """A vehicle's or camera's name as a part of a ROS name: letters, digits and `_`, no digit first."""
    plain = re.sub(r"[^A-Za-z0-9_]", "_", name)
    return f"mk_{plain}" if plain[:1].isdigit() else plain


def time(types: Types, stamp: Stamp) -> Any:
    """The measured time of a value; a moment ROS cannot have becomes the nearest it can."""
    seconds = min(max(stamp.wall, 0.0), float(LAST_SECOND))
    whole = math.floor(seconds)
    # Apart: a product of both has no room for nanoseconds in a double.
    rest = min(round((seconds - whole) * NANOSECONDS), NANOSECONDS - 1)
    return types.new("builtin_interfaces/msg/Time", sec=whole, nanosec=rest)


def header(types: Types, stamp: Stamp, frame: str) -> Any:
    """A header with the measured time."""
    return types.new("std_msgs/msg/Header", stamp=time(types, stamp), frame_id=frame)


def vector(types: Types, xyz: Iterable[float], kind: str = "Vector3") -> Any:
    """A `Vector3`, or another kind of `geometry_msgs` with the same fields."""
    x, y, z = xyz
    return types.new(f"geometry_msgs/msg/{kind}", x=float(x), y=float(y), z=float(z))


def quaternion(types: Types, wxyz: Iterable[float]) -> Any:
    """A `Quaternion` of (w, x, y, z)."""
    w, x, y, z = wxyz
    return types.new("geometry_msgs/msg/Quaternion", x=float(x), y=float(y), z=float(z), w=float(w))


def pose(types: Types, xyz: Iterable[float], wxyz: Iterable[float]) -> Any:
    """A `Pose`."""
    place = vector(types, xyz, "Point")
    return types.new("geometry_msgs/msg/Pose", position=place, orientation=quaternion(types, wxyz))


def pose_with_covariance(types: Types, pose: Any, covariance: Doubles | Sequence[float]) -> Any:
    """A `PoseWithCovariance`; its rows and axes (36,) are ours."""
    spread = np.array(covariance, dtype=np.float64)
    return types.new("geometry_msgs/msg/PoseWithCovariance", pose=pose, covariance=spread)


def tree(types: Types, *edges: Any) -> Any:
    """A `TFMessage`."""
    return types.new("tf2_msgs/msg/TFMessage", transforms=list(edges))


def stamped_transform(
    scene: ConversionScene, stamp: Stamp, parent: str, child: str, xyz: Iterable[float], wxyz: Iterable[float]
) -> Any:
    """One edge of the tree.

    Args:
        scene: makes it.
        stamp: when it was measured.
        parent: frame, as ROS names it.
        child: frame, as ROS names it.
        xyz: origin of the child in the parent [m].
        wxyz: rotation parent from child.
    """
    types = scene.types
    moved = types.new("geometry_msgs/msg/Transform", translation=vector(types, xyz), rotation=quaternion(types, wxyz))
    at = header(types, stamp, parent)
    return types.new("geometry_msgs/msg/TransformStamped", header=at, child_frame_id=child, transform=moved)


def key_value(types: Types, key: str, value: object) -> Any:
    """One pair of a diagnosis."""
    words = "" if value is None else f"{value:.6g}" if isinstance(value, float) else str(value)
    return types.new("diagnostic_msgs/msg/KeyValue", key=key, value=words)
