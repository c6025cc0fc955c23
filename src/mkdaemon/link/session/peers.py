"""Who is on the line and how they speak: gathered from what they say, without a clock. Pure."""

from __future__ import annotations

import math
from typing import Final

from mkdaemon.protocol.decoder import Unknown
from mkdaemon.protocol.dialect import Dialect, Evidence, decide
from mkdaemon.protocol.wire import Board, WireMessage
from mkdaemon.telemetry.refusals import Token, refuse

MOTORS_RUN: Final = 0x01
"""FCStatusFlags bit 0."""
MOTORS_FRESH: Final = 1.0
"""Telemetry about the motors counts for this long [s]."""
_PILOTS: Final = (Board.FC, Board.NC)


class Acquaintance:
    """What the boards have shown of themselves.

    Attributes:
        evidence: kept over the loss of the port: a cable pulled and plugged does not change the aircraft, and another
            release at the same address starts it over.
        dialect: what the evidence proves.
        direct: the board the wire ends at; ANY while unknown.
        redirected: the board a NaviCtrl passes the line through to; None for none.
        boards: heard since the port was opened.
    """

    def __init__(self) -> None:
        self.evidence = Evidence()
        self.dialect: Dialect = decide(self.evidence)
        self.direct = Board.ANY
        self.redirected: Board | None = None
        self.boards: set[Board] = set()
        self._motors_at = -math.inf
        self._motors_run = True

    def restart(self) -> None:
        """A port was opened: who is there must show itself again."""
        self.direct, self.redirected = Board.ANY, None
        self.boards.clear()
        self._motors_at = -math.inf

    def meet(self, board: Board) -> bool:
        """A frame came from this board; returns whether the board the wire ends at is another one than before.

        A FlightCtrl that speaks after a NaviCtrl did is behind it (a redirection somebody left open); a NaviCtrl that
        speaks is always at the end of the wire.
        """
        if board not in _PILOTS:
            return False
        self.boards.add(board)
        if board is self.direct or self.redirected is not None:
            return False
        if board is not Board.NC and self.direct is not Board.ANY:
            return False
        self.direct = board
        return True

    def learn(self, board: Board, message: WireMessage | Unknown) -> bool:
        """A message may tell something about the firmware; returns whether the dialect changed."""
        evidence = self.evidence.with_message(board, message)
        if evidence == self.evidence:
            return False
        self.evidence = evidence
        before, self.dialect = self.dialect, decide(evidence)
        return self.dialect != before

    def note_motors(self, message: WireMessage, now: float) -> None:
        """NaviData tells whether the motors run; an unknown form of it counts as running."""
        self._motors_at = now
        self._motors_run = bool(getattr(message, "fc_flags", MOTORS_RUN) & MOTORS_RUN)

    def motors_running(self, now: float) -> bool | None:
        """Whether fresh telemetry says that the motors run; None where there is none."""
        return self._motors_run if now - self._motors_at < MOTORS_FRESH else None

    def reaches_fc(self, message: WireMessage, board: Board) -> bool:
        """Whether a FlightCtrl receives this frame."""
        if self.direct is Board.NC and self.redirected is None:
            return board is Board.FC and message.spec.is_forwarded
        return True

    def check_reach(self, message: WireMessage, board: Board) -> None:
        """Refuse what cannot arrive.

        Raises:
            CommandRejectedError: the wire does not lead to this board.
        """
        behind = self.direct is Board.NC and board is Board.FC and self.redirected is not Board.FC
        if behind and not message.spec.is_forwarded:
            detail = f"a NaviCtrl does not pass {message.spec.name} on to the FlightCtrl"
            raise refuse(Token.BOARD_UNREACHABLE, board=board.word, detail=detail)
        if self.direct is Board.FC and board is Board.NC:
            raise refuse(Token.BOARD_UNREACHABLE, board=board.word, detail="the line ends at a FlightCtrl")
