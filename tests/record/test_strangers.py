"""Recordings that somebody made to harm: their checksums are right, and what they say is not."""

from __future__ import annotations

from dataclasses import replace

import msgpack
import pytest

from mkdaemon.cli.mkctl.app import app as mkctl
from mkdaemon.cli.program import run
from mkdaemon.errors import MkError
from mkdaemon.record import reader, rewrite
from mkdaemon.record.entry import LATEST, unpacked
from mkdaemon.record.layout import ChannelFacts, Session
from mkdaemon.record.reader import Recording
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


@pytest.mark.parametrize("at", [0, 1, LATEST + 1, (1 << 63) - 1, 1 << 63, (1 << 64) - 1])
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


def test_a_small_file_holds_no_millions_of_records(tmp_path, monkeypatch):
    monkeypatch.setattr(reader, "FREE_RECORDS", 1000)

    def repeat(writer):
        for _ in range(3):
            for _ in range(20_000):
                writer._chunk.add(1, 2, BASE.offset_ns + 10**12, BASE.offset_ns + 10**12, b"")
            writer.flush()

    found = Recording(recording(tmp_path / "a.mcap", [sample(1)], then=repeat))
    size = found.path.stat().st_size
    entries = sum(1 for _ in found.entries())
    assert entries < 20_000 + size  # the index alone has 16 bytes for each: nothing of ours is cut
    whole = Recording(recording(tmp_path / "b.mcap", [sample(number) for number in range(1, 5000)]))
    assert sum(1 for _ in whole.entries()) == 4999
    assert whole.report.is_whole


def test_a_file_without_index_holds_no_millions_of_records(tmp_path, monkeypatch):
    monkeypatch.setattr(reader, "FREE_RECORDS", 1000)
    path = tmp_path / "a.mcap"
    with path.open("wb") as file:
        writer = RecordingWriter(file, SESSION)
        writer.add(sample(1))
        for _ in range(50_000):
            writer._chunk.add(1, 2, BASE.offset_ns + 10**12, BASE.offset_ns + 10**12, b"")
        file.write(writer._chunk.end())
    found = Recording(path)
    assert sum(1 for _ in found.entries()) < 1000 + path.stat().st_size < 20_000
    assert "more records than a file of this size can hold" in found.report.damages[0].reason


def test_very_many_keys_cost_no_more_than_their_number(tmp_path, capsys):
    calls = []
    for keys in (350, 700):
        path = tmp_path / f"{keys}.mcap"
        entries = [sample(1, f"mk/mk1/state/a{number}") for number in range(keys)]
        calls.append(calls_of(lambda path=path, entries=entries: recording(path, entries)))
        calls.append(calls_of(lambda path=path: run(mkctl, ["log", "info", str(path)])))
    assert calls[2] < 2.5 * calls[0]
    assert calls[3] < 2.5 * calls[1]
    shown = capsys.readouterr().out
    assert "... and 50 more keys; --json has them all" in shown
    assert "... and 400 more keys; --json has them all" in shown
    assert len(shown.splitlines()) < 640


def test_more_keys_than_a_file_can_have_are_told(tmp_path, monkeypatch):
    monkeypatch.setattr("mkdaemon.record.writer.MOST_CHANNELS", 50)
    path = recording(tmp_path / "a.mcap", [sample(1, f"mk/mk1/state/a{number}") for number in range(60)])
    with pytest.raises(MkError, match="too many keys for one file; take some of them, with `mkctl log cut --key`"):
        rewrite.recover(path, tmp_path / "b.mcap")
    assert not (tmp_path / "b.mcap").exists()


@pytest.mark.parametrize(
    "payload",
    [b"", b"\xff", b"\x91" * 5000, b"\x81\xa1a" * 5000, msgpack.packb([1]), msgpack.packb({1: 2}), b"\x81\x91\x01\x01"],
)
def test_what_is_no_map_with_names_says_nothing(payload):
    assert unpacked(payload) == {}
    entry = sample(1)._replace(payload=payload)
    assert entry.carried_stamp is None
    assert entry.stamp.monotonic == entry.received


def test_a_vehicle_of_no_name_is_recovered(tmp_path):
    path = recording(tmp_path / "a.mcap", [sample(1)], session=replace(SESSION, name="\x1b", vehicle="../../x"))
    assert rewrite.recover(path, tmp_path / "b.mcap").entries == 1
