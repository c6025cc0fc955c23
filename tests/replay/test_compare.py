"""Two values that should be one: found by their stamps, compared field by field, within what a table admits."""

from __future__ import annotations

import msgpack
import pytest

from mkdaemon.record.entry import Entry, EntryKind, Notice, TimeBase
from mkdaemon.record.layout import Session
from mkdaemon.replay.compare import Comparison, KeyReport, ReplayDifference, ReplayOutput, compare
from mkdaemon.replay.recorded import Recorded
from mkdaemon.replay.report import ReplayReport
from mkdaemon.replay.tolerances import admits

BASE = TimeBase("", 0)


def packed(value, at=1.0):
    return msgpack.packb({"stamp": {"monotonic": at}, "value": value})


def compared(before, after, key="state/gps", kind=EntryKind.SAMPLE, encoding="x"):
    """What differs between payloads."""
    entries = [Entry(kind, f"mk/t/{key}", payload, "x", 1.0, 0.0, BASE, 1) for payload in before]
    entries.append(Entry(EntryKind.NOTICE, f"mk/t/{Notice.STOP.suffix}", b"", "", 9.0, 0.0, BASE, 1))
    session = Session("blackbox", "flight", 0, "mkdaemon", "lab", "", 0, "t", "")
    outputs = [ReplayOutput(kind, key, payload, encoding, 1.0) for payload in after]
    (report,) = compare(Recorded(session, entries), outputs).keys.values()
    return report


def test_values_are_found_by_their_stamps():
    report = compared(
        [packed(1, 1.0), packed(2, 2.0), packed(3, 3.0)], [packed(2, 2.0), packed(4, 3.0), packed(5, 4.0)]
    )
    assert (report.missing, report.differing, report.new) == (1, 1, 1)
    assert report.fields == {"value": 1}
    assert report.first.replayed == "(absent)"


def test_what_the_core_answered_is_compared_as_values_are():
    report = compared([b"\x01", b"\x02"], [b"\x01", b"\x03"], "core/LeaseAsked", EntryKind.EVENT)
    assert (report.key, report.differing, report.fields) == ("core/LeaseAsked", 1, {"": 1})


@pytest.mark.parametrize(
    ("before", "after", "fields"),
    [
        ({"a": [1, 2]}, {"a": [1, 3]}, {"value.a.1"}),
        ({"a": [1, 2]}, {"a": [1]}, {"value.a"}),
        ({"a": 1}, {"b": 1}, {"value.a", "value.b"}),
        ({1: 1}, {1: 2}, {"value.1"}),
        (1, 1.0, {"value"}),
    ],
)
def test_a_difference_is_named_by_its_field(before, after, fields):
    assert compared([packed(before)], [packed(after)]).fields.keys() == fields


def test_another_schema_is_a_difference():
    assert compared([packed(1)], [packed(1)], encoding="y").fields == {"(encoding)": 1}


@pytest.mark.parametrize(
    ("key", "field", "recorded", "replayed", "is_admitted"),
    [
        ("control/estimate", "position.0", 1.0, 1.0 + 5e-8, True),
        ("control/estimate", "position.0", 1.0, 1.0 + 5e-7, False),
        ("state/attitude", "quaternion.0", 0.6940141018708658, 0.6940141018708659, True),
        ("state/attitude", "quaternion.0", 0.694014, 0.694014 * (1 + 1e-6), False),
        ("control/estimate", "target", "pad", "mat", False),
        ("control/estimate", "is_good", True, 1.0, False),
        ("control/output", "pitch", 12, 13, False),
        ("control/output", "stamp.monotonic", 12.0, 12.000001, False),
        ("control/output", "stamp.wall", 12.0, 12.0005, True),
        ("control/preflight", "findings.3.reason", "79.4 GB free", "79.3 GB free", False),
        ("control/output", "stamp.boot", "a1", "b2", True),
    ],
)
def test_bytes_integers_and_words_are_equal_and_floats_nearly(key, field, recorded, replayed, is_admitted):
    assert admits(key, field, recorded, replayed) is is_admitted


def test_a_report_tells_the_fields_that_differ_most_and_the_first_value():
    first = ReplayDifference(0.5, "value", "x" * 200, 2)
    keys = {"state/gps": KeyReport("state/gps", 9, 9, 9, fields=dict.fromkeys("abcdefgh", 2), first=first)}
    report = ReplayReport("flight", "mkdaemon", 1.0, Comparison(keys, {}), ())
    words = "\n".join(report.lines())
    assert "a (2), b (2), c (2), d (2), e (2), f (2), 2 more" in words
    assert "xxx... recorded, 2 replayed" in words
    assert report.as_map()["keys"]["state/gps"]["first"]["at"] == 0.5
    new = KeyReport("state/gps", new=1, first=ReplayDifference(0.5, "", "(absent)", 2))
    bare = ReplayReport(
        "flight", "mkdaemon", 1.0, Comparison({"state/gps": new, "health": KeyReport("health", new=1)}, {}), ()
    )
    assert "first at 0.500 s: '(absent)' recorded" in "\n".join(bare.lines())
