"""The pace of a played recording: speed, pause, single steps. Pure; driven with `now`."""

from __future__ import annotations

from typing import Final

SLOWEST: Final = 1 / 64
FASTEST: Final = 1024.0


class Pace:
    """Turns times of a recording into times at which they are played.

    Attributes:
        speed: seconds of the recording a second.
        is_paused: whether time stands still, but for steps.
    """

    def __init__(self, speed: float, began_at: float, now: float, *, is_paused: bool = False) -> None:
        """Begin.

        Args:
            speed: seconds of the recording a second.
            began_at: first time of the recording [s].
            now: [s].
            is_paused: begin with time that stands still.
        """
        self.speed = speed
        self.is_paused = is_paused
        self._place, self._since = began_at, now
        self._steps = 0

    def place(self, now: float) -> float:
        """Where in the recording it is [s]."""
        return self._place if self.is_paused else self._place + (now - self._since) * self.speed

    def wait(self, at: float, now: float) -> float | None:
        """Time until a value of the recording is due [s], at most 0 when it is; None while paused.

        Args:
            at: its time in the recording [s].
            now: [s].
        """
        if not self.is_paused:
            return (at - self.place(now)) / self.speed
        if self._steps == 0:
            return None
        self._steps -= 1
        self._place = max(self._place, at)
        return 0.0

    def toggle(self, now: float) -> None:
        """Pause, or go on."""
        self._hold(now)
        self.is_paused = not self.is_paused
        self._steps = 0

    def step(self, now: float) -> None:
        """Play one value and pause."""
        self._hold(now)
        self.is_paused = True
        self._steps += 1

    def change_speed(self, factor: float, now: float) -> None:
        """Play faster or slower from now on."""
        self._hold(now)
        self.speed = min(max(self.speed * factor, SLOWEST), FASTEST)

    def restart(self, began_at: float, now: float) -> None:
        """Go on at another time of the recording [s]."""
        self._place, self._since = began_at, now

    def _hold(self, now: float) -> None:
        self._place, self._since = self.place(now), now
