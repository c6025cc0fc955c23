"""Writes entries into one MCAP file, so that it can be read whatever ends the writing.

Guaranteed: every `flush` hands whole records to the output in one piece, so a file that is cut off anywhere keeps all
that was flushed before; channels are repeated every `REPEAT`, so a damaged part of a file costs only its own entries; a
file that was finished has MCAP's summary and indexes, and opens in any reader.

MCAP: https://mcap.dev/spec. Records come from the `mcap` library; the chunks are filled here, because its own writer
takes 8 us a message, cannot repeat a channel, and is left in no known state by a full disk.
"""

from __future__ import annotations

import struct
import zlib
from collections import Counter
from collections.abc import Mapping
from typing import Final, Protocol

import zstandard
from mcap import records
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode

from mkdaemon.record.entry import SEQUENCES, Entry
from mkdaemon.record.layout import MAGIC, PROFILE, SESSION, VIEW, ChannelFacts, Session, needs_envelope
from mkdaemon.stamp import nanoseconds

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


CHUNK_BYTES: Final = 1 << 20
"""A chunk ends at this number of bytes; viewers read a file by chunks."""
MOST_CHANNELS: Final = 60_000
"""Channels that a file may have; MCAP numbers them with 16 bits, and an entry needs up to two."""
REPEAT: Final = 10.0
"""Time between two copies of the session and of all channels in a file [s]."""


class ByteOutput(Protocol):
    """Takes what is written; a file, for example."""

    def write(self, data: bytes, /) -> object:
        """Take all of it or raise."""


class View(Protocol):
    """Shows entries to programs that read JSON only."""

    def schema(self, facts: ChannelFacts) -> tuple[str, bytes] | None:
        """Name and JSON Schema of what `show` makes of a channel's entries; None where it shows none of them."""

    def show(self, entry: Entry) -> bytes | None:
        """An entry as JSON; None where it has nothing to show."""


class RecordingWriter:
    """Writes one file. Not for several threads at a time.

    Attributes:
        size: bytes handed to the output.
        entries: number of entries added.
        pending: entries that were added and are not in the output yet.
    """

    def __init__(self, output: ByteOutput, session: Session, view: View | None = None) -> None:
        """Begin a file.

        Args:
            output: takes the bytes; whatever it raises passes through, and the file is to be given up then.
            session: what the file says about itself.
            view: adds JSON for viewers; None for originals only.
        """
        self.size = 0
        self.entries = 0
        self.pending: list[Entry] = []
        self._output = output
        self._session = session
        self._view = view
        self._channels: dict[ChannelFacts, int] = {}
        self._recent: dict[tuple[str, str], tuple[ChannelFacts, int]] = {}
        self._shown: dict[ChannelFacts, int | None] = {}
        self._channel_count = 0
        self._definitions = bytearray()
        self._schemas: dict[tuple[str, bytes], int] = {}
        self._chunk = ChunkBuilder()
        self._counts: Counter[int] = Counter()
        self._first, self._last = 0, 0
        self._repeat_at = 0
        self._chunk_indexes = bytearray()
        self._chunks = 0
        self._metadata_indexes = bytearray()
        self._metadata_count = 0
        self._put(MAGIC + packed(records.Header(PROFILE, session.program)))
        self._put(self._session_record())

    @property
    def is_full(self) -> bool:
        """Whether it has nearly as many channels as MCAP can number: no entry of another key is to be added."""
        return self._channel_count >= MOST_CHANNELS

    def add(self, entry: Entry) -> None:
        """Take an entry; it is in the output after the next `flush`, or when the chunk is full."""
        self.pending.append(entry)
        facts, channel = self._channel_of(entry)
        at = entry.base.file_time(entry.received)
        self._add_message(channel, entry.sequence, at, nanoseconds(entry.published), facts.pack(entry))
        shown = self._shown[facts]
        if shown is not None and self._view is not None:
            picture = self._view.show(entry)
            if picture is not None:
                self._add_message(shown, entry.sequence, at, nanoseconds(entry.published), picture)
        self.entries += 1
        if len(self._chunk.data) >= CHUNK_BYTES:
            self._end_chunk()

    def flush(self) -> None:
        """Hand everything that was added to the output, as whole records in one piece."""
        if self._chunk.messages:
            self._end_chunk()

    def finish(self) -> None:
        """Write the rest, the indexes and the end of the file; the output stays open."""
        self.flush()
        self._put(packed(records.DataEnd(0)))
        start = self.size
        summary, offsets = bytearray(), bytearray()
        groups = (
            (Opcode.SCHEMA, self._definitions_of(Opcode.SCHEMA)),
            (Opcode.CHANNEL, self._definitions_of(Opcode.CHANNEL)),
            (Opcode.STATISTICS, packed(self._statistics())),
            (Opcode.CHUNK_INDEX, bytes(self._chunk_indexes)),
            (Opcode.METADATA_INDEX, bytes(self._metadata_indexes)),
        )
        for opcode, group in groups:
            if group:
                offsets += packed(records.SummaryOffset(opcode, start + len(summary), len(group)))
                summary += group
        offsets_at = start + len(summary)
        summary += offsets
        head = struct.pack("<BQQQ", Opcode.FOOTER, 20, start, offsets_at)
        footer = records.Footer(start, offsets_at, zlib.crc32(head, zlib.crc32(summary)))
        self._put(bytes(summary) + packed(footer) + MAGIC)

    def _add_message(self, channel: int, sequence: int, at: int, published: int, data: bytes) -> None:
        self._chunk.add(channel, sequence % SEQUENCES, at, published, data)
        self._counts[channel] += 1
        self._first = min(self._first or at, at)
        self._last = max(self._last, at)

    def _channel_of(self, entry: Entry) -> tuple[ChannelFacts, int]:
        """The channel of an entry; looking it up by everything it stands for takes half the time of writing."""
        recent = self._recent.get((entry.key, entry.encoding))
        if recent is not None:
            facts = recent[0]
            is_same = facts.kind is entry.kind and facts.base is entry.base and facts.qos is entry.qos
            if is_same and facts.has_envelope == needs_envelope(entry):
                return recent
        facts = ChannelFacts.of(entry)
        known = self._channels.get(facts)
        found = self._recent[entry.key, entry.encoding] = (facts, self._open_channel(facts) if known is None else known)
        return found

    def _open_channel(self, facts: ChannelFacts) -> int:
        """Define the channel of some facts, and the one that shows it."""
        schema = self._schema(facts.schema_name, "", b"")
        channel = self._define(facts.topic, facts.message_encoding, schema, facts.to_metadata())
        self._channels[facts] = channel
        wanted = self._view.schema(facts) if self._view is not None else None
        if wanted is None:
            self._shown[facts] = None
        else:
            name, content = wanted
            shown = self._schema(name, "jsonschema", content)
            self._shown[facts] = self._define(facts.key, "json", shown, {**facts.to_metadata(), VIEW: "1"})
        return channel

    def _schema(self, name: str, encoding: str, content: bytes) -> int:
        number = self._schemas.get((name, content))
        if number is None:
            number = self._schemas[name, content] = len(self._schemas) + 1
            record = packed(records.Schema(number, content, encoding, name))
            self._definitions += record
            self._chunk.data += record
        return number

    def _define(self, topic: str, encoding: str, schema: int, metadata: Mapping[str, str]) -> int:
        self._channel_count += 1
        number = self._channel_count
        record = packed(records.Channel(number, topic, encoding, dict(metadata), schema))
        self._definitions += record
        self._chunk.data += record
        return number

    def _definitions_of(self, opcode: Opcode) -> bytes:
        """All schemas, or all channels, as records."""
        found, at = bytearray(), 0
        while at < len(self._definitions):
            (length,) = struct.unpack_from("<Q", self._definitions, at + 1)
            end = at + 9 + length
            if self._definitions[at] == opcode:
                found += self._definitions[at:end]
            at = end
        return bytes(found)

    def _end_chunk(self) -> None:
        """Hand the chunk, its indexes and, where it is due, the session to the output."""
        before = b""
        last = self._chunk.last
        if last >= self._repeat_at:
            if self._chunks:
                before = self._session_record()
                self._chunk.data += self._definitions
            self._repeat_at = last + nanoseconds(REPEAT)
        chunk = self._chunk.end()
        index_at = self.size + len(before) + len(chunk)
        offsets, indexes = self._chunk.indexes(index_at)
        index = records.ChunkIndex(
            chunk_length=len(chunk),
            chunk_start_offset=self.size + len(before),
            compression=COMPRESSION,
            compressed_size=self._chunk.compressed_size,
            message_end_time=self._chunk.last,
            message_index_length=len(indexes),
            message_index_offsets=offsets,
            message_start_time=self._chunk.first,
            uncompressed_size=len(self._chunk.data),
        )
        self._chunk_indexes += packed(index)
        self._chunks += 1
        self._chunk = ChunkBuilder()
        self._put(before + chunk + indexes)
        self.pending.clear()

    def _session_record(self) -> bytes:
        record = packed(records.Metadata(SESSION, self._session.to_metadata()))
        self._metadata_indexes += packed(records.MetadataIndex(self.size, len(record), SESSION))
        self._metadata_count += 1
        return record

    def _statistics(self) -> records.Statistics:
        return records.Statistics(
            attachment_count=0,
            channel_count=self._channel_count,
            channel_message_counts=dict(self._counts),
            chunk_count=self._chunks,
            message_count=self._counts.total(),
            message_end_time=self._last,
            message_start_time=self._first,
            metadata_count=self._metadata_count,
            schema_count=len(self._schemas),
        )

    def _put(self, data: bytes) -> None:
        self._output.write(data)
        self.size += len(data)
