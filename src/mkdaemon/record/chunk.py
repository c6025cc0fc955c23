"""The chunk of an MCAP file that is being filled."""

from __future__ import annotations

import struct
import zlib
from typing import Final

import zstandard
from mcap import records
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode

COMPRESSION: Final = "zstd"
LEVEL: Final = 3
_MESSAGE: Final = struct.Struct("<BQHIQQ")
_FIXED: Final = 22
"""Bytes of a message record before its data, without opcode and length."""


class ChunkBuilder:
    """Messages and definitions that are written together.

    Attributes:
        data: records, not compressed.
        messages: how many of them are messages.
        first: earliest time of a message [ns].
        last: latest time of a message [ns].
        compressed_size: [bytes]; known when it has ended.
    """

    def __init__(self) -> None:
        self.data = bytearray()
        self.messages = 0
        self.first, self.last = 0, 0
        self.compressed_size = 0
        self._places: dict[int, list[int]] = {}

    def add(self, channel: int, sequence: int, at: int, published: int, data: bytes) -> None:
        """Add a message."""
        places = self._places.get(channel)
        if places is None:
            places = self._places[channel] = []
        places += (at, len(self.data))
        self.data += _MESSAGE.pack(Opcode.MESSAGE, _FIXED + len(data), channel, sequence, at, published)
        self.data += data
        self.first = at if not self.messages else min(self.first, at)
        self.last = max(self.last, at)
        self.messages += 1

    def end(self) -> bytes:
        """The chunk as a record."""
        content = bytes(self.data)
        compressed = zstandard.compress(content, LEVEL)
        self.compressed_size = len(compressed)
        return packed(
            records.Chunk(
                compression=COMPRESSION,
                data=compressed,
                message_end_time=self.last,
                message_start_time=self.first,
                uncompressed_crc=zlib.crc32(content),
                uncompressed_size=len(content),
            )
        )

    def indexes(self, start: int) -> tuple[dict[int, int], bytes]:
        """Where each channel's messages are, as records that stand at `start`, and where each of these begins."""
        offsets, packed = {}, bytearray()
        for channel, places in self._places.items():
            offsets[channel] = start + len(packed)
            size = 8 * len(places)
            packed += struct.pack(f"<BQHI{len(places)}Q", Opcode.MESSAGE_INDEX, 6 + size, channel, size, *places)
        return offsets, bytes(packed)


def packed(record: records.McapRecord) -> bytes:
    """A record as bytes."""
    builder = RecordBuilder()
    record.write(builder)
    content: bytes = builder.end()  # type: ignore[no-untyped-call]
    return content
