"""What a FlightCtrl says and when: one slot a kind of reply, subscriptions, and the order in which they leave.

At most one frame starts in a pass of the main loop, and only when the transmitter is idle. Source: docs/firmware-notes,
"Losses" and "Subscriptions".
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from mkdaemon.protocol.wire import Board
from mkdaemon.sim.boards import fc_replies
from mkdaemon.sim.boards.generations import FC_MS, SHORT_PASS

if TYPE_CHECKING:
    from mkdaemon.sim.boards.fc import FlightCtrl

SUBSCRIPTION_TIME: Final = 4000 * 1.025e-3
"""Streams stop so long after the last renewal: 4.1 s as measured."""
_COMPASS: Final = 0.099
_COMPASS_SLOW: Final = 0.999
"""Period of the compass feed without and with a NaviCtrl. Source: docs/protocol.md, section 9."""


@dataclass(slots=True)
class Stream:
    """A subscription."""

    interval: int = 0
    due: float = 0.0

    def restart(self, now: float) -> None:
        """Begin a period at `now`."""
        self.due = now + (10 * self.interval + 1) * FC_MS + SHORT_PASS

    def is_due(self, now: float) -> bool:
        """Whether a frame must go out."""
        return self.interval > 0 and now >= self.due


@dataclass(slots=True)
class Wanted:
    """Replies asked for and not yet sent, one slot each; None and False mean nothing is wanted."""

    version: int | None = None
    control: bool = False
    debug: bool = False
    label: int | None = None
    display: bool = False
    menu: int | None = None
    receiver: bool = False


class Speech:
    """The board's replies and streams.

    Attributes:
        wanted: replies asked for.
        debug: the D stream.
        attitude: the C stream.
        display: the H stream.
    """

    def __init__(self, board: FlightCtrl) -> None:
        self._board = board
        self.wanted = Wanted()
        self.debug = Stream()
        self.attitude = Stream()
        self.display = Stream()
        self._expires = 0.0
        self._compass_at = board.now

    def renew(self, now: float) -> None:
        """Keep the subscriptions alive."""
        self._expires = now + SUBSCRIPTION_TIME

    def talk(self, now: float) -> None:
        """Start at most one frame; a label asked for while a debug frame starts collides with it."""
        board, wanted = self._board, self.wanted
        if now >= self._expires:
            self.attitude.interval = self.display.interval = 0
            if not board.is_fork:
                self.debug.interval = 0
        if self._talk_first(now) or self._feed_compass(now):
            return
        started = False
        if wanted.debug or self.debug.is_due(now):
            wanted.debug = False
            self.debug.restart(now)
            board.send(fc_replies.debug(board), now)
            started = True
        if wanted.label is not None:
            index, wanted.label = wanted.label, None
            board.cut(now)
            board.send(fc_replies.name(index), now)
            return
        if not started:
            self._talk_last(now)

    def _talk_first(self, now: float) -> bool:
        """Version and external control go before everything."""
        board, wanted = self._board, self.wanted
        if wanted.version is not None:
            reply = fc_replies.companion_version if wanted.version == 2 else fc_replies.version
            wanted.version = None
            board.send(reply(board), now)
            return True
        if wanted.control:
            wanted.control = False
            board.send(fc_replies.control_state(board), now)
            return True
        return False

    def _feed_compass(self, now: float) -> bool:
        """Early firmware tells an MK3Mag its attitude, whether there is one or not."""
        board = self._board
        if not board.generation.feeds_compass or now < self._compass_at:
            return False
        self._compass_at = now + (_COMPASS_SLOW if board.has_companion else _COMPASS)
        board.send(fc_replies.compass_feed(board), now, Board.MAG)
        return True

    def _talk_last(self, now: float) -> None:
        """What a fast debug stream starves."""
        board, wanted = self._board, self.wanted
        if board.external.confirm:
            board.send(fc_replies.confirm(board.external.confirm), now)
            board.external.confirm = 0
        elif self.attitude.is_due(now):
            self.attitude.restart(now)
            board.send(fc_replies.attitude(board), now)
        elif wanted.display or self.display.is_due(now):
            wanted.display = False
            self.display.restart(now)
            board.send(board.menu.display(board), now + board.menu.PRINT)
        elif wanted.menu is not None:
            page, wanted.menu = wanted.menu, None
            board.send(board.menu.page(board, page), now + board.menu.PRINT)
        elif wanted.receiver:
            wanted.receiver = False
            board.send(fc_replies.receiver(board), now)
