"""A file of many small chunks, each with the same channels, costs no more than what is in them."""

from __future__ import annotations

import io
import struct

from mcap.opcode import Opcode

from lab.files.originals import RECORDINGS
from lab.files.recordings import rebuilt
from mkdaemon.record import reader
from mkdaemon.record.layout import MAGIC
from mkdaemon.record.reader import Recording
from mkdaemon.record.scan import Record, ScannedChunk, Scanner, records_in


def packed(record):
    return struct.pack("<BQ", record.opcode, len(record.content)) + record.content


def pieces():
    """Head, channels and messages of a recording."""
    content = (RECORDINGS / "fc_sticks.mcap").read_bytes()
    parts = list(Scanner(io.BytesIO(content), len(content)).records())
    heads = [part for part in parts if isinstance(part, Record) and part.opcode in {Opcode.HEADER, Opcode.METADATA}]
    inside = list(records_in(next(part for part in parts if isinstance(part, ScannedChunk)).content()))
    channels = [one for one in inside if one.opcode == Opcode.CHANNEL]
    return (
        MAGIC + b"".join(packed(head) for head in heads),
        channels,
        [one for one in inside if one.opcode == Opcode.MESSAGE],
    )


def test_channels_that_every_chunk_repeats_are_read_once(tmp_path, monkeypatch):
    head, channels, messages = pieces()
    path = tmp_path / "small.mcap"
    path.write_bytes(head + b"".join(rebuilt([*channels, message]) for message in messages[:200]))
    calls = []
    honest = reader.read_channel
    monkeypatch.setattr(reader, "read_channel", lambda content: calls.append(1) or honest(content))
    assert len(list(Recording(path).entries())) == 200
    assert len(calls) <= len(channels)


def test_a_channel_that_is_defined_again_in_another_way_holds_from_there_on(tmp_path):
    head, channels, messages = pieces()
    number = messages[0].content[:2]
    (first,) = (one for one in channels if one.content[:2] == number)
    other = next(one for one in channels if one.content[:2] != number)
    renamed = Record(first.opcode, number + other.content[2:])
    path = tmp_path / "again.mcap"
    path.write_bytes(head + b"".join(rebuilt([one, messages[0]]) for one in (first, renamed, first)))
    kinds = [(entry.kind, entry.suffix) for entry in Recording(path).entries()]
    assert kinds[0] == kinds[2] != kinds[1]
