"""What ends a flight without a request: line, receiver, height control, the NaviCtrl, the battery. Pure.

A battery sags while the motors work hard, so only what lasts counts, and a little more voltage is not yet the end of
it. Source: docs/safety.md, "What ends a flight".
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

from mkdaemon.control.admission.beginnings import Concern
from mkdaemon.control.admission.situation import Situation
from mkdaemon.control.modes import IN_FLIGHT, Trigger
from mkdaemon.errors import CommandRejectedError
from mkdaemon.telemetry.control import Phase
from mkdaemon.telemetry.link import LinkState
from mkdaemon.telemetry.refusals import Token, refuse

SILENCE: Final = 0.65
"""How long a client keeps its lease on a line on which nothing arrives [s]. Silence is reported after 0.35 s: the lease
ends one second after the last frame, as it does on a line that does not hear us. A radio that loses 15 % each way in
bursts is silent for half a second in every fifth flight, and a release does not get through before it is heard again.
"""
IDLE: Final = 2.0
"""The same while the lease sends nothing, for a line that has a port [s]. Without stick frames only link tests prove
the line, and a radio that loses 15 % each way loses five of them in a row now and then. A board that restarts is silent
for 4.7 s: docs/firmware-notes, "Timing"."""
LASTING: Final = 3.0
"""A battery that is low for this long is not only sagging under load [s]."""
RECOVERED: Final = 1.02
"""Above the limit times this it is low no longer."""


class LinePatience:
    """Watches the line for the holder of the lease.

    The lease ends if the board is gone, and if the port was reopened, because the board's state is lost. It also ends
    if the board does not receive us: the board drops external control, and must not obey again without warning.
    """

    def __init__(self, *, one_way: float) -> None:
        """Start with a good line.

        Args:
            one_way: patience with a board that does not hear us [s].
        """
        self._one_way = one_way
        self._unusable_since = self._silent_since = math.inf
        self._openings = 0

    def lease_taken(self, openings: int) -> None:
        """Note which opening of the port a new lease stands on."""
        self._openings = openings

    def watch(self, link: LinkState, now: float) -> None:
        """Note since when the line is unusable, and since when it is silent; a silent board counts as not receiving."""
        self._unusable_since = math.inf if link.condition.is_usable else min(self._unusable_since, now)
        self._silent_since = math.inf if link.condition.hears_board else min(self._silent_since, now)

    def is_over(self, link: LinkState, now: float, *, is_idle: bool = False) -> bool:
        """Whether the lease must end because of the line; `is_idle`: it sends nothing."""
        has_port = link.condition.hears_board or link.condition.is_silent
        if link.openings != self._openings or not has_port:
            return True
        one_way, silence = (IDLE, IDLE) if is_idle else (self._one_way, SILENCE)
        return now - self._unusable_since >= one_way or now - self._silent_since >= silence


class BatteryWatch:
    """Looks at the battery of an aircraft that flies.

    Attributes:
        warning: why it is low, and what to do; None while it is not.
        has_lasted: it has been low for the time after which the flight must end.
    """

    def __init__(self) -> None:
        self._low_since: float | None = None
        self.warning: CommandRejectedError | None = None
        self.has_lasted = False

    def look(self, now: Situation) -> None:
        """Look at the newest report; without one nothing changes."""
        battery, flight = now.battery, now.flight
        if battery is None:
            return
        limit = now.active_set.low_voltage(now.cells)
        has_alarm = bool(battery.is_low) or (flight is not None and bool(flight.battery_low))
        if has_alarm or battery.voltage < limit:
            self._low_since = now.now if self._low_since is None else self._low_since
            self.warning = refuse(Token.BATTERY_LOW, voltage=battery.voltage)
            self.has_lasted = now.now - self._low_since >= LASTING
        elif battery.voltage >= RECOVERED * limit:
            self._low_since = self.warning = None
            self.has_lasted = False


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
