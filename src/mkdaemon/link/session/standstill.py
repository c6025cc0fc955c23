"""Time in which this program did not run: a stopped process, a busy machine, a machine that slept."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from mkdaemon.clock import Clock, SleepWatch

NOTICED: Final = 0.25
"""A shorter standstill explains nothing on the line [s]; the loop looks every 0.05 s."""


@dataclass(frozen=True, slots=True)
class Standstill:
    """What was missed.

    Attributes:
        stopped: time that passed on the monotonic clock [s].
        slept: time that it did not count [s].
    """

    stopped: float
    slept: float


class StandstillWatch:
    """Tells how long nothing ran."""

    def __init__(self, clock: Clock) -> None:
        self._sleep = SleepWatch(clock)
        self._seen_at = clock.now()

    def begin(self, now: float) -> None:
        """Begin to look; what was before does not count."""
        self._seen_at = now
        self._sleep.take()

    def take(self, now: float) -> Standstill | None:
        """Return how long nothing ran until now [s]; None where that is nothing to speak of."""
        stopped, self._seen_at = now - self._seen_at, now
        slept = self._sleep.take()
        return Standstill(stopped, slept) if max(stopped, slept) > NOTICED else None
