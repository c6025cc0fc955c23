"""What was written is read back exactly, whatever is cut off or changed."""

from __future__ import annotations

import io
import struct
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mkdaemon.record.entry import Congestion, Entry, EntryKind, Qos, TimeBase
from mkdaemon.record.layout import ChannelFacts
from mkdaemon.record.reader import Recording
from mkdaemon.record.writer import RecordingWriter
from tests.record.support import BASE, SESSION, sample


class Sink(io.BytesIO):
    """Remembers where every piece that was handed over ends."""

    def __init__(self) -> None:
        super().__init__()
        self.ends: list[int] = []

    def write(self, data: bytes, /) -> int:  # type: ignore[override]
        written = super().write(data)
        self.ends.append(self.tell())
        return written


def write(entries: list[Entry], *, every: int = 50, finish: bool = True) -> Sink:
    sink = Sink()
    writer = RecordingWriter(sink, SESSION)
    for number, entry in enumerate(entries, 1):
        writer.add(entry)
        if number % every == 0:
            writer.flush()
    if finish:
        writer.finish()
    else:
        writer.flush()
    return sink


def read(path: Path, raw: bytes) -> tuple[list[Entry], Recording]:
    path.write_bytes(raw)
    recording = Recording(path)
    return list(recording.entries()), recording


MIXED = [
    sample(1),
    sample(1, "mk/mk1/setpoint/stick", kind=EntryKind.SETPOINT)._replace(
        attachment=b"\x01" * 32, qos=Qos(Congestion.BLOCK, 2, True)
    ),
    sample(1, "mk/mk1/do/lease", kind=EntryKind.QUERY)._replace(exchange=7),
    sample(1, "mk/mk1/do/lease", kind=EntryKind.REPLY)._replace(exchange=7),
    Entry(EntryKind.PORT_READ, "mk/mk1/port", b"#bX\r", "", 1000.25, 1_760_001_000.75, BASE, 1),
    Entry(EntryKind.PORT_WRITTEN, "mk/mk1/port", b"\x1b\x1b", "", 1000.5, 1_760_001_001.0, BASE, 1, issuer="release"),
    sample(2)._replace(base=TimeBase("89abcdef", 5)),
]


def test_entries_come_back_as_they_went_in(tmp_path: Path) -> None:
    entries, recording = read(tmp_path / "a.mcap", write(MIXED).getvalue())

    assert entries == MIXED
    assert recording.session == SESSION
    assert recording.report.is_whole
    assert recording.report.entries == len(MIXED)


def test_a_file_cut_off_anywhere_keeps_all_that_was_flushed(tmp_path: Path) -> None:
    sink = write([sample(number) for number in range(1, 201)], every=20)
    raw = sink.getvalue()
    flushed = [end for end in sink.ends if end > 300][:10]
    for cut in [*range(0, len(raw), 97), *flushed, *(end - 1 for end in flushed)]:
        entries, recording = read(tmp_path / "a.mcap", raw[:cut])

        assert len(entries) >= 20 * sum(end <= cut for end in flushed)
        assert [entry.sequence for entry in entries] == list(range(1, len(entries) + 1))
        assert not recording.report.is_complete
        assert recording.report.damages


WHOLE = write([sample(number, f"mk/mk1/state/{number % 5}") for number in range(1, 201)], every=20).getvalue()


@given(st.lists(st.tuples(st.integers(0, len(WHOLE) - 1), st.integers(1, 255)), min_size=1, max_size=4), st.data())
def test_changed_bytes_cost_the_chunks_they_are_in_and_nothing_else(
    tmp_path_factory: pytest.TempPathFactory, changes: list[tuple[int, int]], data: st.DataObject
) -> None:
    raw = bytearray(WHOLE)
    for place, change in changes:
        raw[place] ^= change
    cut = data.draw(st.integers(0, len(raw)) | st.just(len(raw)))
    entries, recording = read(tmp_path_factory.mktemp("x") / "a.mcap", bytes(raw[:cut]))

    assert all(entry in ENTRIES for entry in entries)
    if cut == len(raw):
        assert len(entries) + recording.report.orphans >= 200 - 20 * len(changes)
        assert len(entries) == 200 or recording.report.damages


ENTRIES = [sample(number, f"mk/mk1/state/{number % 5}") for number in range(1, 201)]


def test_places_that_only_look_like_a_chunk_are_passed_over(tmp_path: Path) -> None:
    places = [
        struct.pack("<BQ", 6, 40) + bytes(40),
        struct.pack("<BQQQQII", 6, 60, 0, 0, 9, 1, 4) + b"zstd" + struct.pack("<Q", 12) + bytes(12),
        struct.pack("<BQQQQII", 6, 60, 0, 0, 9, 1, 99) + bytes(40),
        struct.pack("<BQQQQII", 6, 60, 0, 0, 9, 0, 4) + b"zstd" + struct.pack("<Q", 16) + bytes(16),
    ]
    entries, recording = read(tmp_path / "a.mcap", b"".join(places) * 20 + WHOLE[8:])
    assert entries == ENTRIES
    assert len(recording.report.damages) == 1
    assert not read(tmp_path / "a.mcap", b"".join(places))[0]


@given(st.binary(max_size=400))
def test_no_bytes_raise(tmp_path_factory: pytest.TempPathFactory, raw: bytes) -> None:
    for head in (b"", b"\x89MCAP0\r\n", WHOLE[:500]):
        read(tmp_path_factory.mktemp("x") / "a.mcap", head + raw)


def test_channels_that_were_lost_are_found_later_in_the_file(tmp_path: Path) -> None:
    entries = [sample(number, f"mk/mk1/state/{number % 5}") for number in range(1, 1201)]
    sink = write(entries, every=50)
    raw = bytearray(sink.getvalue())
    raw[sink.ends[1] + 60] ^= 1  # in the first chunk, which defines the channels

    found, recording = read(tmp_path / "a.mcap", bytes(raw))

    assert found == entries[50:]
    assert recording.report.orphans == 0
    assert [damage.reason.partition(":")[0] for damage in recording.report.damages] == ["a chunk is damaged"]


def test_missing_sequence_numbers_are_counted(tmp_path: Path) -> None:
    entries = [sample(number) for number in (1, 2, 5, 6, 9)]

    _, recording = read(tmp_path / "a.mcap", write(entries).getvalue())

    assert recording.report.gaps == {(EntryKind.SAMPLE, "mk/mk1/state/attitude"): 4}
    assert recording.report.lost == 4
    assert not recording.report.is_whole


def test_a_reading_can_be_limited_by_time_and_channel(tmp_path: Path) -> None:
    entries = [sample(number, f"mk/mk1/state/{number % 2}") for number in range(1, 101)]
    path = tmp_path / "a.mcap"
    path.write_bytes(write(entries, every=10).getvalue())
    recording = Recording(path)

    def wanted(facts: ChannelFacts) -> bool:
        return facts.key.endswith("1")

    times = [BASE.file_time(entry.received) for entry in entries]
    assert list(recording.entries(wanted)) == entries[::2]
    assert list(recording.entries(first=times[20], last=times[29])) == entries[20:30]
