"""Notices in flight that the battery is low: by the board's own alarm, or by the voltage of the active set. Pure.

A battery sags while the motors work hard, so only what lasts counts, and a little more voltage is not yet the end of
it. Source: docs/safety.md, "What happens when something fails".
"""

from __future__ import annotations

from typing import Final

from mkdaemon.control.activeset import ActiveSet
from mkdaemon.control.vehicle import VehicleFacts
from mkdaemon.errors import CommandRejectedError
from mkdaemon.telemetry.refusals import Token, refuse

LASTING: Final = 3.0
"""A battery that is low for this long is not only sagging under load [s]."""
RECOVERED: Final = 1.02
"""It is no longer low above so many times the limit."""


def low_voltage(found: ActiveSet, cells: int | None) -> float:
    """Return the voltage below which a battery is low [V]; zero where the active set does not say.

    Args:
        found: the active set; gives the voltage of a cell.
        cells: of the battery; None where it has not been measured.
    """
    return 0.0 if found.low_cell is None else found.low_cell * (cells or 1)


class BatteryWatch:
    """Looks at the battery of an aircraft that flies.

    Attributes:
        warning: why it is low, and what to do; None while it is not.
        has_lasted: it has been low for so long that the flight must end.
    """

    def __init__(self, facts: VehicleFacts) -> None:
        self._facts = facts
        self._low_since: float | None = None
        self.warning: CommandRejectedError | None = None
        self.has_lasted = False

    def look(self, found: ActiveSet, now: float) -> None:
        """Look at the newest report; without one nothing changes.

        Args:
            found: the active set.
            now: [s].
        """
        battery, flight = self._facts.battery(now), self._facts.flight(now)
        if battery is None:
            return
        limit = low_voltage(found, self._facts.cells)
        has_alarm = bool(battery.is_low) or (flight is not None and bool(flight.battery_low))
        if has_alarm or battery.voltage < limit:
            self._low_since = now if self._low_since is None else self._low_since
            self.warning = refuse(Token.BATTERY_LOW, voltage=battery.voltage)
            self.has_lasted = now - self._low_since >= LASTING
        elif battery.voltage >= RECOVERED * limit:
            self._low_since = self.warning = None
            self.has_lasted = False
