"""Stick frames on their way: what acts at a moment, as far as it is known which frames arrive."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, replace
from typing import Final

KNOWN: Final = 2.0
"""How long a stick frame is remembered [s]."""
SAME: Final = 1e-6
"""Moments closer together are one [s]."""


@dataclass(frozen=True, slots=True)
class StickFrame:
    """One stick frame in the axes of the local frame.

    Attributes:
        at: when it acts [s; monotonic].
        tilt: wanted tilt, the way it accelerates, x and y of the local frame [rad].
        thrust: squared ratio of its throttle to hover throttle, less one.
    """

    at: float
    tilt: tuple[float, float]
    thrust: float


NEUTRAL: Final = StickFrame(-math.inf, (0.0, 0.0), 0.0)
"""Nothing asked for."""


class CommandHistory:
    """Stick frames in the order in which they act, `uplink` after they were written: with the next receiver frame."""

    def __init__(self) -> None:
        self._commands: deque[StickFrame] = deque([NEUTRAL])

    def add(self, command: StickFrame) -> None:
        """Remember a command; one that would act before an earlier one acts just after it."""
        last = self._commands[-1].at
        self._commands.append(command if command.at >= last else replace(command, at=last))
        while len(self._commands) > 2 and self._commands[1].at < command.at - KNOWN:
            self._commands.popleft()

    def insert(self, command: StickFrame) -> None:
        """Put a command before those that act later."""
        later = [self._commands.pop() for each in tuple(self._commands) if each.at > command.at]
        self.add(command)
        self._commands.extend(reversed(later))

    def forget_after(self, time: float) -> None:
        """Forget what would begin to act after a time [s]."""
        while len(self._commands) > 1 and self._commands[-1].at > time + SAME:
            self._commands.pop()

    def at(self, time: float) -> StickFrame:
        """Return the command that acts at a time [s]."""
        return next((command for command in reversed(self._commands) if command.at <= time), self._commands[0])
