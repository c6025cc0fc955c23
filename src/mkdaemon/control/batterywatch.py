"""Notices in flight that the battery is low: by the board's own alarm, or by the voltage of the active set. Pure.

A battery sags while the motors work hard, so only what lasts counts, and a little more voltage is not yet the end of
it. Source: docs/safety.md, "What ends a flight".
"""

from __future__ import annotations

from typing import Final

from mkdaemon.control.admission.situation import Situation
from mkdaemon.errors import CommandRejectedError
from mkdaemon.telemetry.refusals import Token, refuse

LASTING: Final = 3.0
"""A battery that is low for this long is not only sagging under load [s]."""
RECOVERED: Final = 1.02
"""It is no longer low above so many times the limit."""


class BatteryWatch:
    """Looks at the battery of an aircraft that flies.

    Attributes:
        warning: why it is low, and what to do; None while it is not.
        has_lasted: it has been low for so long that the flight must end.
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
