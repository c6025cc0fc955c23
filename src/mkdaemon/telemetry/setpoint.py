"""Setpoints that clients stream, each with its lease, a sequence number and a time to live."""

import math
from enum import StrEnum
from typing import Annotated, ClassVar, Final

from pydantic import Field

from mkdaemon.telemetry.base import Command


class Setpoint(Command):
    """Fields of every setpoint. Its age counts from the send time, if its signature carries one, else from arrival.

    Attributes:
        suffix: key it is streamed to, without `mk/<vehicle>/`.
        about: what it asks for, in a few words.
    """

    suffix: ClassVar[str]
    about: ClassVar[str]

    @property
    def kind(self) -> str:
        """Last word of its key."""
        return self.suffix.removeprefix("setpoint/")

    epoch: int = Field(ge=0)
    """Epoch of the lease it stands on."""
    sequence: int = Field(ge=0)
    """Counts up from one setpoint of an epoch to the next, whatever their kind."""
    ttl: float = Field(gt=0, le=1.0)
    """Age at which it no longer holds [s]; the daemon's own limit applies as well."""
    after_abort: int = Field(default=0, ge=0)
    """Number of the abort that it ends, as counted by `aborts` of `control/status`: its holder knows of it and
    continues. With any other number an aborted flight stays aborted."""


class TargetSetpoint(Setpoint):
    """A setpoint relative to a target."""

    target: str = Field(default="", max_length=100)
    """Name of the target; empty for the one in sight, which is refused where there are two."""


class StickSetpoint(Setpoint):
    """Stick offsets, FLU signs: `setpoint/stick`."""

    suffix: ClassVar[str] = "setpoint/stick"
    about: ClassVar[str] = "Stick offsets"

    pitch: float = Field(ge=-127, le=127)
    """Nose down positive [stick]."""
    roll: float = Field(ge=-127, le=127)
    """Right side down positive [stick]."""
    yaw: float = Field(ge=-127, le=127)
    """Nose left positive [stick]."""
    throttle: float = Field(ge=-127, le=127)
    """More lift positive [stick from the centre]. Stock firmware takes the smaller of this and the pilot's."""


class SetpointFrame(StrEnum):
    """The frame a velocity or a position is given in; docs/frames.md."""

    HOME = "home"
    """ENU axes; origin at the home position."""
    PAD = "pad"
    """Axes and origin of the target in use; a velocity is relative to a target that moves."""
    BODY = "body"
    """FLU axes turned level; origin at the vehicle, for a position where it was when the first setpoint of this
    position arrived."""


_Angle = Annotated[float, Field(ge=-math.pi, le=math.pi)]
_Tilt = Annotated[float, Field(ge=-math.pi / 4, le=math.pi / 4)]
_Speed = Annotated[float, Field(ge=-20.0, le=20.0)]
_Metres = Annotated[float, Field(ge=-10_000.0, le=10_000.0)]


class AttitudeSetpoint(Setpoint):
    """Attitude and thrust, FLU signs: `setpoint/attitude`."""

    suffix: ClassVar[str] = "setpoint/attitude"
    about: ClassVar[str] = "Attitude and thrust"

    roll: _Tilt
    """Right side down positive [rad]."""
    pitch: _Tilt
    """Nose down positive [rad]."""
    yaw_rate: float = Field(ge=-math.pi, le=math.pi)
    """Nose left positive [rad/s]."""
    thrust: float = Field(ge=0, le=2)
    """Thrust along the body's up axis, as a share of the weight: 1 carries the aircraft when level."""


class VelocitySetpoint(TargetSetpoint):
    """Velocity: `setpoint/velocity`."""

    suffix: ClassVar[str] = "setpoint/velocity"
    about: ClassVar[str] = "Velocity"

    velocity: tuple[_Speed, _Speed, _Speed] = Field(strict=False)
    """In the axes of `frame` [m/s]."""
    frame: SetpointFrame = Field(strict=False)
    """What the velocity is given in."""
    yaw_rate: float = Field(default=0.0, ge=-math.pi, le=math.pi)
    """Nose left positive [rad/s]."""


class PositionSetpoint(TargetSetpoint):
    """Position and heading: `setpoint/position`."""

    suffix: ClassVar[str] = "setpoint/position"
    about: ClassVar[str] = "Position and heading"

    position: tuple[_Metres, _Metres, _Metres] = Field(strict=False)
    """In the axes of `frame`, from its origin [m]."""
    frame: SetpointFrame = Field(strict=False)
    """What the position is given in."""
    yaw: _Angle | None = None
    """Heading about the up axis of `frame`, counter-clockwise from its first axis [rad]; null to keep the heading."""


class HoldSetpoint(TargetSetpoint):
    """Stay where the aircraft is when the first of them arrives: `setpoint/hold`."""

    suffix: ClassVar[str] = "setpoint/hold"
    about: ClassVar[str] = "Stay over the target in sight"


class TakeOffSetpoint(TargetSetpoint):
    """Take off and hold over the middle of the target: `setpoint/takeoff`. The pilot has started the motors."""

    suffix: ClassVar[str] = "setpoint/takeoff"
    about: ClassVar[str] = "Take off and hold"

    height: float = Field(ge=0.5, le=10.0)
    """Above the target [m]; never above the configured fence."""


class LandSetpoint(TargetSetpoint):
    """Land on the target in sight: `setpoint/land`. Streamed until touchdown; then the aircraft is released."""

    suffix: ClassVar[str] = "setpoint/land"
    about: ClassVar[str] = "Land on the target in sight"

    yaw: _Angle | None = None
    """Heading about the up axis of the target, counter-clockwise from its first axis [rad]; null to keep it."""


class PathSetpoint(TargetSetpoint):
    """Fly along a path that was uploaded, from its first point on: `setpoint/path`."""

    suffix: ClassVar[str] = "setpoint/path"
    about: ClassVar[str] = "Fly along a path that was uploaded"

    path: str = Field(min_length=1, max_length=64)
    """Its id: the answer to `do/path_upload`."""
    run: int = Field(default=0, ge=0)
    """Number of this flight along it, chosen by the client: another one begins at the first point again."""
    paused: bool = False
    """Stop on the path, and hold there; false goes on."""


SETPOINTS: Final[tuple[type[Setpoint], ...]] = (
    StickSetpoint,
    AttitudeSetpoint,
    VelocitySetpoint,
    PositionSetpoint,
    HoldSetpoint,
    TakeOffSetpoint,
    LandSetpoint,
    PathSetpoint,
)
"""Every kind of setpoint."""
