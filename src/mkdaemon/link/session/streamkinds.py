"""Kinds of frames that boards stream on request, and the intervals they take."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from mkdaemon.protocol.wire import MESSAGES, Board, Direction, WireMessage
from mkdaemon.telemetry.refusals import Token, refuse

TICK_TIME: Final = 0.01
"""Boards count intervals in steps of 10 ms."""
FASTEST: Final = 0.02
"""Interval 1 starves everything below it on a FlightCtrl and saturates the line of a NaviCtrl [s]."""
SLOWEST_TIME: Final = 2.55
"""Largest interval one byte can say [s]."""


@dataclass(frozen=True, slots=True)
class StreamKind:
    """A kind of frame boards stream on request.

    Attributes:
        key: the message, as in Zenoh keys.
        reply: command letter of its frames.
        characters: length of one frame on the wire.
        boards: who streams it.
        request: message class that asks for it.
        renews: see `Stream.renews`.
        is_vital: see `Stream.is_vital`.
    """

    key: str
    reply: str
    characters: int
    boards: frozenset[Board]
    request: Callable[..., WireMessage]
    renews: int | None
    is_vital: bool = False

    def ask(self, interval: float) -> WireMessage:
        """Return the request for an interval [s]; 0 stops the stream."""
        ticks = 0 if interval <= 0 else min(max(round(interval / TICK_TIME), 1), 255)
        return self.request(interval=ticks)


def find_streams() -> dict[str, StreamKind]:
    """Return every stream that a request declares, by key, those first that renew the others best."""
    answers = sorted((cls.spec for cls in MESSAGES.values()), key=lambda spec: spec.characters)
    longest = {spec.key: spec for spec in answers if spec.direction is Direction.FROM_BOARD}
    requests = {cls.spec.stream: cls for cls in MESSAGES.values() if cls.spec.stream is not None}
    return {
        stream.key: StreamKind(
            stream.key,
            longest[stream.key].id,
            longest[stream.key].characters,
            frozenset(cls.spec.boards),
            cls,
            stream.renews,
            stream.is_vital,
        )
        for stream, cls in sorted(requests.items(), key=lambda item: (item[0].renews is None, item[0].renews))
    }


KINDS: Final = find_streams()
"""Every stream by key; the renewal is chosen in this order."""


def round_up_interval(interval: float) -> float:
    """The interval a board is really asked for [s]: whole steps of 10 ms, never shorter than wished, 20 ms at least."""
    return math.ceil(min(max(interval, FASTEST), SLOWEST_TIME) / TICK_TIME - 1e-6) * TICK_TIME


def kind_of(key: str, board: Board) -> StreamKind:
    """Return a kind a board can stream.

    Raises:
        CommandRejectedError: no such stream, or not on this board; says which there are.
    """
    offered = [name for name, kind in KINDS.items() if board in kind.boards or board is Board.ANY]
    if key not in offered:
        raise refuse(Token.NO_SUCH_STREAM, board=board.word, name=key, known=", ".join(offered))
    return KINDS[key]
