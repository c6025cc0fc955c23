"""From a setpoint to the sticks it asks for: one guidance for each kind of setpoint."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Protocol

from mkdaemon.control.limiter import Sticks
from mkdaemon.control.vehicle import VehicleFacts
from mkdaemon.telemetry.refusals import Token, refuse
from mkdaemon.telemetry.setpoint import SETPOINTS, LandSetpoint, Setpoint, StickSetpoint


@dataclass(frozen=True, slots=True)
class Guided:
    """What a setpoint asks for now.

    Attributes:
        sticks: before the limiter [stick; FLU].
        obstacle: what must change before a flight may begin with it; empty for nothing.
        failure: why a flight cannot go on with it; empty while it can.
        finished: why the flight has reached its end; empty before.
        stage: where a manoeuvre stands, in words; empty for a setpoint that has no stages.
        is_done: what was asked for is reached; it is held from now on.
    """

    sticks: Sticks
    obstacle: str = ""
    failure: str = ""
    finished: str = ""
    stage: str = ""
    is_done: bool = False


class Guidance(Protocol):
    """Turns setpoints of its kinds into sticks."""

    def check(self, setpoint: Setpoint) -> None:
        """Refuse a setpoint that cannot be followed at all, before it touches the lease's stream.

        Raises:
            CommandRejectedError: says what is missing.
        """

    def guide(self, setpoint: Setpoint, facts: VehicleFacts, now: float, *, is_flying: bool) -> Guided:
        """Return what the setpoint asks for at a time [s]; `is_flying`: its sticks are being sent."""


class StickGuidance:
    """Sticks are what they are; a flight begins with neutral ones."""

    def __init__(self, neutral_band: float) -> None:
        """Take sticks within `neutral_band` [stick] for neutral."""
        self._band = neutral_band

    def check(self, setpoint: Setpoint) -> None:
        """Refuse nothing."""

    def guide(self, setpoint: Setpoint, facts: VehicleFacts, now: float, *, is_flying: bool) -> Guided:
        """Return the sticks as they are."""
        assert isinstance(setpoint, StickSetpoint)
        is_neutral = max(abs(setpoint.pitch), abs(setpoint.roll), abs(setpoint.yaw)) <= self._band
        sticks = Sticks(setpoint.pitch, setpoint.roll, setpoint.yaw, setpoint.throttle)
        return Guided(sticks, "" if is_neutral else "neutral sticks")


def stick_guidance(neutral_band: float) -> Mapping[type[Setpoint], Guidance]:
    """Return guidance for sticks alone; a kind that is missing is refused."""
    return MappingProxyType({StickSetpoint: StickGuidance(neutral_band)})


def guidance(target: Guidance, neutral_band: float) -> Mapping[type[Setpoint], Guidance]:
    """Return guidance for every kind of setpoint: sticks as they are, all others against a target."""
    return {kind: StickGuidance(neutral_band) if kind is StickSetpoint else target for kind in SETPOINTS}


def landing_of(setpoint: Setpoint) -> LandSetpoint:
    """The landing that takes the place of a setpoint."""
    return LandSetpoint(epoch=setpoint.epoch, sequence=setpoint.sequence, ttl=setpoint.ttl)


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
