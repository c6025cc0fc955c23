"""The words and the level of what is wrong, once: every screen and every gateway takes them from here."""

from __future__ import annotations

import pytest

from mkdaemon.reading import Reading, Sort, line_of
from mkdaemon.reading.diagnoses import DiagnosticLevel, diagnoses_of
from mkdaemon.telemetry.tone import Tone
from tests.reading import events
from tests.reading.situations import AT, LINK, Situation

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


def test_every_part_has_a_row_that_is_wrong():
    _, found = look({})
    assert {part for _, part, *_ in ROWS} == set(found)


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
