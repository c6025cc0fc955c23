"""What ROS sends to fly: messages of `joy`, `cmd_vel`, `setpoint_pose` and `path` as what the daemon flies; pure."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Final

from pydantic import ValidationError

from mkdaemon.client.teleop.inputs import AxisRange, PadFacts
from mkdaemon.errors import ConfigError, MkError
from mkdaemon.gateways.ros2.conversions import yaw_of
from mkdaemon.gateways.ros2.messages import TARGET, Frames
from mkdaemon.stamp import NANOSECONDS
from mkdaemon.telemetry.path import PathPoint, PathUploadRequest

AXES: Final = ("ABS_X", "ABS_Y", "ABS_Z", "ABS_RX", "ABS_RY", "ABS_RZ", "ABS_HAT0X", "ABS_HAT0Y")
"""The kernel's names of the axes of a Joy, in its order, as `joy` has an Xbox pad: ascending codes, then the hat."""
BUTTONS: Final = (
    "BTN_A",
    "BTN_B",
    "BTN_X",
    "BTN_Y",
    "BTN_TL",
    "BTN_TR",
    "BTN_SELECT",
    "BTN_START",
    "BTN_MODE",
    "BTN_THUMBL",
    "BTN_THUMBR",
)
"""The same for its buttons."""
TWIST: Final = "geometry_msgs/msg/Twist"
TWIST_STAMPED: Final = "geometry_msgs/msg/TwistStamped"
SILENCE: Final = 1.0
"""Silence of a topic after its commands ended, before it counts again [s]."""
GONE: Final = 0.9
"""A topic is not flown any more after this silence [s]; docs/safety.md, as a gamepad."""


def pad_facts(axes: Sequence[str], buttons: Sequence[str]) -> PadFacts:
    """A pad behind the topic `joy`.

    Args:
        axes: the kernel's names, in the order of the message.
        buttons: the same.
    """
    ranges = dict.fromkeys(axes, AxisRange(-1.0, 1.0))
    return PadFacts("the pad of joy", ranges, frozenset(buttons), speaker="the publisher of joy")


def pad_state(joy: Any, axes: Sequence[str], buttons: Sequence[str]) -> dict[str, float]:
    """Values by control, as the kernel would say them: ROS counts left and up as positive, the kernel right and down.

    Args:
        joy: a `sensor_msgs/Joy`.
        axes: the kernel's names, in its order.
        buttons: the same.

    Raises:
        MkError: it has fewer axes or buttons than names, or a number is none.
    """
    if len(joy.axes) < len(axes) or len(joy.buttons) < len(buttons):
        raise MkError(
            f"joy has {len(joy.axes)} axes and {len(joy.buttons)} buttons, and joy.axes and joy.buttons name "
            f"{len(axes)} and {len(buttons)}: another pad?"
        )
    values = {name: -float(value) for name, value in zip(axes, joy.axes, strict=False)}
    values |= {name: float(value) for name, value in zip(buttons, joy.buttons, strict=False)}
    _require_numbers("joy", *values.values())
    return values


def _require_numbers(name: str, *values: float) -> None:
    if not all(map(math.isfinite, values)):
        raise MkError(f"{name} holds a NaN or an infinity")


def age_of(stamp: Any, wall: float) -> float:
    """How old a message was when it arrived, by its stamp [s]; 0 for one without a stamp, or from the future.

    Args:
        stamp: a `builtin_interfaces/Time`.
        wall: Unix time of its arrival [s].
    """
    if not stamp.sec and not stamp.nanosec:
        return 0.0
    sent = float(stamp.sec) + float(stamp.nanosec) / NANOSECONDS
    return max(wall - sent, 0.0)


def other_type(name: str, subscribed: str, published: str) -> str:
    """Words for a publisher whose messages never arrive, with the remedy.

    Args:
        name: of the topic.
        subscribed: type that the gateway takes.
        published: type that another node publishes.
    """
    words = f"{name} is published as {published}, which is not read: the gateway takes {subscribed} there"
    if name == "cmd_vel" and published == TWIST_STAMPED:
        return f"{words}. Start it with -p cmd_vel.stamped:=true, or publish to cmd_vel_stamped."
    if name == "cmd_vel" and published == TWIST:
        return f"{words}. Start it with -p cmd_vel.stamped:=false."
    return f"{words}."


def velocity_fields(twist: Any, frame: str) -> dict[str, Any]:
    """Fields of a velocity setpoint: linear [m/s] in the axes of `frame`, and the turn about up [rad/s].

    Args:
        twist: a `geometry_msgs/Twist`.
        frame: `body` or `pad`.

    Raises:
        MkError: a number is none.
    """
    linear = (float(twist.linear.x), float(twist.linear.y), float(twist.linear.z))
    turn = float(twist.angular.z)
    _require_numbers("cmd_vel", *linear, turn)
    return {"velocity": linear, "frame": frame, "yaw_rate": turn}


def position_fields(pose: Any, frame: str) -> dict[str, Any]:
    """Fields of a position setpoint: place [m] and heading in the axes of `frame`; all zeros keep the heading.

    Args:
        pose: a `geometry_msgs/Pose`.
        frame: `body` or `pad`.

    Raises:
        MkError: a number is none.
    """
    place = (float(pose.position.x), float(pose.position.y), float(pose.position.z))
    turned = pose.orientation
    _require_numbers("setpoint_pose", *place, turned.x, turned.y, turned.z, turned.w)
    return {"position": place, "frame": frame, "yaw": yaw_of(turned)}


def path_request(path: Any, speed: float) -> PathUploadRequest:
    """A path through the poses of a message, at the times of their stamps, or at a speed where no stamp counts up.

    Args:
        path: a `nav_msgs/Path`.
        speed: [m/s].

    Raises:
        MkError: it has too few or too many poses, a number is none, or its stamps do not count up.
    """
    times = [pose.header.stamp.sec + pose.header.stamp.nanosec / NANOSECONDS for pose in path.poses]
    is_timed = bool(times) and max(times) > min(times)
    steps = [None, *(later - before for before, later in pairwise(times))] if is_timed else [None] * len(times)
    try:
        points = [
            PathPoint(
                position=(float(at.pose.position.x), float(at.pose.position.y), float(at.pose.position.z)),
                yaw=yaw_of(at.pose.orientation),
                time=step,
                speed=speed if number and not is_timed else None,
            )
            for number, (at, step) in enumerate(zip(path.poses, steps, strict=True))
        ]
        return PathUploadRequest(points=tuple(points))
    except ValidationError as error:
        first = error.errors()[0]
        place = ".".join(str(part) for part in first["loc"])
        raise MkError(f"path: {place + ': ' if place else ''}{first['msg'].removeprefix('Value error, ')}") from error


def setpoint_frame(frame_id: str, frames: Frames, default: str) -> str:
    """The daemon's word for the frame of a header.

    Args:
        frame_id: as the header has it; empty for the default.
        frames: names of frames.
        default: `body` or `pad`.

    Raises:
        MkError: nothing is flown in this frame; says in which.
    """
    if not frame_id:
        return default
    if frame_id == frames.body:
        return "body"
    if frame_id.startswith(f"{frames.prefix}{TARGET}"):
        return "pad"
    raise MkError(
        f"nothing is flown in frame {frame_id!r}: give it in {frames.body} or {frames.target('NAME')} (docs/frames.md)"
    )


def frame_word(word: str, parameter: str) -> str:
    """Check a parameter that names a frame.

    Raises:
        ConfigError: it is neither `body` nor `pad`.
    """
    if word not in {"body", "pad"}:
        raise ConfigError(f"{parameter} is body or pad, not {word!r}")
    return word


@dataclass(slots=True)
class CommandStream:
    """The dead-man rules of one topic that streams setpoints.

    Attributes:
        name: of the topic.
        arrived_at: when its newest message arrived [s; monotonic]; None before the first.
        is_shut: its commands have ended, so it must be silent first.
    """

    name: str
    arrived_at: float | None = None
    is_shut: bool = False

    def arrived(self, now: float) -> bool:
        """Take note of a message; whether it counts."""
        silence = math.inf if self.arrived_at is None else now - self.arrived_at
        self.arrived_at = now
        if self.is_shut and silence < SILENCE:
            return False
        self.is_shut = False
        return True

    def ended(self) -> None:
        """Take note that its stream has ended: the lease was lost, refused or released."""
        self.is_shut = True

    def is_gone(self, now: float) -> bool:
        """Whether nothing has come for too long."""
        return self.arrived_at is None or now - self.arrived_at >= GONE


def newer(stamp: Any, last: Any) -> bool:
    """Whether a stamp is another than the last one; stamps of zero always count."""
    return last is None or not (stamp.sec or stamp.nanosec) or (stamp.sec, stamp.nanosec) != last


def names_from(given: Sequence[str], known: Mapping[str, object], what: str) -> list[str]:
    """Check names against what there is; no name stands for all.

    Raises:
        ConfigError: one is not known; says which there are.
    """
    unknown = [name for name in given if name not in known]
    if unknown:
        raise ConfigError(f"{what} does not know {', '.join(unknown)}; there is {', '.join(known)}")
    return list(given) or list(known)
