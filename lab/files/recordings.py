"""Hostile recordings whose checksums are right: what is wrong is what they say."""

from __future__ import annotations

import io
import random
import struct
from collections.abc import Callable, Sequence
from typing import Any, Final

import msgpack
from mcap import records
from mcap.opcode import Opcode
from mcap.stream_reader import StreamReader
from mcap.writer import Writer

from mkdaemon.record.layout import MAGIC, SESSION
from mkdaemon.record.scan import Record, ScannedChunk, Scanner, read_channel, records_in
from mkdaemon.record.writer import ChunkBuilder, packed

_MESSAGE: Final = struct.Struct("<HIQQ")
TIMES: Final = (0, 1, 999, 1 << 31, 1 << 53, (1 << 63) - 1, 1 << 63, (1 << 64) - 1, 4_000_000_000_000_000_000)
VALUES: Final[tuple[Any, ...]] = (
    *(None, True, 0, -1, 1.5, float("nan"), float("inf"), -float("inf"), 1e308, (1 << 64) - 1, -(1 << 63)),
    *("", "a", "\x1b]0;t\x07", "\u202e", "1", b"", b"\xff", [], [1], {}, {"a": 1}, [[[[[]]]]], "x" * 10_000),
)
"""Put in place of any part of a value."""
KEYS: Final = (
    *("", "/", "mk", "mk/", "mk//state", "mk/mk1", "mk/../../x", "mk/mk1/\0", "mk/mk1/" + "a" * 400, "mk/mk1/**"),
    *("mk/mk1/\x1b[2J", "replay/mk1/state/attitude", "mk/a b/state/position", "mk/mk1/state/position\n"),
)
NUMBERS: Final = ("", "a", "-1", "1.5", "9" * 30, "9" * 400, "9" * 5000, str(1 << 63), str(-(1 << 63)), "nan", "\u0663")


def spoil_recording(chance: random.Random, content: bytes) -> bytes:
    """A recording in which one thing, or many of a kind, are not as a recorder writes them."""
    parts = list(Scanner(io.BytesIO(content), len(content)).records())
    spoil: Callable[[random.Random, list[Record | ScannedChunk]], bytes] = chance.choice(
        (_values, _values, _values, _times, _channels, _sessions, _chunks, _order, _raw, _raw)
    )
    return spoil(chance, parts)


def _file(parts: Sequence[Record | ScannedChunk]) -> bytes:
    """The file of some records, as one that was not finished."""
    return MAGIC + b"".join(_packed(part) for part in parts if isinstance(part, ScannedChunk) or part.opcode in _KEPT)


_KEPT: Final = frozenset({Opcode.HEADER, Opcode.METADATA})


def _packed(part: Record | ScannedChunk) -> bytes:
    if isinstance(part, Record):
        return struct.pack("<BQ", part.opcode, len(part.content)) + part.content
    return rebuilt(list(records_in(part.content())))


def rebuilt(found: list[Record]) -> bytes:
    """A chunk of some records, its checksum right."""
    builder = ChunkBuilder()
    for record in found:
        builder.data += struct.pack("<BQ", record.opcode, len(record.content)) + record.content
        if record.opcode == Opcode.MESSAGE and len(record.content) >= _MESSAGE.size:
            at = _MESSAGE.unpack_from(record.content)[2]
            builder.first = min(builder.first, at) if builder.messages else at
            builder.last, builder.messages = max(builder.last, at), builder.messages + 1
    return builder.end()


def _edited(parts: list[Record | ScannedChunk], edit: Callable[[Record], Record | None], opcode: int) -> bytes:
    """The file with some records of its chunks changed."""
    made: list[bytes] = []
    for part in parts:
        if isinstance(part, ScannedChunk):
            inside = [edit(one) if one.opcode == opcode else one for one in records_in(part.content())]
            made.append(rebuilt([one for one in inside if one is not None]))
        elif part.opcode in _KEPT:
            made.append(_packed(part))
    return MAGIC + b"".join(made)


def _share(chance: random.Random) -> float:
    return chance.choice((0.002, 0.02, 0.2, 1.0))


def _values(chance: random.Random, parts: list[Record | ScannedChunk]) -> bytes:
    """Parts of values become others of other types."""
    share = _share(chance)

    def edit(record: Record) -> Record:
        if chance.random() > share:
            return record
        head, data = record.content[: _MESSAGE.size], record.content[_MESSAGE.size :]
        try:
            value = msgpack.unpackb(data, strict_map_key=False)
            if isinstance(value, dict) and isinstance(value.get("payload"), bytes) and chance.random() < 0.7:
                inner = msgpack.unpackb(value["payload"], strict_map_key=False)
                value["payload"] = msgpack.packb(_wrong(chance, inner))
            else:
                value = _wrong(chance, value)
            data = msgpack.packb(value)
        except (ValueError, msgpack.exceptions.UnpackException):
            data = chance.randbytes(len(data))
        return Record(record.opcode, head + data)

    return _edited(parts, edit, Opcode.MESSAGE)


def _wrong(chance: random.Random, value: Any) -> Any:
    """A value with one part of it changed, removed or added."""
    if isinstance(value, dict) and value and chance.random() < 0.85:
        name = chance.choice(list(value))
        if chance.random() < 0.15:
            return {key: part for key, part in value.items() if key != name}
        return {**value, name: _wrong(chance, value[name])}
    if isinstance(value, list) and value and chance.random() < 0.6:
        place = chance.randrange(len(value))
        return [*value[:place], _wrong(chance, value[place]), *value[place + 1 :]]
    return chance.choice(VALUES)


def _raw(chance: random.Random, parts: list[Record | ScannedChunk]) -> bytes:
    """Bytes of messages change, or are random, or nest deep."""
    share = _share(chance)

    def edit(record: Record) -> Record:
        if chance.random() > share:
            return record
        head, data = record.content[: _MESSAGE.size], bytearray(record.content[_MESSAGE.size :])
        match chance.randrange(4):
            case 0:
                data = bytearray(chance.randbytes(len(data)))
            case 1:
                data = bytearray(chance.choice((b"\x91", b"\x81\xa1a")) * chance.choice((100, 1000, 100_000)))
            case 2:
                data = data[: chance.randrange(len(data) + 1)]
            case _ if data:
                data[chance.randrange(len(data))] ^= 1 << chance.randrange(8)
        return Record(record.opcode, head + bytes(data))

    return _edited(parts, edit, Opcode.MESSAGE)


def _times(chance: random.Random, parts: list[Record | ScannedChunk]) -> bytes:
    """Times of messages are far away, or before everything."""
    share = _share(chance)

    def edit(record: Record) -> Record:
        number, sequence, log, publish = _MESSAGE.unpack_from(record.content)
        if chance.random() < share:
            log = chance.choice(TIMES)
        if chance.random() < share:
            publish = chance.choice(TIMES)
        if chance.random() < share / 10:
            number, sequence = chance.randrange(1 << 16), chance.randrange(1 << 32)
        return Record(record.opcode, _MESSAGE.pack(number, sequence, log, publish) + record.content[_MESSAGE.size :])

    return _edited(parts, edit, Opcode.MESSAGE)


def _channels(chance: random.Random, parts: list[Record | ScannedChunk]) -> bytes:
    """Channels say other keys, kinds, clocks; or there are as many as can be, or none."""
    share = _share(chance)
    if chance.random() < 0.1:
        return _edited(parts, lambda record: None, Opcode.CHANNEL)

    def edit(record: Record) -> Record:
        channel = read_channel(record.content)
        if channel is None or chance.random() > share:
            return record
        metadata, topic = dict(channel.metadata), channel.topic
        name = chance.choice([*metadata, "topic"])
        choices = KEYS if name in {"key", "topic"} else NUMBERS
        if name == "topic":
            topic = chance.choice(choices)
        elif chance.random() < 0.1:
            del metadata[name]
        else:
            metadata[name] = chance.choice(choices)
        made = packed(records.Channel(channel.number, topic, channel.message_encoding, metadata, 0))
        return Record(record.opcode, made[9:])

    return _edited(parts, edit, Opcode.CHANNEL)


def _sessions(chance: random.Random, parts: list[Record | ScannedChunk]) -> bytes:
    """What the file says about itself is something else."""
    fields = {
        **dict.fromkeys(("recorder", "name", "program", "host", "boot", "vehicle"), "blackbox"),
        "format": "1",
        "part": "0",
        "offset_ns": "0",
        "config": "{}",
    }
    for _ in range(chance.choice((1, 3))):
        fields[chance.choice(list(fields))] = chance.choice((*KEYS, *NUMBERS, "{", "[" * 100_000, '{"vehicle": 1}'))
    metadata = packed(records.Metadata(SESSION, fields))
    kept = [part for part in parts if isinstance(part, ScannedChunk)]
    return _file([Record(Opcode.METADATA, metadata[9:]), *kept])


def _order(chance: random.Random, parts: list[Record | ScannedChunk]) -> bytes:
    """Chunks in another order, twice, or some of them gone."""
    chunks = [part for part in parts if isinstance(part, ScannedChunk)]
    heads = [part for part in parts if isinstance(part, Record)]
    chosen = chance.choices(chunks, k=chance.choice((1, len(chunks), 3 * len(chunks) + 1)))
    return _file([*heads, *chosen])


def _chunks(chance: random.Random, parts: list[Record | ScannedChunk]) -> bytes:
    """Giants: a chunk of nothing but zeros, chunks in chunks, chunks that overlap."""
    heads = [part for part in parts if isinstance(part, Record)]
    first = next(part for part in parts if isinstance(part, ScannedChunk))
    inside = list(records_in(first.content()))
    channels = [one for one in inside if one.opcode == Opcode.CHANNEL]
    return _file(heads) + chance.choice((_zeros, _nested, _overlapping))(channels)


def _zeros(channels: list[Record]) -> bytes:
    return rebuilt([Record(0x80, bytes(200_000_000))]) * 3


def _nested(channels: list[Record]) -> bytes:
    inner = rebuilt(channels)
    for _ in range(50):
        inner = packed(records.Chunk("", inner, 0, 0, 1, len(inner)))
    return inner * 50


def _overlapping(channels: list[Record]) -> bytes:
    """Very many beginnings of chunks, each as long as what is left of the file."""
    head = struct.calcsize("<BQ") + struct.calcsize("<QQQII") + 8
    count = 40_000
    made = bytearray()
    for number in range(count):
        rest = (count - number) * head - head
        made += struct.pack("<BQ", Opcode.CHUNK, head - 9 + rest)
        made += struct.pack("<QQQII", 0, 0, rest, 1, 0) + struct.pack("<Q", rest)
    return bytes(made)


def rewritten(content: bytes, **how: Any) -> bytes:
    """A recording written again by the writer of the MCAP project.

    Args:
        content: the recording.
        how: arguments of the writer.
    """
    schemas, channels = dict[int, int](), dict[int, int]()
    out = io.BytesIO()
    writer = Writer(out, **how)
    writer.start()
    for record in StreamReader(io.BytesIO(content)).records:
        match record:
            case records.Schema():
                schemas[record.id] = writer.register_schema(record.name, record.encoding, record.data)
            case records.Channel() if record.id not in channels:
                schema = schemas.get(record.schema_id, 0)
                channels[record.id] = writer.register_channel(
                    record.topic, record.message_encoding, schema, record.metadata
                )
            case records.Metadata():
                writer.add_metadata(record.name, record.metadata)
            case records.Message():
                number = channels[record.channel_id]
                writer.add_message(number, record.log_time, record.data, record.publish_time, record.sequence)
    writer.finish()  # type: ignore[no-untyped-call]
    return out.getvalue()
