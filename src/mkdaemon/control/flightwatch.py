"""What ends a flight without anybody asking: line, receiver, height control, the NaviCtrl, the battery. Pure."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from mkdaemon.control.activeset import ActiveSet
from mkdaemon.control.authority import Authority
from mkdaemon.control.batterywatch import BatteryWatch
from mkdaemon.control.modes import IN_FLIGHT, Trigger
from mkdaemon.control.patience import LinePatience
from mkdaemon.control.vehicle import VehicleFacts
from mkdaemon.telemetry.control import Phase
from mkdaemon.telemetry.setpoint import AttitudeSetpoint, StickSetpoint

BY_HAND: Final = frozenset({StickSetpoint.suffix, AttitudeSetpoint.suffix})
"""Setpoints that hold no place: a NaviCtrl that holds one does not work against them."""


class FlightWatch:
    """Looks at the line, the pilot's receiver and the battery, at each tick.

    Attributes:
        battery: what was found out about it under the newest lease.
    """

    def __init__(
        self, authority: Authority, facts: VehicleFacts, patience: LinePatience, can_land: Callable[[float], bool]
    ) -> None:
        """Watch for the holder of the lease of `authority`; `can_land`: is a target in sight at a time [s]."""
        self._authority, self._facts, self._patience, self._can_land = authority, facts, patience, can_land
        self.battery = BatteryWatch(facts)
        self._epoch, self._has_landed = -1, False

    def look(self, found: ActiveSet, now: float) -> None:
        """End the lease where the line or the receiver says so; the next tick releases the aircraft.

        A battery that stays low ends the flight once for each lease: who aborts that landing flies on.

        A FlightCtrl without its receiver lands by itself and ignores stick frames: they must not take hold again, at
        whatever tilt, when the receiver is back. Source: docs/firmware-notes, "External control".
        """
        link = self._facts.link
        if link is not None:
            self._patience.watch(link, now)
        lease = self._authority.lease(now)
        if lease is None:
            return
        if lease.epoch != self._epoch:
            # What an earlier flight found must not end this one: the battery may be another.
            self._epoch, self._has_landed, self.battery = lease.epoch, False, BatteryWatch(self._facts)
        is_idle = self._authority.phase is Phase.LEASED
        if link is not None and self._patience.is_over(link, now, is_idle=is_idle):
            self._authority.end(Trigger.LINK_LOST, cause=f"{link.condition.value}: {link.reason}")
        elif self._facts.is_receiver_lost(now):
            self._authority.end(Trigger.RECEIVER_LOST)
        elif self._authority.phase in IN_FLIGHT and (cause := self._other_control(now)):
            self._authority.end(Trigger.CONTROL_IMPOSSIBLE, cause=cause)
        elif self._authority.phase is Phase.UNANSWERED:
            self._has_landed = False  # the pilot flies; when he hands over again, it lands again
        elif self._authority.phase in IN_FLIGHT:
            self.battery.look(found, now)
            if self.battery.warning is not None and self.battery.has_lasted and not self._has_landed:
                self._has_landed = True
                self._authority.battery_low(self.battery.warning.reason, can_land=self._can_land(now))

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
