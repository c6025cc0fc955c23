"""When the flight core ticks: at once after news, in time to repeat a setpoint, just after a deadline."""

from __future__ import annotations

from typing import Final

from mkdaemon.config.control import ControlConfig
from mkdaemon.control.output import SHORTEST_STEP

JUST_AFTER: Final = 0.0002
"""A deadline has surely passed so long after it [s]."""
IDLE_PERIOD: Final = 0.1
"""Time between two looks at the lease while nobody flies [s]."""


class Pacing:
    """The times of the ticks.

    Attributes:
        is_due: something happened that the next tick must judge.
        is_paced: stick frames are being sent, so no tick comes sooner than the boards can take the next one.
    """

    def __init__(self, cfg: ControlConfig) -> None:
        self._cfg = cfg
        self._ticked_at = float("-inf")
        self.is_paced = False
        self.is_due = True

    def tick(self, now: float) -> float:
        """Note a tick; returns the time since the one before [s]."""
        stood_still = now - self._ticked_at
        self._ticked_at, self.is_due = now, False
        return stood_still

    def next_time(self, deadline: float | None, next_step: float) -> float:
        """When to tick again [s].

        A repetition so shortly before a deadline that what follows would have to wait for the boards is left out.

        Args:
            deadline: when silence changes what is sent [s]; None for never.
            next_step: when the boards can take the next stick frame [s].
        """
        until = self._ticked_at
        if not self.is_due:
            # A repetition waits half a period longer than a client should, or it would delay the next setpoint.
            until += 1.5 / self._cfg.rate if self.is_paced else IDLE_PERIOD
            if deadline is not None and until > deadline - SHORTEST_STEP:
                until = deadline + JUST_AFTER
        return max(until, next_step) if self.is_paced else until
