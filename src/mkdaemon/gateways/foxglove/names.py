"""How a vehicle's topics and frames are called, and times as Foxglove has them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from foxglove.messages import Pose, Quaternion, Timestamp, Vector3

from mkdaemon.client.place import HOME, Array
from mkdaemon.frames import quaternion_from_rotation
from mkdaemon.stamp import NANOSECONDS, Stamp, nanoseconds

LATEST: Final = (1 << 32) * NANOSECONDS - 1
"""The last time that a Foxglove timestamp can have [ns]."""


@dataclass(frozen=True, slots=True)
class Names:
    """Names of one vehicle.

    Attributes:
        vehicle: its name.
        prefix: of its topics and frames: empty for the only vehicle of a gateway, else its name and a slash.
    """

    vehicle: str
    prefix: str = ""

    def topic(self, name: str) -> str:
        """A topic, from its name with a slash before it."""
        return f"/{self.prefix}{name[1:]}"

    @property
    def map(self) -> str:
        """The frame in which the vehicle flies: the target's in sight, else that of home."""
        return f"{self.prefix}map"

    @property
    def body(self) -> str:
        """The vehicle: forward, left, up."""
        return f"{self.prefix}base_link"

    @property
    def home(self) -> str:
        """Where the motors were started: east, north, up."""
        return f"{self.prefix}home"

    def root(self, frame: str) -> str:
        """The frame of a place: a target's, or home's."""
        return self.home if frame == HOME else frame

    def camera(self, name: str) -> str:
        """A camera: right, down, forward."""
        return f"{self.prefix}camera/{name}"


def time_ns(stamp: Stamp) -> int:
    """The wall time of a stamp [ns], as far as Foxglove can say it."""
    return min(max(nanoseconds(stamp.wall), 0), LATEST)


def timestamp(stamp: Stamp) -> Timestamp:
    """The wall time of a stamp."""
    sec, nsec = divmod(time_ns(stamp), NANOSECONDS)
    return Timestamp(sec, nsec)


def vector(values: Array | tuple[float, ...]) -> Vector3:
    """Three numbers (3,)."""
    x, y, z = (float(value) for value in values)
    return Vector3(x=x, y=y, z=z)


def quaternion(values: tuple[float, float, float, float]) -> Quaternion:
    """A rotation (w, x, y, z)."""
    w, x, y, z = values
    return Quaternion(x=x, y=y, z=z, w=w)


def pose(position: Array | tuple[float, ...], rotation: Array) -> Pose:
    """A pose, from a position (3,) [m] and a rotation (3, 3)."""
    return Pose(position=vector(position), orientation=quaternion(quaternion_from_rotation(rotation)))
