"""One row for every kind of setpoint: the manoeuvre it begins. To add a manoeuvre, add its file and its row."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any, Final

from mkdaemon.config.control import ControlConfig
from mkdaemon.control.manoeuvres.attitude import AttitudeFlight
from mkdaemon.control.manoeuvres.goto import Goto
from mkdaemon.control.manoeuvres.hold import Hold
from mkdaemon.control.manoeuvres.land import Land
from mkdaemon.control.manoeuvres.manoeuvre import Manoeuvre
from mkdaemon.control.manoeuvres.pathflight import FollowPath
from mkdaemon.control.manoeuvres.stick import Stick
from mkdaemon.control.manoeuvres.take_off import TakeOffFlight
from mkdaemon.control.manoeuvres.velocity import FlyVelocity
from mkdaemon.control.sight import Sight
from mkdaemon.telemetry.setpoint import (
    AttitudeSetpoint,
    HoldSetpoint,
    LandSetpoint,
    PathSetpoint,
    PositionSetpoint,
    Setpoint,
    StickSetpoint,
    TakeOffSetpoint,
    VelocitySetpoint,
)

Make = Callable[[Sight, ControlConfig, Any], Manoeuvre]
"""Makes a manoeuvre for a setpoint."""
MANOEUVRES: Final[Mapping[type[Setpoint], Make]] = MappingProxyType(
    {
        StickSetpoint: lambda sight, cfg, new: Stick(sight, cfg.autopilot, new, cfg.lease.neutral_band),
        AttitudeSetpoint: lambda sight, cfg, new: AttitudeFlight(sight, cfg.autopilot, new, cfg.autopilot.neutral_band),
        VelocitySetpoint: lambda sight, cfg, new: FlyVelocity(sight, cfg.autopilot, new),
        PositionSetpoint: lambda sight, cfg, new: Goto(sight, cfg.autopilot, new),
        HoldSetpoint: lambda sight, cfg, new: Hold(sight, cfg.autopilot),
        TakeOffSetpoint: lambda sight, cfg, new: TakeOffFlight(sight, cfg.autopilot, new),
        LandSetpoint: lambda sight, cfg, new: Land(sight, cfg.autopilot, new.yaw),
        PathSetpoint: lambda sight, cfg, new: FollowPath(sight, cfg.autopilot, new),
    }
)
"""Every manoeuvre, by the setpoints that are streamed for it."""
