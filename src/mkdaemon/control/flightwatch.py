"""What ends a lease without anybody asking: line, receiver, height control, the NaviCtrl's position control. Pure."""

from __future__ import annotations

from typing import Final

from mkdaemon.control.authority import Authority
from mkdaemon.control.modes import IN_FLIGHT, Event
from mkdaemon.control.patience import LinePatience
from mkdaemon.control.vehicle import VehicleFacts
from mkdaemon.telemetry.setpoint import AttitudeSetpoint, StickSetpoint

BY_HAND: Final = frozenset({StickSetpoint.suffix, AttitudeSetpoint.suffix})
"""Setpoints that hold no place: a NaviCtrl that holds one does not work against them."""


class FlightWatch:
    """Looks at the line and at the pilot's receiver, at each tick."""

    def __init__(self, authority: Authority, facts: VehicleFacts, patience: LinePatience) -> None:
        """Watch for the holder of the lease of `authority`."""
        self._authority, self._facts, self._patience = authority, facts, patience

    def look(self, now: float) -> None:
        """End the lease where the line or the receiver says so; the next tick releases the aircraft.

        A FlightCtrl without its receiver lands by itself and ignores stick frames: they must not take hold again, at
        whatever tilt, when the receiver is back. Source: docs/firmware-notes, "External control".
        """
        link = self._facts.link
        if link is not None:
            self._patience.watch(link, now)
        if self._authority.lease(now) is None:
            return
        if link is not None and self._patience.is_over(link, now):
            self._authority.end(Event.LINK_LOST, cause=f"{link.condition.value}: {link.reason}")
        elif self._facts.is_receiver_lost(now):
            self._authority.end(Event.RECEIVER_LOST)
        elif self._authority.phase in IN_FLIGHT and (cause := self._other_control(now)):
            self._authority.end(Event.CONTROL_IMPOSSIBLE, cause=cause)

    def _other_control(self, now: float) -> str:
        """What the boards do with the sticks besides; empty for nothing, and where nobody says so."""
        flight, progress = self._facts.flight(now), self._authority.progress
        if flight is None:
            return ""
        if flight.altitude_control:
            return "height control is on, so the throttle is a climb rate"
        holds_place = progress is not None and f"setpoint/{progress.manoeuvre}" not in BY_HAND
        if holds_place and flight.gps_mode.steers:
            return f"the pilot's GPS switch is at {flight.gps_mode.value}, so the NaviCtrl steers too"
        return ""
