"""Virtual time as a busy machine has it: timers fire late and work takes time, by a seed."""

from __future__ import annotations

import random
from collections.abc import Coroutine
from typing import Any, Final, TypeVar

from mkdaemon.virtualtime import VirtualLoop, end_loop

WORK: Final = 2e-6
"""Time that passes from one look at the clock to the next [s]."""
LATE: Final = 4e-4
"""Mean time by which timers fire late [s]."""
STALL: Final = 0.015
"""Longest of the rare pauses, one wake-up in three hundred [s]."""

_Result = TypeVar("_Result")


class TardyLoop(VirtualLoop):
    """An event loop in virtual time that is never on time."""

    def __init__(self, seed: int, start: float = 0.0) -> None:
        """Begin.

        Args:
            start: time of the beginning [s].
        """
        super().__init__(start=start)
        self._random = random.Random(f"{seed} tardy")
        self._passed = 0.0
        self._seen = start

    def time(self) -> float:
        """Virtual time, a little later with every look [s], in the nanoseconds of a clock."""
        reached = super().time()
        if reached != self._seen:
            self._seen = reached
            self._passed += self._random.expovariate(1 / LATE)
            if self._random.random() < 1 / 300:
                self._passed += self._random.uniform(0.0, STALL)
        self._passed += WORK
        return round(reached + self._passed, 9)


def run_tardily(main: Coroutine[Any, Any, _Result], seed: int, start: float = 0.0) -> _Result:
    """Run a coroutine to its end on a loop that is never on time."""
    loop = TardyLoop(seed, start)
    try:
        return loop.run_until_complete(main)
    finally:
        end_loop(loop)
