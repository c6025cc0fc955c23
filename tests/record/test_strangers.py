"""Recordings that other programs wrote, and those that somebody made to harm: checksums are right, contents are not."""

from __future__ import annotations

import io
import struct
from pathlib import Path
from typing import Any

import pytest
from mcap.opcode import Opcode
from mcap.writer import CompressionType

from lab.files.originals import RECORDINGS
from lab.files.recordings import rebuilt, rewritten
from mkdaemon.cli.mkctl.app import app as mkctl
from mkdaemon.cli.program import run
from mkdaemon.errors import MkError
from mkdaemon.record import reader, rewrite, scan
from mkdaemon.record.entry import LATEST
from mkdaemon.record.layout import MAGIC, ChannelFacts, Session
from mkdaemon.record.reader import Recording
from mkdaemon.record.scan import Record, ScannedChunk, Scanner, records_in
from mkdaemon.record.summary import summarise
from mkdaemon.record.writer import RecordingWriter
from tests.effort import calls_of
from tests.record.support import BASE, SESSION, sample


def recording(path, entries, *, then=lambda writer: None, session=SESSION):
    """A finished recording of entries, and of what is done to its writer behind them."""
    with path.open("wb") as file:
        writer = RecordingWriter(file, session)
        for entry in entries:
            writer.add(entry)
        then(writer)
        writer.finish()
    return path


@pytest.mark.parametrize("at", [1, LATEST + 1, (1 << 64) - 1])
@pytest.mark.parametrize("which", ["log", "publish"])
def test_a_time_of_another_age_is_unreadable(tmp_path, at, which):
    good = BASE.offset_ns + 10**12
    times = (at, good) if which == "log" else (good, at)
    source = recording(tmp_path / "a.mcap", [sample(1)], then=lambda one: one._chunk.add(1, 2, *times, b"x"))
    for words in (("repair",), ("cut", "--from", "0"), ("cut", "--to", "-0"), ("merge",)):
        target = tmp_path / f"{'-'.join(words)}.mcap"
        assert run(mkctl, ["log", words[0], str(source), "-o", str(target), *words[1:]]) == 0
        assert [one.sequence for one in Recording(target).entries()] == [1]
    assert summarise(source).report.unreadable == 1
    assert run(mkctl, ["log", "info", str(source)]) == 0


def test_a_clock_of_another_age_is_none_of_ours(tmp_path):
    facts = ChannelFacts.of(sample(1)).to_metadata()
    assert ChannelFacts.from_metadata(facts) is not None
    session = SESSION.to_metadata()
    for offset in ("9" * 19, "-" + "9" * 19, "9" * 400, "9" * 5000, "nan", "1.5", ""):
        assert ChannelFacts.from_metadata({**facts, "offset_ns": offset}) is None
        assert Session.from_metadata({**session, "offset_ns": offset}) is None


@pytest.mark.parametrize("key", ["mk/mk1/\0", "mk/mk1/\x1b[2J", "mk/mk1/a\n", "mk/\u202e/a", "mk/mk1/" + "a" * 300])
def test_a_key_that_no_bus_has_is_none_of_ours(tmp_path, key):
    path = recording(tmp_path / "a.mcap", [sample(1), sample(1, key)])
    found = Recording(path)
    assert [one.key for one in found.entries()] == [sample(1).key]
    assert found.report.foreign == 1


def add_empty(writer, count):
    for _ in range(count):
        writer._chunk.add(1, 2, BASE.offset_ns + 10**12, BASE.offset_ns + 10**12, b"")


def test_a_file_without_index_holds_no_millions_of_records(tmp_path, monkeypatch):
    monkeypatch.setattr(reader, "FREE_RECORDS", 1000)
    path = tmp_path / "a.mcap"
    with path.open("wb") as file:
        writer = RecordingWriter(file, SESSION)
        writer.add(sample(1))
        add_empty(writer, 50_000)
        file.write(writer._chunk.end())
    found = Recording(path)
    assert sum(1 for _ in found.entries()) < 1000 + path.stat().st_size < 20_000
    assert "more records than a file of this size can hold" in found.report.damages[0].reason


def test_very_many_keys_cost_no_more_than_their_number(tmp_path, capsys):
    calls = []
    for keys in (160, 320):
        path = tmp_path / f"{keys}.mcap"
        entries = [sample(1, f"mk/mk1/state/a{number}") for number in range(keys)]
        calls.append(calls_of(lambda path=path, entries=entries: recording(path, entries)))
        calls.append(calls_of(lambda path=path: run(mkctl, ["log", "info", str(path)])))
    assert calls[2] < 2.5 * calls[0]
    assert calls[3] < 2.5 * calls[1]
    shown = capsys.readouterr().out
    assert "... and 20 more keys; --json has them all" in shown
    assert len(shown.splitlines()) < 500


def test_more_keys_than_a_file_can_have_are_told(tmp_path, monkeypatch):
    monkeypatch.setattr("mkdaemon.record.writer.MOST_CHANNELS", 50)
    path = recording(tmp_path / "a.mcap", [sample(1, f"mk/mk1/state/a{number}") for number in range(60)])
    with pytest.raises(MkError, match="too many keys for one file; take some of them, with `mkctl log cut --key`"):
        rewrite.recover(path, tmp_path / "b.mcap")
    assert not (tmp_path / "b.mcap").exists()


PRIVATE = struct.pack("<BQ", 0x91, 60) + bytes(60)


@pytest.fixture
def source(tmp_path: Path) -> Path:
    """A recording of 39 samples."""
    return recording(tmp_path / "a.mcap", [sample(number) for number in range(1, 40)])


def written_again(source: Path, **how: Any) -> Path:
    """A recording as the writer of the MCAP project has it."""
    target = source.with_name("b.mcap")
    target.write_bytes(rewritten(source.read_bytes(), **how))
    return target


@pytest.mark.parametrize(
    "way",
    [
        {"use_chunking": False},
        {"compression": CompressionType.LZ4},
        {"compression": CompressionType.NONE},
        {"chunk_size": 100},
        {"chunk_size": 1 << 30},
    ],
    ids=["no chunks", "lz4", "not compressed", "small chunks", "one chunk"],
)
def test_what_another_writer_wrote_is_whole(source: Path, way: dict[str, Any]) -> None:
    found, ours = Recording(written_again(source, **way)), list(Recording(source).entries())
    assert list(found.entries()) == ours and len(ours) == 39
    assert found.report.is_whole, found.report.damages
    times = [at for _, at in found.times()]
    assert list(found.entries(first=times[20], last=times[20])) == ours[20:21], "the second reading goes by places"
    target = source.with_name("c.mcap")
    assert run(mkctl, ["log", "repair", str(found.path), "-o", str(target)]) == 0
    assert list(Recording(target).entries()) == ours


def test_records_of_an_application_are_stepped_over(source: Path) -> None:
    raw = source.read_bytes()
    source.write_bytes(raw[:8] + PRIVATE + raw[8:])
    found = Recording(source)
    assert len(list(found.entries())) == 39 and found.report.is_whole


def test_a_chunk_of_a_whole_file_is_read_up_to_a_limit_that_is_named(tmp_path: Path, monkeypatch: Any) -> None:
    entries = [sample(number, size=1 << 20) for number in range(1, 41)]
    large = written_again(recording(tmp_path / "a.mcap", entries), chunk_size=1 << 30)
    found = Recording(large)
    assert sum(1 for _ in found.entries()) == 40 and found.report.is_whole
    monkeypatch.setattr(scan, "MOST_CHUNK_BYTES", 1 << 25)
    found = Recording(large)
    assert list(found.entries()) == []
    assert "MiB (mcap compress writes small ones)" in found.report.damages[0].reason


def test_an_unknown_compression_is_not_called_damage_alone(source: Path) -> None:
    source.write_bytes(source.read_bytes().replace(b"\x04\0\0\0zstd", b"\x04\0\0\0brot"))
    found = Recording(source)
    assert list(found.entries()) == []
    assert "compression 'brot' is not supported; convert it: mcap compress" in found.report.damages[0].reason


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
