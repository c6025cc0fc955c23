"""How long the path to a client is: a number that the daemon gives away comes back with the request for the lease."""

from __future__ import annotations

import time
from collections import OrderedDict
from collections.abc import Callable
from secrets import token_hex
from typing import Final

from mkdaemon.telemetry.refusals import Token, refuse

WAITING: Final = 64
"""Echoes that may be under way; of more, the oldest are forgotten."""


class PathProbe:
    """Measures the way to a client and back, by the daemon's own clock.

    Every time of the ladder in docs/safety.md counts from a setpoint's arrival; who sent it sees all of them later by
    this delay.
    """

    def __init__(self, limit: float = 0.5, clock: Callable[[], float] = time.monotonic) -> None:
        """Measure.

        Args:
            limit: longest way there and back [s].
            clock: [s].
        """
        self._limit, self._clock = limit, clock
        self._sent: OrderedDict[str, float] = OrderedDict()

    def new_echo(self) -> str:
        """A number to be sent back; the time runs from now on."""
        echo = token_hex(8)
        self._sent[echo] = self._clock()
        while len(self._sent) > WAITING:
            self._sent.popitem(last=False)
        return echo

    def check(self, echo: str) -> None:
        """Make sure that an echo came back in time; it counts once.

        Args:
            echo: what came back; empty from a client that did not ask for one, which is not measured.

        Raises:
            CommandRejectedError: `slow_path`.
        """
        if not echo:
            return
        sent = self._sent.pop(echo, None)
        delay = float("inf") if sent is None else self._clock() - sent
        if delay > self._limit:
            took = "is unknown" if sent is None else f"takes {delay:.2f} s"
            raise refuse(Token.SLOW_PATH, took=took, limit=self._limit)
