"""Link tests: which frame proves the line cheapest, and when the next one is due. Pure; driven with `now`.

A NaviCtrl echoes a pattern (`z`). A FlightCtrl has no link test; asking for its version is the cheapest question every
release answers (6 characters there, 22 back, 7 ms).
"""

from __future__ import annotations

import math
from typing import Final, Literal

from mkdaemon.link.session.health import PROBE_PATIENCE, HealthMonitor
from mkdaemon.link.session.scheduler import QueuedTransmission
from mkdaemon.link.session.traffic import Purpose
from mkdaemon.protocol.messages.linktest import EchoRequest
from mkdaemon.protocol.messages.version import VersionRequest
from mkdaemon.protocol.wire import Board, WireMessage

AUTO: Final = 0.2
"""With `auto`: how old the latest proof of both directions may become before a link test is sent [s]."""
_DEADLINE: Final = 0.5
"""A link test that had no turn for this long is dropped; the next one says the same [s]."""


class Prober:
    """Sends link tests at the configured rate, or `auto`: only where nothing else has just proven the line."""

    def __init__(self, rate: float | Literal["auto"], health: HealthMonitor) -> None:
        self._rate = rate
        self._health = health
        self._pattern = 0
        self._waiting = False
        self._sent_at = -math.inf

    @property
    def highest_rate(self) -> float:
        """Link tests a second to plan the line for [Hz]."""
        return 1 / AUTO if self._rate == "auto" else self._rate

    def restart(self) -> None:
        """A port was opened: nothing is under way."""
        self._waiting = False
        self._sent_at = -math.inf

    def next_time(self) -> float:
        """When the next one is due [s]; infinite for never.

        While one is unanswered for longer than usual, the next follows at once: a verdict must not wait for the rate.
        """
        if self._waiting or self._rate == 0:
            return math.inf
        if self._health.awaits_answer:
            return self._sent_at + PROBE_PATIENCE + 0.001
        if self._rate == "auto":
            return max(self._sent_at, self._health.two_way_proof) + AUTO
        return self._sent_at + 1 / self._rate

    def make(self, board: Board, now: float) -> QueuedTransmission:
        """Return the next link test of a board."""
        self._waiting = True
        self._pattern = self._pattern % 0xFFFF + 1
        message: WireMessage = EchoRequest(pattern=self._pattern) if board is Board.NC else VersionRequest()
        return QueuedTransmission(
            message.to_frame(board),
            Purpose.ECHO,
            now + _DEADLINE,
            board,
            message,
            slot=(board, message.spec.reply or ""),
            reply_within=PROBE_PATIENCE,
            tag=self._pattern,
        )

    def sent(self, entry: QueuedTransmission, now: float) -> None:
        """One went out."""
        self._waiting = False
        self._sent_at = now
        self._health.probe_sent(entry.tag, now)

    def dropped(self) -> None:
        """One never had its turn."""
        self._waiting = False
