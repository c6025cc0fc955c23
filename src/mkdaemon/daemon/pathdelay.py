"""Delay of the path to a client: a number from the daemon comes back with the request for the lease."""

from __future__ import annotations

import math
import time
from collections import OrderedDict
from collections.abc import Callable
from secrets import token_hex
from typing import Final

WAITING: Final = 64
"""Echoes that may be under way; of more, the oldest are forgotten."""


class PathProbe:
    """Measures the way to a client and back, by the daemon's own clock; admission says how long it may be."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        """Measure by a clock [s]."""
        self._clock = clock
        self._sent: OrderedDict[str, float] = OrderedDict()

    def new_echo(self) -> str:
        """A number to be sent back; the time runs from now on."""
        echo = token_hex(8)
        self._sent[echo] = self._clock()
        while len(self._sent) > WAITING:
            self._sent.popitem(last=False)
        return echo

    def delay(self, echo: str) -> float | None:
        """Time between an echo's way out and its coming back [s]; it counts once.

        Args:
            echo: what came back; empty from a client that did not ask for one.

        Returns:
            Infinite for an echo that is not known, or no more; None where nothing is measured.
        """
        if not echo:
            return None
        sent = self._sent.pop(echo, None)
        return math.inf if sent is None else self._clock() - sent
