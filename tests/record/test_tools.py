"""Recordings looked at, recovered, cut and joined."""

from __future__ import annotations

import io
from dataclasses import replace

import msgpack
import pytest
from mcap.reader import make_reader

from mkdaemon.bus.schema import schema_json
from mkdaemon.errors import ConfigError, MkError
from mkdaemon.record.entry import HOLDER, STRANGER, EntryKind
from mkdaemon.record.reader import Recording, matches_any
from mkdaemon.record.rewrite import Selection, cut, merge, recover
from mkdaemon.record.summary import glance, summarise
from mkdaemon.record.view import JsonView
from mkdaemon.record.writer import RecordingWriter
from tests.record.support import BASE, SESSION, sample

ENTRIES = [sample(number // 2 + 1, f"mk/mk1/state/{number % 2}") for number in range(200)]


def written(path, entries=ENTRIES, session=SESSION, *, finish=True):
    output = io.BytesIO()
    writer = RecordingWriter(output, session)
    for number, entry in enumerate(entries, 1):
        writer.add(entry)
        if number % 20 == 0:
            writer.flush()
    if finish:
        writer.finish()
    path.write_bytes(output.getvalue())
    return path


def read(path):
    return list(Recording(path).entries())


def test_a_summary_counts_keys_gaps_losses_and_marks(tmp_path):
    mark = sample(1, "mk/mk1/event/mark")._replace(payload=msgpack.packb({"text": "here"}), received=1001.5)
    strange = sample(2, "mk/mk1/event/mark")._replace(payload=b"\xc1", received=1001.6)
    entries = [*ENTRIES[:100], mark, strange, *ENTRIES[120:]]
    seen = []
    summary = summarise(written(tmp_path / "a.mcap", entries), seen.append)

    first = summary.keys[EntryKind.SAMPLE, "mk/mk1/state/0"]
    assert (first.count, first.lost, first.encoding) == (90, 10, "application/msgpack;mk.Attitude.v1")
    assert first.rate == pytest.approx(89 / (99 / 50))
    assert first.longest_gap == pytest.approx(11 / 50)
    assert [(mark.text, mark.vehicle) for mark in summary.marks] == [("here", "mk1"), ("?", "mk1")]
    assert summary.duration == pytest.approx(99 / 50)
    assert summary.vehicles == ["mk1"]
    assert summary.session == SESSION
    assert seen
    assert summarise(written(tmp_path / "b.mcap", ENTRIES[:1])).keys[EntryKind.SAMPLE, "mk/mk1/state/0"].rate == 0.0


def test_what_never_reached_the_recorder_is_told_by_the_counts_of_the_daemon(tmp_path):
    def counts(number, total):
        payload = msgpack.packb({"counts": {"state/0": total, "state/9": 7 * total}})
        return sample(number, "mk/mk1/bus/counts")._replace(payload=payload, received=1000.0 + number)

    entries = [counts(1, 100), *(sample(number, "mk/mk1/state/0") for number in range(60, 70)), counts(2, 113)]
    summary = summarise(written(tmp_path / "a.mcap", entries))

    assert summary.missed == {"mk/mk1/state/0": 3}  # state/9 was not recorded at all
    assert summary.report.is_whole


def entry_at(kind, suffix, number, at=None, *, fields=None, **more):
    """An entry of a key, with fields as its payload, at a time after the begin [s]."""
    made = sample(number, f"mk/mk1/{suffix}", kind=kind)._replace(payload=msgpack.packb(fields or {}), **more)
    return made if at is None else made._replace(received=1000.0 + at)


def test_a_summary_tells_who_sent_what_and_what_was_refused(tmp_path):
    refused = {"key": "setpoint/stick", "sequence": 2, "token": "not_holder", "reason": "..."}
    taken = {"action": "take", "holder": "pilot"}
    entries = [
        entry_at(EntryKind.QUERY, "do/lease", 1, exchange=1, source="aa", fields=taken),
        entry_at(EntryKind.REPLY, "do/lease", 1, exchange=1, fields={"status": "accepted"}),
        entry_at(EntryKind.SETPOINT, "setpoint/stick", 1, source="aa", issuer=HOLDER),
        entry_at(EntryKind.SETPOINT, "setpoint/stick", 2, source="bb", issuer=STRANGER),
        entry_at(EntryKind.NOTICE, "notice/setpoint_refused", 1, fields=refused),
        entry_at(EntryKind.NOTICE, "notice/setpoint_refused", 2, fields={**refused, "sequence": 7}),
        entry_at(EntryKind.QUERY, "do/mark", 1, exchange=2, fields={"text": "x"}),
        entry_at(EntryKind.REPLY, "do/mark", 1, exchange=2, fields={"status": "invalid"}),
        entry_at(EntryKind.REPLY, "do/mark", 2, exchange=9)._replace(payload=b"\xc1"),
    ]
    pilot, stranger, silent = summarise(written(tmp_path / "a.mcap", entries)).senders.found.values()
    assert (pilot.source, pilot.names, pilot.setpoints, pilot.signed) == ("aa", {"pilot"}, 1, 1)
    assert (pilot.requests, pilot.requests_refused, pilot.setpoints_refused) == (1, 0, {})
    assert (stranger.source, stranger.signed, stranger.setpoints_refused) == ("bb", 0, {"not_holder": 1})
    assert (silent.source, silent.requests, silent.requests_refused) == ("", 1, 1)


@pytest.mark.parametrize(("after", "late", "refused"), [(0.1, 1, {}), (0.9, 0, {"not_leased": 1})])
def test_a_setpoint_that_was_under_way_at_the_end_of_a_flight_is_no_refusal(tmp_path, after, late, refused):
    words = {"key": "setpoint/land", "sequence": 2, "token": "not_leased", "reason": "..."}
    entries = [
        entry_at(EntryKind.SETPOINT, "setpoint/land", 1, 0.0, source="aa", issuer=HOLDER),
        entry_at(EntryKind.SETPOINT, "setpoint/land", 2, after, source="aa", issuer=STRANGER),
        entry_at(EntryKind.NOTICE, "notice/setpoint_refused", 1, after, fields=words),
    ]
    (pilot,) = summarise(written(tmp_path / "a.mcap", entries)).senders.found.values()
    assert (pilot.setpoints_late, pilot.setpoints_refused) == (late, refused)


@pytest.mark.parametrize("share", [0.3, 0.55, 1.0])
def test_recovering_a_file_that_was_cut_off_gives_a_whole_one_with_the_same_entries(tmp_path, share):
    whole = written(tmp_path / "a.mcap", finish=share < 1.0)
    damaged = tmp_path / "b.mcap"
    damaged.write_bytes(whole.read_bytes()[: int(share * whole.stat().st_size)])
    before = damaged.read_bytes()

    result = recover(damaged, tmp_path / "c.mcap")

    found = Recording(tmp_path / "c.mcap")
    assert list(found.entries()) == ENTRIES[: result.entries]
    assert result.entries > 20
    assert found.report.is_whole
    assert found.session == SESSION
    assert not result.reports[0].is_whole
    assert damaged.read_bytes() == before


def test_nothing_is_overwritten_unasked(tmp_path):
    source, target = written(tmp_path / "a.mcap"), tmp_path / "b.mcap"
    target.write_bytes(b"mine")
    for write in (
        lambda: recover(source, target),
        lambda: cut(source, target, Selection()),
        lambda: merge([source], target),
    ):
        with pytest.raises(ConfigError, match="--force"):
            write()
    assert target.read_bytes() == b"mine"
    assert recover(source, target, overwrite=True).entries == 200


def test_cutting_takes_a_time_and_some_keys(tmp_path):
    source = written(tmp_path / "a.mcap")
    times = [BASE.file_time(entry.received) for entry in ENTRIES]
    selection = Selection(lambda facts: facts.key.endswith("1"), times[51], times[99])

    result = cut(source, tmp_path / "b.mcap", selection, view=JsonView(schema_json))

    assert read(tmp_path / "b.mcap") == ENTRIES[51:100:2]
    assert result.entries == 25
    session = Recording(tmp_path / "b.mcap").read_session()
    assert (session.recorder, session.name) == ("cut", SESSION.name)
    with (tmp_path / "b.mcap").open("rb") as file:
        topics = {channel.topic for _, channel, _ in make_reader(file).iter_messages()}
    assert topics == {"mk/mk1/state/1", "sample:mk/mk1/state/1"}
    with pytest.raises(MkError, match="none is selected"):
        cut(source, tmp_path / "c.mcap", Selection(last=times[0] - 1))


def test_joining_orders_by_time_and_keeps_every_entry(tmp_path):
    one = written(tmp_path / "1.mcap", ENTRIES[:80])
    two = written(tmp_path / "2.mcap", ENTRIES[80:], replace(SESSION, part=1))
    other = [entry._replace(key=entry.key.replace("mk1", "mk2")) for entry in ENTRIES]
    three = written(tmp_path / "3.mcap", other, replace(SESSION, name="other", vehicle="mk2"))

    assert merge([two, one], tmp_path / "a.mcap").entries == 200
    assert read(tmp_path / "a.mcap") == ENTRIES
    assert Recording(tmp_path / "a.mcap").read_session().vehicle == "mk1"
    with pytest.raises(ConfigError, match="the same part"):
        merge([one, written(tmp_path / "again.mcap", ENTRIES[:80])], tmp_path / "b.mcap")
    merge([one, two, three], tmp_path / "b.mcap")
    joined = Recording(tmp_path / "b.mcap")
    found = list(joined.entries())
    assert [entry for entry in found if entry.vehicle == "mk1"] == ENTRIES
    assert [entry.received for entry in found] == sorted(entry.received for entry in found)
    assert (joined.session.recorder, joined.session.vehicle) == ("merge", "")
    assert joined.report.is_whole


def test_a_glance_tells_times_and_whether_a_file_is_finished(tmp_path):
    seen = glance(written(tmp_path / "a.mcap"))
    assert seen.is_finished
    assert seen.duration == pytest.approx(99 / 50)
    assert seen.session == SESSION
    whole = (tmp_path / "a.mcap").read_bytes()
    for content in (whole[:-1], whole[:200], b"", whole[:-30] + b"\xff" * 14 + whole[-16:], whole[:-60] + whole[-37:]):
        (tmp_path / "b.mcap").write_bytes(content)
        assert not glance(tmp_path / "b.mcap").is_finished or content != whole[:-1]
    assert glance(tmp_path / "b.mcap").size == len(whole) - 23
    (tmp_path / "c.mcap").write_bytes(whole[:-1])
    assert (glance(tmp_path / "c.mcap").is_finished, glance(tmp_path / "c.mcap").duration) == (False, None)


@pytest.mark.parametrize(
    ("pattern", "is_matched"),
    [
        ("**", True),
        ("mk/*/state/gps", True),
        ("state/*", True),
        ("state/g*", True),
        ("*/gps", True),
        ("state", False),
        ("state/gps/x", False),
        ("stat./gps", False),
    ],
)
def test_patterns_are_those_of_zenoh(pattern, is_matched):
    assert matches_any("mk/mk1/state/gps", [pattern]) is is_matched
    assert matches_any("mk/mk1/state/gps", [])
