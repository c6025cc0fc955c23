"""One row for every kind of setpoint: the manoeuvre it begins. To add a manoeuvre, add its file and its row."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any, Final, NamedTuple

from mkdaemon.config.control import ControlConfig
from mkdaemon.control.manoeuvres.attitude import AttitudeFlight
from mkdaemon.control.manoeuvres.goto import Goto
from mkdaemon.control.manoeuvres.hold import Hold
from mkdaemon.control.manoeuvres.land import Land
from mkdaemon.control.manoeuvres.manoeuvre import Manoeuvre
from mkdaemon.control.manoeuvres.stick import Stick
from mkdaemon.control.manoeuvres.take_off import TakeOffFlight
from mkdaemon.control.manoeuvres.velocity import Velocity
from mkdaemon.control.sight import Sight
from mkdaemon.telemetry.setpoint import (
    AttitudeSetpoint,
    HoldSetpoint,
    LandSetpoint,
    PositionSetpoint,
    Setpoint,
    StickSetpoint,
    TakeOffSetpoint,
    VelocitySetpoint,
)


class Row(NamedTuple):
    """One manoeuvre.

    Attributes:
        make: makes it for a setpoint.
    """

    make: Callable[[Sight, ControlConfig, Any], Manoeuvre]


MANOEUVRES: Final[Mapping[type[Setpoint], Row]] = MappingProxyType(
    {
        StickSetpoint: Row(lambda sight, cfg, new: Stick(sight, cfg.autopilot, new, cfg.lease.neutral_band)),
        AttitudeSetpoint: Row(
            lambda sight, cfg, new: AttitudeFlight(sight, cfg.autopilot, new, cfg.autopilot.neutral_band)
        ),
        VelocitySetpoint: Row(lambda sight, cfg, new: Velocity(sight, cfg.autopilot, new)),
        PositionSetpoint: Row(lambda sight, cfg, new: Goto(sight, cfg.autopilot, new)),
        HoldSetpoint: Row(lambda sight, cfg, new: Hold(sight, cfg.autopilot)),
        TakeOffSetpoint: Row(lambda sight, cfg, new: TakeOffFlight(sight, cfg.autopilot, new)),
        LandSetpoint: Row(lambda sight, cfg, new: Land(sight, cfg.autopilot, new.yaw)),
    }
)
"""Every manoeuvre, by the setpoints that are streamed for it."""
