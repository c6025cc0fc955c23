"""Diagnostics: levels by what the daemon says, in its words; nothing old looks fresh."""

from __future__ import annotations

from mkdaemon.gateways.ros2 import diagnostics
from mkdaemon.reading.diagnoses import PARTS, Diagnosis, DiagnosticLevel
from tests import samples
from tests.gateways.ros2.bagtypes import scene, through_cdr
from tools.top_picture import KNOWN

FINE = {
    "health": samples.alive(),
    "link/health": samples.link_health(),
    "state/battery": samples.battery(),
    "state/flight": KNOWN["state/flight"].model_copy(update={"stamp": samples.stamp()}),
    "state/pilot": samples.pilot(),
    "record/status": samples.recorder(),
    "control/status": samples.status(phase="free", lease=None, manoeuvre=None),
    "vision/down/stats": samples.eyes(),
}


def look(latest, later=0.0):
    mine = Diagnosis("gateway", DiagnosticLevel.OK, "no client flies", {"flown": ""})
    made = diagnostics.report(scene(latest), samples.stamp(samples.AT + later), mine)
    read = through_cdr(made, "diagnostic_msgs/msg/DiagnosticArray")
    return {status.name: status for status in read.status}


def test_all_is_well():
    found = look(FINE)
    assert list(found) == [f"mk1: {name}" for name in ("verdict", *PARTS, "camera down", "gateway")]
    assert {status.level for status in found.values()} == {DiagnosticLevel.OK}
    assert {value.key: value.value for value in found["mk1: link"].values}["echo.p50_ms"] == "20"


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
    elsewhere = samples.stamp(boot="b").model_copy(update={"monotonic": 5.0})
    value = samples.status().model_copy(update={"stamp": elsewhere})
    assert look({**FINE, "control/status": value}, later=1.0)["mk1: control"].level == DiagnosticLevel.OK
    assert look({**FINE, "control/status": value}, later=5.0)["mk1: control"].level == DiagnosticLevel.STALE


def test_the_status_of_the_lease_says_how_a_manoeuvre_stands():
    value = samples.status(manoeuvre="takeoff", stage="climbs", is_done=False)
    made = through_cdr(diagnostics.control_status(value, scene()), "diagnostic_msgs/msg/DiagnosticStatus")
    said = {pair.key: pair.value for pair in made.values}
    assert made.hardware_id == "mk1" and "flies" in made.message
    assert (said["phase"], said["manoeuvre"], said["stage"]) == ("flying", "takeoff", "climbs")
    assert "outcome" not in said
