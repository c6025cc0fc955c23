"""What ends a flight without anybody asking: line, receiver, height control, the NaviCtrl, the battery. Pure."""

from __future__ import annotations

from typing import NamedTuple

from mkdaemon.control.admission import Concern, Situation
from mkdaemon.control.batterywatch import BatteryWatch
from mkdaemon.control.modes import IN_FLIGHT, Trigger
from mkdaemon.control.patience import LinePatience
from mkdaemon.telemetry.control import Phase


class Ending(NamedTuple):
    """A reason to end a flight.

    Attributes:
        trigger: what has happened.
        cause: in words; empty where the trigger says it all.
    """

    trigger: Trigger
    cause: str = ""


class FlightWatch:
    """Looks at the line, the pilot's receiver and the battery, at each tick.

    Attributes:
        battery: what was found out about it under the newest lease.
    """

    def __init__(self, *, one_way: float) -> None:
        """Begin with nothing known; `one_way`: patience with a board that does not hear us [s]."""
        self._patience = LinePatience(one_way=one_way)
        self.lease_taken(0)

    def lease_taken(self, openings: int) -> None:
        """Forget what an earlier flight found: the battery may be another. `openings`: of the port until now."""
        self._patience.lease_taken(openings)
        self.battery, self._has_landed = BatteryWatch(), False

    def look(self, now: Situation, flown: Concern | None) -> Ending | None:
        """Say why the flight must end; None where it goes on, and while no client holds the lease.

        A battery that stays low ends the flight once for each lease: who aborts that landing flies on.

        A FlightCtrl without its receiver lands by itself and ignores stick frames: they must not take hold again, at
        whatever tilt, when the receiver is back. Source: docs/firmware-notes, "External control".

        Args:
            now: the situation.
            flown: the manoeuvre that is flown, or would be.
        """
        link = now.link
        if link is not None:
            self._patience.watch(link, now.now)
        if not now.holder:
            return None
        if link is not None and self._patience.is_over(link, now.now, is_idle=now.phase is Phase.LEASED):
            return Ending(Trigger.LINK_LOST, f"{link.condition.value}: {link.reason}")
        if now.is_receiver_lost:
            return Ending(Trigger.RECEIVER_LOST)
        if now.phase in IN_FLIGHT and (cause := _other_control(now, flown)):
            return Ending(Trigger.CONTROL_IMPOSSIBLE, cause)
        if now.phase is Phase.UNANSWERED:
            self._has_landed = False  # the pilot flies; when he hands over again, it lands again
        elif now.phase in IN_FLIGHT:
            self.battery.look(now)
            if self.battery.warning is not None and self.battery.has_lasted and not self._has_landed:
                self._has_landed = True
                return Ending(Trigger.BATTERY_LOW, self.battery.warning.reason)
        return None


def _other_control(now: Situation, flown: Concern | None) -> str:
    """What the boards do with the sticks besides; empty for nothing, and where they do not say."""
    if now.flight is None:
        return ""
    if now.flight.altitude_control:
        return "height control is on, so the throttle is a climb rate"
    if flown is not None and flown.is_by_target and now.flight.gps_mode.steers:
        return f"the pilot's GPS switch is at {now.flight.gps_mode.value}, so the NaviCtrl steers too"
    return ""
