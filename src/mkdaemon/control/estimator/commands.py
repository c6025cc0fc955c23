"""What the aircraft was told: stick frames by the time they take effect.

A frame acts when the next receiver frame has been evaluated, so it acts `uplink` after it was written. A confirmation
says that it arrived; a frame whose confirmation should have come and did not never acted.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, replace
from typing import Final

MEMORY: Final = 2.0
"""How long a frame is remembered [s]."""


@dataclass(frozen=True, slots=True)
class Command:
    """One stick frame in the axes of the local frame.

    Attributes:
        at: when it acts [s; monotonic].
        tilt: wanted tilt, the way it accelerates, x and y of the local frame [rad].
        thrust: squared ratio of its throttle to hover throttle, less one.
        yaw_rate: wanted, counter-clockwise [rad/s].
    """

    at: float
    tilt: tuple[float, float]
    thrust: float
    yaw_rate: float


NEUTRAL: Final = Command(-math.inf, (0.0, 0.0), 0.0, 0.0)
"""Nothing asked for."""


class CommandHistory:
    """Commands in the order in which they act."""

    def __init__(self) -> None:
        self._commands: deque[Command] = deque([NEUTRAL])

    def add(self, command: Command) -> None:
        """Remember a command; one that would act before an earlier one acts just after it."""
        last = self._commands[-1].at
        self._commands.append(command if command.at >= last else replace(command, at=last))
        while len(self._commands) > 2 and self._commands[1].at < command.at - MEMORY:
            self._commands.popleft()

    def at(self, time: float) -> Command:
        """Return the command that acts at a time [s]."""
        return next((command for command in reversed(self._commands) if command.at <= time), self._commands[0])
