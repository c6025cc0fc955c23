"""Recordings through today's code: behaviour that changes is seen here, by key and field."""

from __future__ import annotations

import json
import math
import sys
from dataclasses import replace
from importlib import import_module
from random import Random

import msgpack
import numpy as np
import pytest

from lab.places import ROOT
from mkdaemon.cli.mkdaemon.app import app
from mkdaemon.cli.program import run
from mkdaemon.control.events import NOTED, FrameNotSent
from mkdaemon.errors import ConfigError, MkError
from mkdaemon.protocol.fields import WireField
from mkdaemon.protocol.messages import OsdData5
from mkdaemon.record.entry import EntryKind
from mkdaemon.record.events import pack_event, unpack_event
from mkdaemon.record.reader import Recording
from mkdaemon.record.writer import RecordingWriter
from mkdaemon.replay.compare import compare
from mkdaemon.replay.recorded import Recorded, read_recorded
from mkdaemon.replay.report import verify
from mkdaemon.replay.run import replay
from mkdaemon.telemetry.refusals import Token, refuse
from tests.places import DATA
from tools.recordings import make

RECORDINGS = sorted((DATA / "recordings").glob("*.mcap"))
LOST_CLIENT = DATA / "recordings" / "nc_lost_client.mcap"
OVER_TARGET = DATA / "recordings" / "fc_over_target.mcap"
STICKS = DATA / "recordings" / "fc_sticks.mcap"


@pytest.fixture(scope="module")
def replayed():
    """Every recording with what comes out of it today."""
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(ROOT)
        recordings = [read_recorded([path]) for path in RECORDINGS]
        return [(recorded, replay(recorded, recorded.config).outputs) for recorded in recordings]


def test_todays_code_does_what_it_did_when_this_was_recorded(replayed):
    for recorded, outputs in replayed:
        found = compare(recorded, outputs)
        differing = {key: report.first for key, report in found.keys.items() if report.differences}
        assert differing == {}, "a change that is meant: python -m tools.recordings"
        assert found.compared > 300


LIBM = ("sin", "cos", "tan", "atan2", "asin", "acos", "exp", "log", "hypot")
"""What IEEE 754 does not round for every machine alike."""


def test_a_recording_verifies_with_the_libm_of_another_processor(monkeypatch):
    monkeypatch.chdir(ROOT)
    import_module("mkdaemon.vision.pipeline")  # whatever a replay imports later keeps its own names
    random = Random(1)
    modules = [module for name, module in sys.modules.items() if name.startswith("mkdaemon.")]
    for name in LIBM:
        own = getattr(math, name)

        def other(*args, own=own):
            return math.nextafter(own(*args), random.choice([float("-inf"), float("inf")]))

        for module in [math, *(module for module in modules if getattr(module, name, None) is own)]:
            monkeypatch.setattr(module, name, other)
    for name in ("sin", "cos", "tan", "arctan2", "exp", "log", "hypot"):
        own = getattr(np, name)
        monkeypatch.setattr(np, name, lambda *args, own=own, **more: np.nextafter(own(*args, **more), np.inf))
    report = verify([OVER_TARGET])
    assert report.is_equal, "\n".join(report.lines())


def test_what_is_recorded_now_comes_out_the_same(tmp_path):
    path = tmp_path / "now.mcap"
    make("nc_lost_client", tmp_path).write(path)
    report = verify([path])
    assert report.is_equal, "\n".join(report.lines())
    assert report.comparison.compared > 300


def test_a_changed_scale_factor_is_named_by_key_and_field(monkeypatch):
    wire, to_si = OsdData5.spec.wire("battery"), WireField.to_si
    monkeypatch.setattr(WireField, "to_si", lambda self, value: to_si(self, value) * (1.01 if self is wire else 1.0))
    report = verify([LOST_CLIENT])
    assert {key for key, found in report.comparison.keys.items() if found.differences} == {"state/battery"}
    battery = report.comparison.keys["state/battery"]
    assert battery.fields == {"voltage": battery.recorded}
    assert battery.first.replayed == pytest.approx(battery.first.recorded * 1.01)
    assert any("state/battery" in line for line in report.lines())


def written(path, entries, session=None):
    """A recording with other entries."""
    with path.open("wb") as file:
        writer = RecordingWriter(file, session or Recording(OVER_TARGET).read_session())
        for entry in entries:
            writer.add(entry)
        writer.finish()
    return path


def test_without_images_the_recorded_poses_are_flown_with(tmp_path, monkeypatch):
    monkeypatch.chdir(ROOT)
    entries = [entry for entry in Recording(OVER_TARGET).entries() if entry.kind is not EntryKind.IMAGE]
    log = [entry for entry in entries if entry.suffix == "event/log"][1]
    cut = [entry for entry in entries[: len(entries) * 4 // 5] if entry is not log]
    report = verify([written(tmp_path / "cut.mcap", cut)])
    assert report.is_equal, "\n".join(report.lines())
    assert report.comparison.keys["control/estimate"].recorded > 10
    assert not any(key.startswith("vision/") for key in report.comparison.keys)
    words = "\n".join(report.lines())
    assert "not every image was recorded" in words
    assert "1 entries are missing" in words
    assert "did not end in order" in words
    assert report.as_map()["differences"] == 0


@pytest.mark.parametrize("kind", [EntryKind.PORT_READ, EntryKind.PORT_WRITTEN, EntryKind.EVENT])
def test_a_recording_that_breaks_off_between_what_came_in_and_what_came_out_of_it_has_no_difference(kind):
    whole = list(Recording(STICKS).entries())
    places = [place for place, entry in enumerate(whole) if entry.kind is kind and place > 300]
    for place in places[:: max(len(places) // 2, 1)]:
        found = compared(sticks_with(lambda entries, end=place + 1: entries[:end])).values()
        assert [report.first for report in found if report.differences] == []


def test_what_the_core_answers_otherwise_is_named_with_the_event():
    def sign_for_another(entry):
        if entry.suffix != "core/SetpointAccepted":
            return entry
        event = unpack_event(entry.suffix, entry.payload)
        return entry._replace(payload=pack_event(replace(event, signed_for=event.signed_for + 1), NOTED))

    keys = compared(sticks_with(lambda entries: [sign_for_another(entry) for entry in entries]))
    assert keys["core/SetpointAccepted"].fields["reply.refusal"] > 0
    assert keys["control/output"].missing == keys["control/output"].recorded > 0
    assert keys["state/attitude"].differences == 0


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"recorder": "ground"}, "black box"),
        ({"part": 2}, "every part from 0 on"),
        ({"config": ""}, "--config"),
        ({"config": "{]"}, "--config"),
        ({"config": '{"link": 1}'}, "--config"),
    ],
)
def test_what_cannot_be_replayed_is_refused_with_the_fix(tmp_path, change, words):
    recording = Recording(STICKS)
    session = replace(recording.read_session(), **change)
    with pytest.raises(ConfigError, match=words):
        verify([written(tmp_path / "changed.mcap", list(recording.entries())[:20], session)])


def test_a_recording_of_before_events_were_kept_is_refused_with_what_can_still_be_done(tmp_path):
    old = [entry for entry in Recording(STICKS).entries() if entry.kind is not EntryKind.EVENT]
    with pytest.raises(ConfigError, match=r"cannot be verified.*mkctl log play"):
        verify([written(tmp_path / "old.mcap", old)])


def test_keys_of_a_configuration_of_another_time_are_left_out_and_named(tmp_path):
    recording = Recording(STICKS)
    session = recording.read_session()
    older = json.loads(session.config) | {"gone": {"a": 1}}
    older["link"]["nonsense"] = 1
    session = replace(session, config=json.dumps(older))
    report = verify([written(tmp_path / "older.mcap", recording.entries(), session)])
    assert report.comparison.differences == 0
    assert any("link.nonsense" in note and "gone" in note for note in report.notes)


@pytest.mark.parametrize("config", ["[" * 100_000, '{"link": ' + "9" * 5000 + "}", "{}}", '{"cameras": [{"a": 1}]}'])
def test_a_configuration_that_a_stranger_wrote_is_refused_in_a_line(config):
    with pytest.raises(ConfigError, match="is not understood here"):
        _ = Recorded(replace(Recording(STICKS).read_session(), config=config), []).config


def test_an_empty_recording_and_parts_of_two_are_refused(tmp_path):
    with pytest.raises(ConfigError, match="nothing was recorded"):
        verify([written(tmp_path / "empty.mcap", [])])
    other = replace(Recording(STICKS).read_session(), name="other")
    with pytest.raises(ConfigError, match="another recording"):
        verify([STICKS, written(tmp_path / "other.mcap", list(Recording(STICKS).entries())[:20], other)])


def test_a_file_that_is_no_recording_is_named(tmp_path):
    text = tmp_path / "notes.txt"
    text.write_text("no recording", encoding="utf-8")
    with pytest.raises(ConfigError, match=r"notes\.txt"):
        verify([text])
    with pytest.raises(MkError, match="missing"):
        verify([tmp_path / "missing.mcap"])


def test_the_command_tells_differences_by_its_exit_code(tmp_path, capsys):
    config = tmp_path / "other.toml"
    config.write_text('[link]\nport = "/dev/virtual"\n[control.limiter]\nmax_pitch = 5\n', encoding="utf-8")
    code = run(app, ["replay", str(STICKS), "--verify", "--json", "--config", str(config)])
    out, errors = capsys.readouterr()
    report = json.loads(out)
    assert code == 1, errors
    assert report["differences"] > 0
    assert set(report["keys"]["control/output"]["fields"]) == {"pitch", "limited"}


def sticks_with(change=list):
    """The recording flown by sticks, its entries changed."""
    return Recorded(Recording(STICKS).read_session(), change(list(Recording(STICKS).entries())))


def first_of(entries, suffix):
    """The place of the first entry of a key."""
    return next(place for place, entry in enumerate(entries) if entry.suffix == suffix)


def compared(recorded):
    """What differs between a recording and what comes out of it, by key."""
    return compare(recorded, replay(recorded, recorded.config).outputs).keys


def test_a_frame_that_the_line_refused_is_published_by_nobody():
    def refuse_first(entries):
        first = first_of(entries, "control/output")
        payload = pack_event(FrameNotSent(refuse(Token.RELEASING)), NOTED)
        key = entries[first].key.replace("control/output", "core/FrameNotSent")
        entries[first] = entries[first]._replace(kind=EntryKind.EVENT, key=key, payload=payload)
        return entries

    sent, fewer = (
        sum(output.suffix == "control/output" for output in replay(recorded, recorded.config).outputs)
        for recorded in (sticks_with(), sticks_with(refuse_first))
    )
    assert fewer == sent - 1


def test_a_frame_whose_number_was_not_recorded_is_found_missing_and_no_other():
    def leave_out_first(entries):
        del entries[first_of(entries, "control/output")]
        return entries

    report = compared(sticks_with(leave_out_first))["control/output"]
    assert (report.new, report.missing) == (1, 0)


def test_a_recording_without_a_lease_or_a_stamp_of_its_own_clock_is_replayed_from_nothing():
    recorded = sticks_with(lambda entries: [entry for entry in entries if entry.kind is not EntryKind.EVENT])
    assert recorded.first_epoch() == 0
    elsewhere = sticks_with(lambda entries: [e._replace(base=replace(e.base, boot="another")) for e in entries])
    assert elsewhere.wall_offsets() == []


@pytest.mark.parametrize(
    ("kind", "suffix", "payload"),
    [
        *(
            (EntryKind.NOTICE, "notice/layouts", msgpack.packb(one))
            for one in ({}, {"layouts": 3}, {"layouts": [["x"]]}, [], {"layouts": [["nobody", "v", "1"]]})
        ),
        (EntryKind.NOTICE, "notice/layouts", b"\x81\x91\x01\x02"),
        (EntryKind.SAMPLE, "raw/tx", msgpack.packb({"dropped": "by nobody", "raw": b""})),
        (EntryKind.SAMPLE, "raw/tx", msgpack.packb({"dropped": "expired"})),
        (EntryKind.EVENT, "core/Tick", msgpack.packb({"slept": []})),
        (EntryKind.EVENT, "core/ReleaseAsked", b"\x91" * 2000),
        (EntryKind.EVENT, "core/ReleaseAsked", msgpack.packb({"event": [1, 2]})),
        (EntryKind.EVENT, "core/Nobody", msgpack.packb({"event": {}})),
        (EntryKind.PORT_WRITTEN, "port", b"#"),
    ],
)
def test_what_no_daemon_records_is_named_and_no_defect_of_ours(tmp_path, kind, suffix, payload):
    entries = list(Recording(STICKS).entries())
    place = first_of(entries, "core/Tick")
    strange = entries[place]._replace(kind=kind, key=f"mk/mk1/{suffix}", payload=payload, issuer="nobody")
    path = written(tmp_path / "a.mcap", [*entries[: place + 1], strange, *entries[place + 1 :]])
    with pytest.raises(MkError, match=f"{suffix}"):
        verify([path])
