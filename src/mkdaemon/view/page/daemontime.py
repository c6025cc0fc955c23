"""What time it is for a daemon that is seen through its values: live, or played at any speed and paused.

Stamps are of the daemon's clock, which no other machine has. The newest stamp is a lower bound of the time there;
between two values time advances at the speed of playback. So every machine shows the age that a value has there.
"""

from __future__ import annotations

from typing import Final

WINDOW: Final = 1.0
"""The estimate uses the stamps of this interval [s]: clocks of two machines drift, and a player can be paused."""


class DaemonTime:
    """Estimates the daemon's monotonic clock."""

    def __init__(self) -> None:
        """Know nothing yet."""
        self._speed = 1.0
        self._anchor: tuple[float, float] | None = None
        self._best: tuple[float, float] | None = None
        self._since = 0.0

    def take(self, at_least: float, now: float) -> None:
        """Take a value's time.

        Args:
            at_least: its stamp, with its age where that is known [s; the daemon's monotonic].
            now: our own time [s].
        """
        believed = self.now(now)
        if believed is None or at_least >= believed:
            self._begin(at_least, now)
            return
        if self._best is None or at_least >= self._best[0] + (now - self._best[1]) * self._speed:
            self._best = (at_least, now)
        if now - self._since >= WINDOW:
            value, at = self._best
            self._begin(value + (now - at) * self._speed, now)

    def now(self, now: float) -> float | None:
        """The daemon's time at ours [s]; None before the first value."""
        if self._anchor is None:
            return None
        value, at = self._anchor
        return value + (now - at) * self._speed

    def play_at(self, speed: float, now: float) -> None:
        """Go on at another speed: seconds of the daemon a second of ours; 0 while it is paused."""
        if speed != self._speed:
            believed = self.now(now)
            if believed is not None:
                self._begin(believed, now)
            self._speed = speed

    def restart(self) -> None:
        """Forget: another boot, or a recording that is played again."""
        self._anchor = self._best = None

    def _begin(self, value: float, now: float) -> None:
        self._anchor, self._best, self._since = (value, now), None, now
