"""Streams: asked for once, renewed for as long as someone wants them. Pure; driven with `now`.

A board has ONE timer for all its streams (NaviCtrl 4.0 s, FlightCtrl 4.1 s); any stream request renews them all. A
request with interval 0 renews without costing a frame, so a kind nobody wants is the renewal; where all kinds are
wanted, the one with the shortest reply is. Every other request costs one frame and restarts the phase of its stream,
so a stream is asked for again only when its rate changes or it went stale.
Source: docs/firmware-notes, "Subscriptions".
"""

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
ASK_AGAIN: Final = 1.0
"""How soon a stream that does not come is asked for again [s]."""


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
    """

    key: str
    reply: str
    characters: int
    boards: frozenset[Board]
    request: Callable[..., WireMessage]
    renews: int | None

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


@dataclass(slots=True)
class _Stream:
    interval: float
    asked_at: float = -math.inf
    seen_at: float = -math.inf


class Subscriptions:
    """The streams of one board."""

    def __init__(self, board: Board, *, renew: float = 1.5) -> None:
        self.board = board
        self._renew = renew
        self._wanted: dict[str, _Stream] = {}
        self._to_stop: list[str] = []
        self._renewed_at = -math.inf

    @property
    def wanted(self) -> dict[str, float]:
        """Interval of every wanted stream [s]."""
        return {key: stream.interval for key, stream in self._wanted.items()}

    def want(self, key: str, interval: float) -> None:
        """Want a stream at an interval [s], see `round_up_interval`; 0 or less ends it.

        Raises:
            CommandRejectedError: see `kind_of`.
        """
        kind_of(key, self.board)
        if interval <= 0:
            if self._wanted.pop(key, None) is not None:
                self._to_stop.append(key)
            return
        interval = round_up_interval(interval)
        stream = self._wanted.get(key)
        if stream is None or stream.interval != interval:
            self._wanted[key] = _Stream(interval)

    def end(self, key: str) -> None:
        """End a stream that nobody here wants."""
        if key not in self._to_stop and self.board in KINDS[key].boards:
            self._to_stop.append(key)

    def forget(self) -> None:
        """The board lost everything it was asked (reboot, port lost): ask for all of it again."""
        for stream in self._wanted.values():
            stream.asked_at = stream.seen_at = -math.inf
        self._renewed_at = -math.inf

    def frame_received(self, key: str, now: float) -> None:
        """A frame of a kind arrived."""
        stream = self._wanted.get(key)
        if stream is not None:
            stream.seen_at = now

    def due(self, now: float) -> list[WireMessage]:
        """Return the requests to send now and note them as asked."""
        messages = [KINDS[key].ask(0) for key in self._to_stop]
        self._to_stop.clear()
        for key, stream in self._wanted.items():
            if now >= self._asks_at(stream):
                stream.asked_at = now
                messages.append(KINDS[key].ask(stream.interval))
        if messages:
            self._renewed_at = now
        elif self._wanted and now >= self._renewed_at + self._renew:
            self._renewed_at = now
            messages.append(self._renewal(now))
        return messages

    def next_time(self) -> float:
        """When `due` has something next [s]; infinite while nothing is wanted."""
        if self._to_stop:
            return -math.inf
        if not self._wanted:
            return math.inf
        return min(self._renewed_at + self._renew, *(self._asks_at(stream) for stream in self._wanted.values()))

    @staticmethod
    def _asks_at(stream: _Stream) -> float:
        """When a stream must be asked for (again): at once, or when three periods went by without a frame."""
        if stream.asked_at == -math.inf:
            return -math.inf
        patience = max(ASK_AGAIN, 3 * stream.interval)
        return max(stream.asked_at, stream.seen_at) + patience

    def _renewal(self, now: float) -> WireMessage:
        for key, kind in KINDS.items():
            if key not in self._wanted and self.board in kind.boards and kind.renews is not None:
                return kind.ask(0)
        key = next(key for key in KINDS if key in self._wanted)
        self._wanted[key].asked_at = now
        return KINDS[key].ask(self._wanted[key].interval)
