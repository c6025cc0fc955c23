"""Recorded traffic as a stream of chunks: raw bytes, or lines of JSON with time, direction and bytes.

A capture line is ``{"t": seconds, "dir": "rx" | "tx", "hex": "..."}``. The first byte of a stream decides which form it
has, so standard input works the same.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import BinaryIO, Final, NamedTuple

from mkdaemon.errors import MkError
from mkdaemon.foreignfiles import parse_json
from mkdaemon.protocol.boards import Direction

_BLOCK: Final = 4096
_LONGEST_LINE: Final = 1 << 16
"""A longer line is cut here, and then no capture line [bytes]."""
_BLANK: Final = b"\xef\xbb\xbf \t\r\n"


class Chunk(NamedTuple):
    """Bytes that arrived together.

    Attributes:
        t: when [s]; None where not recorded.
        direction: from a board or to a board.
        raw: the bytes.
    """

    t: float | None
    direction: Direction
    raw: bytes


def read_chunks(stream: BinaryIO, name: str) -> Iterator[Chunk]:
    """Read a recording of either form.

    Args:
        stream: opened for reading bytes.
        name: how to call it in errors.

    Raises:
        MkError: it is empty, or a capture line is damaged; names the line.
    """
    # A byte order mark and blank lines are an editor's, and come before a capture only; thousands are no editor's.
    lead = bytearray()
    while (first := stream.read(1)) and first in _BLANK and len(lead) < _LONGEST_LINE:
        lead += first
    if not lead + first:
        msg = f"{name} is empty: nothing was recorded"
        raise MkError(msg)
    if first == b"{":
        yield from _read_lines(first, stream, name, lead.count(b"\n") + 1)
    else:
        yield Chunk(None, Direction.FROM_BOARD, bytes(lead) + first)
        # read1 hands over what a pipe has without waiting for a whole block.
        read = getattr(stream, "read1", stream.read)
        while block := read(_BLOCK):
            yield Chunk(None, Direction.FROM_BOARD, block)


def _read_lines(first: bytes, stream: BinaryIO, name: str, number: int) -> Iterator[Chunk]:
    yield _chunk(first + stream.readline(_LONGEST_LINE), name, number)
    for at, line in enumerate(iter(lambda: stream.readline(_LONGEST_LINE), b""), start=number + 1):
        if line.strip():
            yield _chunk(line, name, at)


def _chunk(line: bytes, name: str, number: int) -> Chunk:
    try:
        entry = parse_json(line)
        t, direction, raw = entry["t"], Direction(entry["dir"]), bytes.fromhex(entry["hex"])
        if isinstance(t, bool) or not math.isfinite(t):
            raise ValueError(line)
    except (ValueError, KeyError, TypeError, OverflowError) as error:
        msg = f'{name} line {number} is no capture line: {{"t": seconds, "dir": "rx" or "tx", "hex": "..."}} is needed'
        raise MkError(msg) from error
    return Chunk(float(t), direction, raw)
