"""Valid MCAP as other programs write it: without chunks, compressed otherwise, with records of their own."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any

import pytest
from mcap.writer import CompressionType

from lab.files.recordings import rewritten
from mkdaemon.cli.mkctl.app import app as mkctl
from mkdaemon.cli.program import run
from mkdaemon.record import scan
from mkdaemon.record.reader import Recording
from tests.record.support import sample
from tests.record.test_strangers import recording

PRIVATE = struct.pack("<BQ", 0x91, 60) + bytes(60)


def written_again(source: Path, target: Path, **how: Any) -> Path:
    """A recording as the writer of the MCAP project has it."""
    target.write_bytes(rewritten(source.read_bytes(), **how)[0])
    return target


WAYS: dict[str, dict[str, Any]] = {
    "no chunks": {"use_chunking": False},
    "lz4": {"compression": CompressionType.LZ4},
    "not compressed": {"compression": CompressionType.NONE},
    "small chunks": {"chunk_size": 100},
    "one chunk": {"chunk_size": 1 << 30},
}


@pytest.mark.parametrize("way", WAYS)
def test_what_another_writer_wrote_is_whole(tmp_path: Path, way: str) -> None:
    source = recording(tmp_path / "a.mcap", [sample(number) for number in range(1, 40)])
    found = Recording(written_again(source, tmp_path / "b.mcap", **WAYS[way]))
    ours = list(Recording(source).entries())
    assert list(found.entries()) == ours and len(ours) == 39
    assert found.report.is_whole, found.report.damages
    times = [at for _, at in found.times()]
    assert list(found.entries(first=times[20], last=times[20])) == ours[20:21], "the second reading goes by places"
    target = tmp_path / "c.mcap"
    assert run(mkctl, ["log", "repair", str(found.path), "-o", str(target)]) == 0
    assert list(Recording(target).entries()) == ours


def test_records_of_an_application_are_stepped_over(tmp_path: Path) -> None:
    source = recording(tmp_path / "a.mcap", [sample(number) for number in range(1, 40)])
    raw = source.read_bytes()
    path = tmp_path / "b.mcap"
    path.write_bytes(raw[:8] + PRIVATE + raw[8:])
    found = Recording(path)
    assert len(list(found.entries())) == 39 and found.report.is_whole


def test_a_chunk_whose_opcode_was_damaged_is_no_record_of_an_application(tmp_path: Path) -> None:
    source = recording(tmp_path / "a.mcap", [sample(number) for number in range(1, 40)])
    raw = bytearray(source.read_bytes())
    at = 8
    while raw[at] != 6:
        at += 9 + int.from_bytes(raw[at + 1 : at + 9], "little")
    raw[at] |= 0x80
    source.write_bytes(raw)
    found = Recording(source)
    assert list(found.entries()) == [] and found.report.damages


def test_a_chunk_of_a_whole_file_is_read_up_to_a_limit_that_is_named(tmp_path: Path, monkeypatch: Any) -> None:
    entries = [sample(number, size=1 << 20) for number in range(1, 41)]
    large = written_again(recording(tmp_path / "a.mcap", entries), tmp_path / "b.mcap", chunk_size=1 << 30)
    found = Recording(large)
    assert sum(1 for _ in found.entries()) == 40 and found.report.is_whole
    monkeypatch.setattr(scan, "MOST_CHUNK_BYTES", 1 << 25)
    found = Recording(large)
    assert list(found.entries()) == []
    assert "MiB (mcap compress writes small ones)" in found.report.damages[0].reason


def test_an_unknown_compression_is_not_called_damage_alone(tmp_path: Path) -> None:
    source = recording(tmp_path / "a.mcap", [sample(number) for number in range(1, 40)])
    raw = source.read_bytes().replace(b"\x04\0\0\0zstd", b"\x04\0\0\0brot")
    source.write_bytes(raw)
    found = Recording(source)
    assert list(found.entries()) == []
    assert "compression 'brot' is not supported; convert it: mcap compress" in found.report.damages[0].reason
