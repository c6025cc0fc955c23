"""Diagnostics: levels by what the daemon says, in its words; nothing old looks fresh."""

from __future__ import annotations

import pytest

from mkdaemon.gateways.ros2 import diagnostics
from mkdaemon.reading.diagnoses import PARTS, Diagnosis, DiagnosticLevel
from mkdaemon.telemetry.control import Phase
from mkdaemon.telemetry.link import LinkCondition
from mkdaemon.telemetry.record import RecorderState, RecordStatus
from mkdaemon.telemetry.vision import Alarm, EyeState
from tests.gateways.ros2 import samples
from tests.gateways.ros2.bagtypes import scene, through_cdr
from tools.top_picture import KNOWN

RECORDER = RecordStatus(
    stamp=samples.STAMP,
    state=RecorderState.RECORDING,
    reason="",
    file="",
    free_bytes=None,
    **dict.fromkeys(("file_bytes", "total_bytes", "entries", "lost", "queue_bytes", "queue_limit_bytes"), 0),
)
SCALED = samples.eyes(alarms={Alarm.SCALE: "measure it"})
FINE = {
    "health": samples.health(),
    "link/health": samples.link(),
    "state/battery": samples.battery(),
    "state/flight": KNOWN["state/flight"].model_copy(update={"stamp": samples.STAMP}),
    "state/pilot": samples.pilot(),
    "record/status": RECORDER,
    "control/status": samples.status(),
    "vision/down/stats": samples.eyes(),
}


def look(latest, later=0.0):
    mine = Diagnosis("gateway", DiagnosticLevel.OK, "no client flies", {"flown": ""})
    made = diagnostics.report(scene(latest), samples.at(later), mine)
    read = through_cdr(made, "diagnostic_msgs/msg/DiagnosticArray")
    return {status.name: status for status in read.status}


def test_all_is_well():
    found = look(FINE)
    assert list(found) == [f"mk1: {name}" for name in ("verdict", *PARTS, "camera down", "gateway")]
    assert {status.level for status in found.values()} == {DiagnosticLevel.OK}
    assert {value.key: value.value for value in found["mk1: link"].values}["echo.p50_ms"] == "12"


@pytest.mark.parametrize(
    ("key", "value", "name", "level", "words"),
    [
        ("health", samples.health(is_alive=False), "vehicle", DiagnosticLevel.ERROR, "NOT ALIVE: boards answer"),
        ("health", samples.health(error="no GPS"), "vehicle", DiagnosticLevel.ERROR, "ERROR: no GPS"),
        (
            "health",
            samples.health(read_only="unknown firmware"),
            "vehicle",
            DiagnosticLevel.WARN,
            "READ ONLY: unknown firmware",
        ),
        (
            "link/health",
            samples.link(LinkCondition.DEGRADED, "losses"),
            "link",
            DiagnosticLevel.WARN,
            "degraded: losses",
        ),
        ("link/health", samples.link(LinkCondition.MUTE, "no byte"), "link", DiagnosticLevel.ERROR, "mute: no byte"),
        ("state/battery", samples.battery(is_low=True), "battery", DiagnosticLevel.ERROR, "LOW, 15.5 V"),
        ("control/status", samples.status(Phase.STALE, "too old"), "control", DiagnosticLevel.ERROR, "too old"),
        (
            *("control/status", samples.status(Phase.FLYING, "flies", trouble="NO POSE; releases in 2.0 s")),
            *("verdict", DiagnosticLevel.ERROR, "NO POSE; releases in 2.0 s"),
        ),
        (
            "vision/down/stats",
            samples.eyes(EyeState.DARK, "more light"),
            "camera down",
            DiagnosticLevel.ERROR,
            "DARK: more light",
        ),
        (
            "vision/down/stats",
            SCALED,
            "camera down",
            DiagnosticLevel.WARN,
            "measure it",
        ),
    ],
)
def test_what_is_wrong_is_told_in_the_daemons_words(key, value, name, level, words):
    status = look({**FINE, key: value})[f"mk1: {name}"]
    assert (status.level, words in status.message) == (level, True), status.message


def test_what_is_old_or_was_never_heard_is_stale():
    old = look(FINE, later=10.0)
    assert {old[f"mk1: {name}"].level for name in PARTS} == {DiagnosticLevel.STALE}
    assert (old["mk1: verdict"].level, "silent for 10 s" in old["mk1: verdict"].message) == (
        DiagnosticLevel.ERROR,
        True,
    )
    assert old["mk1: gateway"].level == DiagnosticLevel.OK
    assert "STALE 10 s: " in old["mk1: control"].message
    silent = look({})
    assert (silent["mk1: link"].level, silent["mk1: link"].message) == (DiagnosticLevel.STALE, "not known")
    assert "mk1: camera down" not in silent, "no camera is no fault"


def test_the_age_of_another_machines_value_is_by_the_wall_clock():
    elsewhere = samples.STAMP.model_copy(update={"boot": "ffffffff", "monotonic": 5.0})
    value = samples.status().model_copy(update={"stamp": elsewhere})
    assert look({**FINE, "control/status": value}, later=1.0)["mk1: control"].level == DiagnosticLevel.OK
    assert look({**FINE, "control/status": value}, later=5.0)["mk1: control"].level == DiagnosticLevel.STALE


def test_the_status_of_the_lease_says_how_a_manoeuvre_stands():
    value = samples.status(Phase.FLYING, "flies", manoeuvre="takeoff", stage="climbs", is_done=False)
    made = through_cdr(diagnostics.control_status(value, scene()), "diagnostic_msgs/msg/DiagnosticStatus")
    said = {pair.key: pair.value for pair in made.values}
    assert made.hardware_id == "mk1" and "flies" in made.message
    assert (said["phase"], said["manoeuvre"], said["stage"]) == ("flying", "takeoff", "climbs")
    assert "outcome" not in said
