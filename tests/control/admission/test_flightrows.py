"""The checks before a flight: what each one finds, and what it prevents."""

from __future__ import annotations

from dataclasses import replace

import pytest

from mkdaemon.config.control import ControlConfig, LeaseConfig
from mkdaemon.control.activeset import UNREAD, Gate, GateKind
from mkdaemon.control.admission.beginnings import Concern, NewManoeuvre, TakeLease
from mkdaemon.control.admission.rows import ROWS, findings, is_ready, refusals, waits_for
from mkdaemon.control.estimator.model import Gap, ModelUnknown
from mkdaemon.control.motionmatch import Match
from mkdaemon.telemetry.control import ControlLine
from mkdaemon.telemetry.link import LinkCondition
from mkdaemon.telemetry.preflight import Blocks, CheckState
from mkdaemon.telemetry.refusals import Token, refuse
from mkdaemon.telemetry.state import GpsMode
from mkdaemon.telemetry.vision import Alarm, EyeState
from tests.control.admission.situations import GOOD, SET, SHARED, battery, eyes, flags, health, heights, reception, sees
from tests.control.events import link_state

UNKNOWN = CheckState.UNKNOWN
CONSTANT = ControlConfig(lease=LeaseConfig(allow_constant_gate=True))
FOUND = [
    ("guard", "guard_dead", {"has_guard": False}),
    ("firmware and layout", "no_control", {"line": ControlLine(reason="FC 0.1 is not known")}),
    ("firmware and layout", None, {"link": None}),
    ("link", "link_down", {"link": None}),
    ("link", "link_down", {"link": link_state(LinkCondition.ONE_WAY)}),
    ("link losses", None, {"health": health(lost=44, sent=100)}),
    ("link losses", "link_poor", {"health": health(lost=45, sent=100)}),
    ("link losses", UNKNOWN, {"health": None}),
    ("link losses", UNKNOWN, {"health": health(sent=0)}),
    ("gate", "gate_shut", {"active_set": replace(SET, gate=Gate(GateKind.CONSTANT, 128))}),
    ("gate", "gate_constant", {"active_set": replace(SET, gate=Gate(GateKind.CONSTANT, 129))}),
    ("gate", None, {"cfg": CONSTANT, "active_set": replace(SET, gate=Gate(GateKind.CONSTANT, 200))}),
    ("gate", "gate_shut", {"cfg": CONSTANT, "active_set": replace(SET, gate=Gate(GateKind.CONSTANT, 100))}),
    ("gate", UNKNOWN, {"active_set": UNREAD}),
    ("gate and height control", "gate_switches_altitude", {"active_set": replace(SET, gate=SHARED)}),
    ("gate and height control", UNKNOWN, {"active_set": UNREAD}),
    ("height control", "height_control", {"active_set": replace(SET, has_height_control=True)}),
    ("height control", "height_control", {"flight": flags(altitude_control=True)}),
    ("height control", None, {"flight": None}),
    ("height control", UNKNOWN, {"active_set": UNREAD}),
    ("GPS switch", "gps_steers", {"flight": flags(gps_mode=GpsMode.HOLD)}),
    ("GPS switch", "gps_steers", {"flight": flags(gps_mode=GpsMode.COME_HOME)}),
    ("GPS switch", UNKNOWN, {"flight": None}),
    ("GPS switch", UNKNOWN, {"flight": flags(gps_mode=GpsMode.UNKNOWN)}),
    ("emergency throttle", None, {"active_set": replace(SET, emergency_throttle=118)}),
    ("emergency throttle", "emergency_climbs", {"active_set": replace(SET, emergency_throttle=119)}),
    ("emergency throttle", UNKNOWN, {"active_set": UNREAD}),
    ("emergency descent", None, {"active_set": replace(SET, emergency_throttle=88)}),
    ("emergency descent", "emergency_falls", {"active_set": replace(SET, emergency_throttle=87)}),
    ("emergency descent", None, {"active_set": replace(SET, emergency_time=1)}),
    ("emergency descent", "emergency_falls", {"active_set": replace(SET, emergency_time=0)}),
    ("emergency descent", UNKNOWN, {"active_set": replace(SET, emergency_throttle=None)}),
    ("aircraft model", "gain_on_poti", {"model": ModelUnknown(Gap.ON_POTENTIOMETER, "gyro_i", 255, 1)}),
    ("aircraft model", "gain_zero", {"model": ModelUnknown(Gap.NO_AIRCRAFT, "stick_p", 0)}),
    ("aircraft model", UNKNOWN, {"model": ModelUnknown(Gap.UNREAD)}),
    ("control loop", "loop_unstable", {"loop": refuse(Token.LOOP_UNSTABLE, detail="x", cause="y", remedy="z")}),
    ("receiver", None, {"pilot": reception(0.75)}),
    ("receiver", "receiver_weak", {"pilot": reception(0.74)}),
    ("receiver", "receiver_weak", {"flight": flags(emergency_landing=True)}),
    ("receiver", None, {"flight": None}),
    ("receiver", UNKNOWN, {"pilot": None}),
    ("battery", "battery_low", {"battery": battery(16.0, is_low=True)}),
    ("battery", None, {"battery": battery(12.8)}),
    ("battery", "battery_low", {"battery": battery(12.79)}),
    ("battery", None, {"battery": battery(12.79), "cells": 3}),
    ("battery", None, {"active_set": replace(SET, low_cell=None), "battery": battery(9.0)}),
    ("battery", "battery_low", {"flight": flags(battery_low=True)}),
    ("battery", None, {"flight": None}),
    ("battery", UNKNOWN, {"battery": None}),
    ("battery cells", "cells_doubtful", {"are_cells_doubtful": True}),
    ("camera", "camera_unfit", {"eyes": (eyes(EyeState.GONE, reason="unplugged"),)}),
    ("camera", "camera_opening", {"eyes": (eyes(EyeState.OPENING, reason="not opened yet"),)}),
    ("camera", "camera_opening", {"eyes": (eyes(EyeState.OPENING, reason="not yet"), eyes(EyeState.GONE, reason="?"))}),
    ("camera", "camera_unfit", {"eyes": (eyes(EyeState.SILENT, reason="no image for 4.0 s", processed=0),)}),
    ("camera", "camera_unfit", {"eyes": (eyes(alarms={Alarm.UNCALIBRATED: "no calibration"}),)}),
    ("camera", None, {"eyes": (eyes(), eyes(EyeState.SILENT))}),
    ("camera", None, {"now": 3.0}),
    ("camera", "camera_unfit", {"now": 3.01}),
    ("camera", UNKNOWN, {"eyes": ()}),
    ("agreement of cameras", "cameras_contradict", {"contradicting": ("forward",)}),
    ("scale of heights", "heights_contradicted", {"eyes": (eyes(), eyes(selfcal=(heights(20.0, odds=4.0),)))}),
    ("scale of heights", UNKNOWN, {"eyes": (eyes(selfcal=()),)}),
    ("scale of heights", UNKNOWN, {"eyes": (eyes(selfcal=(heights(covered=0.4),)),)}),
    ("scale of heights", UNKNOWN, {"eyes": (eyes(selfcal=(heights(20.0, odds=3.9),)),)}),
    ("age of images", None, {"eyes": (eyes(latency_p50_ms=500.0),)}),
    ("age of images", "images_late", {"eyes": (eyes(latency_p50_ms=500.1), eyes(latency_p50_ms=900.0))}),
    ("age of images", None, {"eyes": (eyes(latency_p50_ms=900.0), eyes(latency_p50_ms=100.0))}),
    ("age of images", None, {"now": 3.0}),
    ("age of images", UNKNOWN, {"eyes": (eyes(processed=0),)}),
    ("target", None, {"target_age": 1.0}),
    ("target", UNKNOWN, {"target_age": 1.01}),
    ("target", UNKNOWN, {"target_age": None}),
    ("time stamps", "camera_turned", {"stamps": Match(0.0, -0.7)}),
    ("time stamps", UNKNOWN, {"stamps": Match(0.0, -0.69)}),
    ("time stamps", UNKNOWN, {"stamps": Match(0.2, 0.69)}),
    ("time stamps", UNKNOWN, {"stamps": None}),
    *(("time stamps", None, {"stamps": Match(lag, 0.7)}) for lag in (0.045, -0.045)),
    *(("time stamps", "stamps_off", {"stamps": Match(lag, 0.7)}) for lag in (0.0451, -0.0451)),
    ("disk", None, {"free_disk": 200e6}),
    ("disk", "disk_full", {"free_disk": 199e6}),
    ("disk", UNKNOWN, {"free_disk": None}),
]  # fmt: skip
"""Check, what it finds (a token, nothing, or nobody can tell), and what is put in place of what is well."""


def finding(known, name):
    return next(found for found in findings(known) if found.name == name)


@pytest.mark.parametrize(("name", "token", "change"), FOUND)
def test_what_stands_is_refused_with_a_reason_and_a_remedy_and_what_nobody_can_tell_prevents_nothing(
    name, token, change
):
    known = replace(GOOD, **change)
    found = finding(known, name)
    if token in (None, UNKNOWN):
        assert (found.state, found.token) == (token or CheckState.PASSED, None)
        return
    assert (found.state, found.token) == (CheckState.STANDS, token)
    assert found.reason
    assert found.fix
    beginning = TakeLease(holder="alice") if found.blocks is Blocks.LEASE else NewManoeuvre(Concern.POSITION)
    refused = [refusal.token for refusal in refusals(beginning, known)]
    assert refused == ([] if found.blocks is Blocks.NOTHING else [token])
    assert is_ready(findings(known)) is (found.blocks is Blocks.NOTHING)


def test_every_check_can_stand_but_for_the_target_which_the_flight_itself_waits_for():
    stand = {name for name, token, _ in FOUND if token not in (None, UNKNOWN)}
    assert {row.name for row in ROWS if row.is_shown} - stand == {"target"}
    assert is_ready(findings(replace(GOOD, **dict.fromkeys(("health", "flight", "pilot", "battery", "stamps")))))


def test_who_flies_by_heights_that_the_barometer_contradicts_flies_on_and_may_land():
    wrong = eyes(selfcal=(heights(20.0, sd=4.0, covered=2.5, odds=4.2),))
    for wanted in (Concern.POSITION, Concern.HOLD, Concern.LAND):
        assert not [*refusals(NewManoeuvre(wanted), replace(GOOD, eyes=(wrong,), flown=Concern.POSITION))]


@pytest.mark.parametrize(
    ("change", "is_asked_again"),
    [
        (sees(speed=2.0), False),
        (sees(offset=1.5), False),
        (sees(clean=0.0), False),
        ({"stamps": Match(0.062, 0.9)}, False),
        ({"health": health(lost=24)}, False),
        (sees(age=0.3), True),
        (sees(sd=0.2), True),
        ({"unanswered": "the board reports the gate shut"}, True),
        ({"battery": battery(12.7)}, True),
        ({"flight": flags(gps_mode=GpsMode.HOLD)}, True),
    ],
)
def test_a_flight_that_goes_on_when_the_aircraft_answers_again_waits_for_less_than_one_that_begins(
    change, is_asked_again
):
    now = replace(GOOD, **change)
    assert waits_for(NewManoeuvre(Concern.POSITION), now)
    assert bool(waits_for(NewManoeuvre(Concern.POSITION, is_resumed=True), now)) is is_asked_again
