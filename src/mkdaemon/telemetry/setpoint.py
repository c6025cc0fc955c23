"""What clients stream to fly: setpoints, each with the lease it stands on, a sequence number and a time to live."""

from __future__ import annotations

from typing import ClassVar

from pydantic import Field

from mkdaemon.telemetry.base import Command


class Setpoint(Command):
    """What every setpoint carries. The daemon stamps its arrival; clocks of clients are not trusted.

    Attributes:
        suffix: key it is streamed to, without `mk/<vehicle>/`.
    """

    suffix: ClassVar[str]
    epoch: int = Field(ge=0)
    """Epoch of the lease it stands on."""
    sequence: int = Field(ge=0)
    """Counts up from one setpoint of an epoch to the next."""
    ttl: float = Field(gt=0, le=1.0, strict=False)
    """Time after arrival at which it no longer holds [s]; the daemon's own limit applies as well."""


class StickSetpoint(Setpoint):
    """Stick offsets, FLU signs: `setpoint/stick`."""

    suffix: ClassVar[str] = "setpoint/stick"
    pitch: float = Field(ge=-127, le=127, strict=False)
    """Nose down positive [stick]."""
    roll: float = Field(ge=-127, le=127, strict=False)
    """Right side down positive [stick]."""
    yaw: float = Field(ge=-127, le=127, strict=False)
    """Nose left positive [stick]."""
    throttle: float = Field(ge=-127, le=127, strict=False)
    """More lift positive [stick from the centre]. Stock firmware takes the smaller of this and the pilot's."""
