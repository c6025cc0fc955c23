"""Recorded traffic as typed messages: both directions, with the dialect learnt on the way."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import BinaryIO, NamedTuple

from mkdaemon.protocol.boards import Board, Direction, board_at
from mkdaemon.protocol.capture import Chunk, read_chunks
from mkdaemon.protocol.decoder import MessageDecoder, Unknown
from mkdaemon.protocol.dialect import Evidence, decide
from mkdaemon.protocol.framing import Dropped, Frame, FrameDecoder
from mkdaemon.protocol.messages import VersionRequest, VersionRequestWhich
from mkdaemon.protocol.wire import WireMessage


class Decoded(NamedTuple):
    """One frame of a recording, or bytes of it that are no frame.

    Attributes:
        t: when its last bytes were recorded [s]; None where the recording has no times.
        direction: from a board or to a board.
        frame: the frame as it stands on the wire; None for bytes that are none.
        content: the typed message; `Unknown` for a frame that no message in the table fits; `Dropped` for the bytes
            that are no frame.
    """

    t: float | None
    direction: Direction
    frame: Frame | None
    content: WireMessage | Unknown | Dropped

    @property
    def board(self) -> Board | None:
        """Sender or addressee of the frame; None without a frame, or if no board has its address."""
        return None if self.frame is None else board_at(self.frame.address)


class TrafficDecoder:
    """Decodes the traffic of one line in both directions; learns from version replies which layouts it speaks."""

    def __init__(self) -> None:
        self._framing = {direction: FrameDecoder() for direction in Direction}
        self._evidence = Evidence()
        self._decoder = MessageDecoder()
        self._asked_for_other_board = False

    def feed(self, chunk: Chunk) -> list[Decoded]:
        """Take the next bytes and return what they completed, in order."""
        return [self._decode(chunk, item) for item in self._framing[chunk.direction].feed(chunk.raw)]

    def flush(self, t: float | None = None) -> list[Decoded]:
        """Give up on unfinished frames at the end of a recording; `t` is its last time [s]."""
        return [
            self._decode(Chunk(t, direction, b""), item)
            for direction, framing in self._framing.items()
            for item in framing.flush()
        ]

    def _decode(self, chunk: Chunk, item: Frame | Dropped) -> Decoded:
        if isinstance(item, Dropped):
            return Decoded(chunk.t, chunk.direction, None, item)
        message = self._decoder.decode(item)
        self._learn(chunk.direction, item, message)
        return Decoded(chunk.t, chunk.direction, item, message)

    def _learn(self, direction: Direction, frame: Frame, message: WireMessage | Unknown) -> None:
        if direction is Direction.TO_BOARD:
            if frame.id == VersionRequest.spec.id:
                self._asked_for_other_board = isinstance(message, VersionRequestWhich)
            return
        if frame.id == VersionRequest.spec.reply and self._asked_for_other_board:
            return  # it names the other board's release under its own address
        board = board_at(frame.address)
        evidence = self._evidence.with_message(board, message) if board is not None else self._evidence
        if evidence != self._evidence:
            self._evidence = evidence
            self._decoder = MessageDecoder(decide(evidence).layouts)


def decode_chunks(chunks: Iterable[Chunk]) -> Iterator[Decoded]:
    """Decode recorded bytes in order; an unfinished frame at the end is a loss."""
    decoder = TrafficDecoder()
    t: float | None = None
    for chunk in chunks:
        t = chunk.t
        yield from decoder.feed(chunk)
    yield from decoder.flush(t)


def decode_capture(stream: BinaryIO, name: str = "the recording") -> Iterator[Decoded]:
    """Decode a recording, raw bytes or a capture.

    Args:
        stream: opened for reading bytes.
        name: how to call it in errors.

    Raises:
        MkError: it is empty, or a capture line is damaged; names the line.
    """
    yield from decode_chunks(read_chunks(stream, name))
