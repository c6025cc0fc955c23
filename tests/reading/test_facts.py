"""The one table of facts, and what is wrong in words with its level: every screen and gateway takes them from here."""

from __future__ import annotations

import pytest

from mkdaemon.config.control import ControlConfig
from mkdaemon.control.authority import Authority
from mkdaemon.reading import Reading, Sort, line_of
from mkdaemon.reading.diagnoses import DiagnosticLevel, diagnoses_of
from mkdaemon.reading.known import key_of
from mkdaemon.telemetry.tone import Tone
from mkdaemon.telemetry.vision import PoseRefused
from tests.reading import events
from tests.reading.knownflight import KNOWN
from tests.reading.situations import AT, LINK, Situation

NOW = 1000.0


def picture_of(changes=(), *, ages=(), now=NOW):
    """The picture of the known flight with some fields changed, and some values older."""
    reading, known = Reading(), dict(KNOWN)
    for key, fields in dict(changes).items():
        known[key] = type(known[key]).model_validate(known[key].model_dump() | fields)
    for key, value in known.items():
        reading.take(key, value, now - dict(ages).get(key, 0.0))
    return reading.at(now)


@pytest.mark.parametrize(
    ("key", "fields", "word", "text", "tone"),
    [
        ("health", {"note": "the red one"}, "vehicle", "alive; motors on; the red one", "ok"),
        ("state/flight", {"is_flying": False}, "flight", "on the ground, motors on, GPS hold, flew 83 s", "note"),
        (
            *("state/flight", {"rc_failsafe": True}, "flight"),
            *("RC FAILSAFE, in the air, motors on, GPS hold, flew 83 s", "bad"),
        ),
        ("state/battery", {"voltage": 13.2}, "battery", "NEARLY EMPTY, 13.2 V, 3.30 V a cell, 11.5 A, 812 mAh", "warn"),
        ("state/battery", {"voltage": 11.6}, "battery", "EMPTY, 11.6 V, 2.90 V a cell, 11.5 A, 812 mAh", "bad"),
        ("health", {"battery_cells": None}, "battery", "15.2 V, 11.5 A, 812 mAh", "ok"),
        ("state/gps", {"satellites": None, "fix": "none"}, "gps", "nothing comes from the receiver", "note"),
        (
            *("vision/down/stats", {"alarms": {"dark": "more light"}}, "eye-down"),
            *("30 images/s, 94 % posed, 38 ms; DARK: more light", "warn"),
        ),
        (
            *("vision/down/stats", {"trusted_for": ("flight",), "refused": {"late": 3, "unsigned": 2}}, "eye-down"),
            *("30 reports/s, 94 % used, 38 ms; 5 refused", "ok"),
        ),
        (
            *("vision/down/stats", {"trusted_for": (), "state": "contradicted", "reason": "it leans"}, "eye-down"),
            *("THE BOARDS CONTRADICT IT: it leans", "bad"),
        ),
        ("control/status", {"external_control": None}, "control", "ann flies; external control not possible", "ok"),
        ("control/status", {"pilots_throttle": -20.0}, "hands", "the pilot holds hover", "bad"),
        (
            *(
                "control/status",
                {"phase": "free", "reason": Authority(ControlConfig(), first_epoch=1).reason},
                "control",
            ),
            *("no client holds the lease; external control v2", "note"),
        ),
        ("link/health", {"kinds": ()}, "streams", "on time", "ok"),
    ],
)
def test_what_a_value_says(key, fields, word, text, tone):
    fact = picture_of({key: fields}).fact(word)
    assert (fact.text, fact.tone) == (text, tone)


def test_a_fact_is_known_or_says_that_it_is_not_or_is_stale_and_then_never_good():
    for fact in Reading().at(NOW).facts:
        assert (fact.text, fact.tone, fact.age, fact.number) == ("not known", Tone.UNKNOWN, None, None)
    for fact in picture_of().facts:
        later = picture_of(now=NOW, ages=dict.fromkeys(KNOWN, 100.0)).fact(fact.id)
        if fact.age is not None:
            assert later.is_stale and later.aged.startswith("STALE 2 min: "), fact.id
            assert later.tone not in (Tone.OK, Tone.NOTE)


def test_image_tag_and_pose_are_apart():
    assert picture_of(ages={"vision/down/pose": 0.1}).fact("sight-down").text == (
        "image 0.0 s, tag 48 decoded, pose 0.1 s: pad (+0.12, -0.34, 1.98) m"
    )
    lost = picture_of(ages={"vision/down/pose": 7.0})
    assert lost.fact("sight-down").text == "image 0.0 s, tag 48 decoded, pad NOT SEEN for 7.0 s"
    refused = PoseRefused(
        **(KNOWN["vision/down/tags"].model_dump() | {"target": "pad", "refusal": "off_course"}),
        decode_age=0.0,
        has_attitude=True,
    )
    reading = Reading()
    for at, value in ((0.0, KNOWN["vision/down/pose"]), (1.9, KNOWN["vision/down/tags"]), (1.9, refused)):
        reading.take(key_of(value), value, at)
    words = "image 0.1 s, tag 48 decoded, pose of pad refused off_course, pad NOT SEEN for 2.0 s"
    assert reading.at(2.0).fact("sight-down").text == words


def test_an_older_value_changes_nothing_events_are_none_and_what_comes_on_change_holds_while_the_daemon_is_heard():
    reading = Reading()
    reading.take("state/battery", KNOWN["state/battery"], 5.0)
    reading.take("state/battery", KNOWN["state/battery"].model_copy(update={"voltage": 1.0}), 4.0)
    reading.take("event/log", KNOWN["event/log"], 6.0)
    reading.take("state/gps", None, 6.0)
    assert reading.at(5.0).fact("battery").number == 15.2
    reading.forget()
    assert reading.at(5.0).is_silent
    reading = Reading()
    reading.take("link/state", KNOWN["link/state"], 0.0)
    reading.take("health", KNOWN["health"], 1000.0)
    assert not reading.at(1001.0).fact("link").is_stale
    later = reading.at(1010.0)
    assert later.fact("link").is_stale and later.is_silent
    assert later.headline == "NOTHING FROM THE DAEMON: silent for 10 s"


OK, WARN, ERROR, STALE = DiagnosticLevel


def link(condition, reason):
    state = LINK | {"condition": condition, "reason": reason}
    return {"link/state": state, "link/health": {"state": state}}


def status(**fields):
    return {"control/status": fields}


def eye(**fields):
    return {"vision/down/stats": fields}


ROWS = [  # what is changed, the part that says it with its level, its words, and what comes first
    ({}, "vehicle", OK, "alive", "Ann flies"),
    ({"health": {"is_alive": False, "reason": "silent"}}, "vehicle", ERROR, "NOT ALIVE: silent", "IS SILENT: silent"),
    ({"health": {"error": "no GPS"}}, "vehicle", ERROR, "ERROR: no GPS", "ERROR: no GPS"),
    ({"health": {"read_only": "new firmware"}}, "vehicle", WARN, "READ ONLY: new firmware", "READ ONLY"),
    (link("up", "well"), "link", OK, "up: well", "Ann flies"),
    (link("degraded", "losses"), "link", WARN, "degraded: losses", "LINK DEGRADED: losses"),
    (link("mute", "no byte"), "link", ERROR, "mute: no byte", "LINK MUTE: no byte"),
    (link("one_way", "no echo"), "link", ERROR, "one way: no echo", "LINK ONE WAY: no echo"),
    (link("absent", "unplugged"), "link", ERROR, "no port: unplugged", "LINK NO PORT: unplugged"),
    ({"state/battery": {"is_low": True}}, "battery", ERROR, "LOW, 15.2 V", "BATTERY LOW: 15.2 V"),
    ({"state/battery": {"voltage": 13.0}}, "battery", WARN, "NEARLY EMPTY", "BATTERY NEARLY EMPTY"),
    ({"state/pilot": {"has_signal": False}}, "receiver", ERROR, "NO SIGNAL", "NO RECEIVER SIGNAL"),
    ({"state/flight": {"emergency_landing": True}}, "flight", ERROR, "EMERGENCY LANDING", "EMERGENCY LANDING"),
    (status(phase="stale", reason="too old"), "control", ERROR, "too old", "Ann is silent: neutral sticks"),
    (status(phase="landing"), "control", WARN, "battery low: it lands", "Battery low: it lands by itself"),
    (status(trouble="NO POSE; releases in 2.0 s"), "verdict", ERROR, "NO POSE", "NO POSE; releases in 2.0 s"),
    (eye(state="dark", reason="light"), "camera down", ERROR, "TOO DARK: light", "camera down too dark: light"),
    (eye(alarms={"scale": "measure"}), "camera down", WARN, "measure", "measure"),
    (eye(alarms={"blurred": "wipe"}), "camera down", WARN, "BLURRED: wipe", "camera down blurred: wipe"),
    ({"record/status": {"lost": 3}}, "recording", WARN, "3", "3"),
    ({"record/status": {"state": "full"}}, "recording", ERROR, "NOT RECORDING, no room", "NOT RECORDING"),
]


def look(changes):
    reading = Reading()
    for key, value in Situation("", changes).values.items():
        reading.take(key, value, AT.monotonic)
    picture = reading.at(AT.monotonic)
    return picture, {one.name: one for one in diagnoses_of(picture)}


@pytest.mark.parametrize(("changes", "part", "level", "words", "first"), ROWS)
def test_what_is_wrong_has_its_words_and_its_level(changes, part, level, words, first):
    picture, found = look(changes)
    assert (found[part].level, words in found[part].message) == (level, True)
    assert first in picture.headline


@pytest.mark.parametrize(
    ("event", "sort", "tone", "text"),
    [
        (events.ACCEPTED, Sort.COMMAND, Tone.OK, "do/rates (stream osd)"),
        (events.REFUSED, Sort.REFUSAL, Tone.BAD, "do/land denied: no target is seen."),
        (events.MODE, Sort.MODE, Tone.NOTE, "free -> leased: anna took it"),
        (events.FAILSAFE, Sort.FAILSAFE, Tone.BAD, "FAILSAFE release, confirmed: silence"),
        (events.WARNING, Sort.WARNING, Tone.WARN, r"the disk is\nslow"),
        (events.ERROR, Sort.WARNING, Tone.BAD, "the disk is gone"),
        (events.INFO, Sort.LOG, Tone.NOTE, "hello"),
        (events.MARK, Sort.MARK, Tone.NOTE, "mark by unknown: here"),
        (events.CLOCK, Sort.CLOCK, Tone.WARN, "the system clock was set by -1.500 s"),
        (events.UPLOADED, Sort.MISSION, Tone.NOTE, "waypoint list uploaded, 3 points"),
        (events.INCOMPLETE, Sort.MISSION, Tone.BAD, "waypoint list incomplete, 2 points"),
        (events.RUNNING, Sort.PROCEDURE, Tone.NOTE, "backup 1 of 5, running: set 1"),
    ],
)
def test_what_happens_is_one_line(event, sort, tone, text):
    line = line_of(event)
    assert (line.sort, line.tone, line.text) == (sort, tone, text)
    assert (line.token, line.fix) == (("no_target", "Look.") if sort is Sort.REFUSAL else ("", ""))


def test_a_value_is_no_event_and_routine_is_what_needs_no_look_while_a_flight_goes_well():
    assert line_of(Situation("").values["state/battery"]) is None
    found = {name: line_of(event) for name, event in vars(events).items() if name.isupper()}
    assert [name for name, line in found.items() if line.is_routine] == ["ACCEPTED", "INFO", "RUNNING"]
