"""From a setpoint to the sticks it asks for: one guidance function for each kind of setpoint."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Final

from mkdaemon.control.limiter import Sticks
from mkdaemon.control.vehicle import VehicleFacts
from mkdaemon.telemetry.refusals import Token, refuse
from mkdaemon.telemetry.setpoint import Setpoint, StickSetpoint

Guidance = Callable[[Setpoint, VehicleFacts, float], Sticks]
"""Turns a setpoint into sticks before the limiter [stick; FLU], from what is known about the vehicle, at a time [s]."""


def follow_sticks(setpoint: Setpoint, facts: VehicleFacts, now: float) -> Sticks:
    """Return the sticks of a stick setpoint as they are."""
    assert isinstance(setpoint, StickSetpoint)
    return Sticks(setpoint.pitch, setpoint.roll, setpoint.yaw, setpoint.throttle)


GUIDANCE: Final[Mapping[type[Setpoint], Guidance]] = MappingProxyType({StickSetpoint: follow_sticks})
"""Guidance by kind of setpoint; a kind that is missing here is refused."""


def guidance_for(setpoint: Setpoint, known: Mapping[type[Setpoint], Guidance]) -> Guidance:
    """Return the guidance of a setpoint.

    Args:
        setpoint: of any kind.
        known: guidance by kind.

    Raises:
        CommandRejectedError: `no_guidance`: nothing turns this kind into sticks.
    """
    guidance = known.get(type(setpoint))
    if guidance is None:
        raise refuse(Token.NO_GUIDANCE, name=setpoint.suffix, known=", ".join(sorted(kind.suffix for kind in known)))
    return guidance
