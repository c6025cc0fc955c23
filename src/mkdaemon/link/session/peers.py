"""The boards on the line and their dialects, learned from their frames, without a clock. Pure."""

from __future__ import annotations

import math
from typing import Final, NamedTuple

from mkdaemon.protocol.decoder import Unknown
from mkdaemon.protocol.dialect import Dialect, Evidence, decide
from mkdaemon.protocol.messages.version import VersionFc210
from mkdaemon.protocol.wire import Board, WireMessage
from mkdaemon.telemetry.refusals import Token, refuse

PROOF_AGE: Final = 10.0
"""A version reply older than this no longer proves which board is on the line [s]."""
AFTER_PASSAGE: Final = 0.8
"""Time until a NaviCtrl's telemetry is back after a redirection; the verdict takes part of it [s]."""
TAIL_TIME: Final = 0.15
"""A frame that a redirection cut ends within this time after the escape sequence [s]."""
VERSION_KEY: Final = VersionFc210.spec.key
"""The message a board names itself with."""
_PILOTS: Final = (Board.FC, Board.NC)


class Proof(NamedTuple):
    """The latest version reply since the wire last led elsewhere.

    Attributes:
        board: who sent it.
        at: when [s].
    """

    board: Board
    at: float


class Peers:
    """Owns what is known about the boards on the wire: addresses, versions, dialect.

    Attributes:
        evidence: what the boards have shown of themselves since the port was opened, or since `forget`.
        dialect: what the evidence proves.
        direct: the board the wire ends at; ANY while unknown.
        redirected: the board a NaviCtrl passes the line through to; None for none.
        boards: heard since the port was opened.
        firmware: release of each board that named it since the port was opened.
        looks: how often the FlightCtrl behind a NaviCtrl was asked for its release, since the same.
        proof: who sent the latest version reply; None where the wire has led elsewhere since.
    """

    def __init__(self) -> None:
        self.evidence = Evidence()
        self.dialect: Dialect = decide(self.evidence)
        self.direct = Board.ANY
        self.redirected: Board | None = None
        self.boards: set[Board] = set()
        self.firmware: dict[Board, str] = {}
        self.proof: Proof | None = None
        self.looks = 0
        self._passage = (-math.inf, -math.inf)

    def restart(self) -> None:
        """A port was opened: the boards must be identified again."""
        self.direct, self.redirected = Board.ANY, None
        self.boards.clear()
        self.forget()

    def forget(self) -> None:
        """Forget the boards' identities: others may be there, so they are asked again.

        Another aircraft may hang on the same cable, or a board may have been replaced behind the same NaviCtrl.
        """
        self._take(Evidence())
        self.firmware.clear()
        self.proof = None
        self.looks = 0

    def forget_flightctrl(self) -> None:
        """The FlightCtrl behind the NaviCtrl must name itself again, and only that."""
        if Board.FC in self.firmware:
            self.looks = 0
        self.firmware.pop(Board.FC, None)
        self._take(self.evidence.without_flightctrl())

    def recall_flightctrl(self, known: Evidence) -> None:
        """Take what a FlightCtrl showed of itself before, because this is the same one."""
        self.firmware[Board.FC] = str(known.releases[Board.FC])
        self._take(self.evidence.with_flightctrl_of(known))

    def _take(self, evidence: Evidence) -> None:
        self.evidence = evidence
        self.dialect = decide(evidence)

    def redirect(self, board: Board | None, now: float) -> None:
        """Note that a NaviCtrl passes the wire through to a board; None: it speaks for itself again."""
        if board is not None:
            self._passage = (now, math.inf)
        elif self.redirected is not None:
            self._passage = (self._passage[0], now)
        self.redirected = board
        self.proof = None

    def caused_silence(self, since: float, until: float) -> bool:
        """Whether a silence between two times [s] is the doing of a NaviCtrl that passed the wire through."""
        began, ended = self._passage
        return since >= began and until <= ended + AFTER_PASSAGE

    def caused_damage(self, now: float) -> bool:
        """Whether bytes that are no frame are the doing of a NaviCtrl that passes the wire through, or just did."""
        began, ended = self._passage
        return began <= now <= ended + TAIL_TIME

    def note_sender(self, board: Board) -> bool:
        """Note that a frame came from a board; returns whether the wire ends at another board than before.

        A FlightCtrl that speaks after a NaviCtrl did is behind it (a redirection left open); a NaviCtrl that
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

    def version_received(self, board: Board, message: WireMessage, now: float) -> None:
        """Note a version reply: it proves that the board is on the line."""
        self.proof = Proof(board, now)
        self.firmware[board] = str(getattr(message, "release", ""))

    def is_proven(self, board: Board, now: float) -> bool:
        """Whether the latest version reply, not long ago, came from this board."""
        return self.proof is not None and self.proof.board is board and now - self.proof.at <= PROOF_AGE

    def learn(self, board: Board, message: WireMessage | Unknown) -> bool:
        """Take what a message tells about the firmware; returns whether the dialect changed."""
        evidence = self.evidence.with_message(board, message)
        if evidence == self.evidence:
            return False
        self.evidence = evidence
        before, self.dialect = self.dialect, decide(evidence)
        return self.dialect != before

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
            detail = f"a NaviCtrl does not forward {message.spec.name} to the FlightCtrl"
            raise refuse(Token.BOARD_UNREACHABLE, board=board.word, detail=detail)
        if self.direct is Board.FC and board is Board.NC:
            raise refuse(Token.BOARD_UNREACHABLE, board=board.word, detail="the line ends at a FlightCtrl")
