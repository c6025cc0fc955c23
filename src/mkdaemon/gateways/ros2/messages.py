"""Parts of the gateway's messages: stamps, headers, frames; without rclpy."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any, Final, Protocol

from mkdaemon.client.rosmessages import LAST_SECOND, Maker, transform
from mkdaemon.stamp import NANOSECONDS, Stamp

TARGET: Final = "target/"
"""Prefix of the frame of a target."""


class Types(Maker, Protocol):
    """Makes messages, and fields whose types differ from one maker to the other."""

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
    return transform(scene.types, header(scene.types, stamp, parent), child, xyz, wxyz)


def key_value(types: Types, key: str, value: object) -> Any:
    """One pair of a diagnosis."""
    words = "" if value is None else f"{value:.6g}" if isinstance(value, float) else str(value)
    return types.new("diagnostic_msgs/msg/KeyValue", key=key, value=words)
