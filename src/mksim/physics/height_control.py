"""The FlightCtrl's height control: while it is on, gas is a climb-rate stick, not a thrust.

It holds the barometric height inside a dead band around the hover stick and climbs outside of it.
"""

from __future__ import annotations

from typing import Final

DEAD_BAND: Final = 12.0
"""Gas counts around the hover stick that hold the height [count]."""
CLIMB_PER_COUNT: Final = 0.03
"""Climb rate per count beyond the dead band [m/s]."""
MAX_CLIMB: Final = 2.0
"""Fastest climb or descent [m/s]."""
_HEIGHT_GAIN: Final = 0.8
_SPEED_GAIN: Final = 22.0
_SPEED_INTEGRAL: Final = 8.0
_LEAST_SHARE: Final = 0.6
"""Never below this share of hover gas: attitude authority goes with gas."""
_MOST_SHARE: Final = 1.5


class HeightControl:
    """Barometer and variometer to collective count."""

    __slots__ = ("_height", "_hover", "_trim", "is_on")

    def __init__(self, hover_count: float) -> None:
        self._hover = hover_count
        self._trim = 0.0
        self._height = 0.0
        self.is_on = False

    def switch_off(self) -> None:
        """Hand the gas back to the stick."""
        self.is_on = False

    def update(self, gas: float, height: float, climb: float, dt: float) -> float:
        """Return the collective [count].

        Args:
            gas: stick [count].
            height: barometric [m].
            climb: variometer [m/s].
            dt: [s].
        """
        if not self.is_on:
            self.is_on, self._height, self._trim = True, height, 0.0
        offset = gas - self._hover
        if abs(offset) > DEAD_BAND:
            beyond = offset - DEAD_BAND if offset > 0 else offset + DEAD_BAND
            wanted = max(-MAX_CLIMB, min(MAX_CLIMB, beyond * CLIMB_PER_COUNT))
            self._height = height
        else:
            wanted = max(-MAX_CLIMB, min(MAX_CLIMB, _HEIGHT_GAIN * (self._height - height)))
        error = wanted - climb
        self._trim = max(-0.3 * self._hover, min(0.3 * self._hover, self._trim + _SPEED_INTEGRAL * error * dt))
        count = self._hover + self._trim + _SPEED_GAIN * error
        return max(_LEAST_SHARE * self._hover, min(_MOST_SHARE * self._hover, count))
