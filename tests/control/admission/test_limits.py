"""Every limit of the table on both its sides, and what is said where all is well."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from mkdaemon.control.admission.beginnings import Concern, NewManoeuvre, Procedure, TakeLease
from mkdaemon.control.admission.rows import findings, refusal, waits_for
from mkdaemon.control.motionmatch import Match
from mkdaemon.telemetry.control import Phase
from tests.control.admission.situations import BLIND, GOOD, SET, battery, eyes, flags, health, reception, sees

FALLS = replace(SET, emergency_throttle=65)


def found(known, name):
    return next(each for each in findings(known) if each.name == name)


SHOWN = {
    "guard": "it runs",
    "firmware and layout": "known; external control v2",
    "link": "up: all is well",
    "link losses": "0 of 50 link tests not answered in time",
    "gate": "a switch of the transmitter: ExternalControl 255",
    "gate and height control": "it switches nothing else",
    "height control": "off (GlobalConfig bit 0)",
    "GPS switch": "at free: the NaviCtrl does not steer",
    "emergency throttle": "NotGas 110 is below hover, about 125",
    "emergency descent": "77 % of the weight are carried",
    "aircraft model": "known from the active parameter set",
    "control loop": "stable on the model of this aircraft, with the configured limits",
    "receiver": "100 %",
    "battery": "16.0 V",
    "battery cells": "4 cells",
    "camera": "1 of 1 see, calibrated",
    "agreement of cameras": "no camera contradicts another",
    "age of images": "half of them are looked at within 80 ms of their exposure",
    "target": "in sight",
    "scale of heights": "a way of 1.50 m is 1.50 +- 0.08 m by the barometer",
    "time stamps": "camera and boards move together to +10 ms",
    "disk": "5.0 GB free",
}


def test_what_is_shown_where_all_is_well():
    assert {each.name: each.reason for each in findings(GOOD)} == SHOWN


@pytest.mark.parametrize(
    ("name", "change", "words"),
    [
        ("link", {"link": None}, ("absent",)),
        ("link losses", {"health": health(lost=24)}, ("48 %", "44 %")),
        ("receiver", {"pilot": reception(0.5)}, ("50 %", "75 %")),
        ("receiver", {"flight": flags(emergency_landing=True)}, ("0 %",)),
        ("battery", {"battery": battery(12.0)}, ("12.0 V",)),
        ("age of images", {"eyes": (eyes(latency_p50_ms=900.0), eyes(latency_p50_ms=800.0))}, ("800 ms", "500 ms")),
        ("time stamps", {"stamps": Match(0.062, 0.9)}, ("+62 ms", "45 ms")),
        ("time stamps", {"stamps": Match(-0.062, 0.9)}, ("-62 ms", "45 ms")),
        ("disk", {"free_disk": 50e6}, ("50 MB", "200 MB")),
        ("target", {"target_age": 7.0}, ("7 s old",)),
        ("agreement of cameras", {"contradicting": ("a", "b")}, ("a, b",)),
        ("camera", {"now": 8.0}, ("down: silent: nothing was heard of it for ",)),
        ("age of images", {"now": 8.0}, ("down",)),
        # (65 / 125)^2 of the weight; from 0.85 of hover to below what climbs.
        ("emergency descent", {"active_set": FALLS}, ("NotGas 65 for 90", "27 % of the weight", "107 to 118")),
    ],
)
def test_what_is_wrong_is_told_with_its_number_and_its_limit_or_remedy(name, change, words):
    told = found(replace(GOOD, **change), name)
    assert all(word in told.reason + told.fix for word in words), told


CFG = GOOD.cfg.autopilot
STANDING = replace(GOOD, **sees(height=CFG.stand_height))


@pytest.mark.parametrize(
    ("concern", "change", "waits"),
    [
        (Concern.HOLD, sees(age=CFG.entry_age), False),
        (Concern.HOLD, sees(age=CFG.entry_age + 1e-6), True),
        (Concern.HOLD, sees(speed=CFG.entry_speed), False),
        (Concern.HOLD, sees(speed=CFG.entry_speed + 1e-6), True),
        (Concern.HOLD, sees(sd=CFG.entry_sd), False),
        (Concern.HOLD, sees(sd=CFG.entry_sd + 1e-6), True),
        (Concern.HOLD, sees(offset=CFG.entry_offset * 2.0, height=2.0), False),
        (Concern.HOLD, sees(offset=CFG.entry_offset * 2.0 + 1e-6, height=2.0), True),
        (Concern.HOLD, sees(clean=CFG.entry_clean), False),
        (Concern.HOLD, sees(clean=CFG.entry_clean - 1e-6), True),
        (Concern.TAKE_OFF, sees(height=CFG.stand_height + 0.149), False),
        (Concern.TAKE_OFF, sees(height=CFG.stand_height + 0.151), True),
        (Concern.TAKE_OFF, sees(height=2.0, age=CFG.entry_age), True),
        (Concern.TAKE_OFF, sees(height=2.0, age=CFG.entry_age + 1e-6), False),
        (Concern.TAKE_OFF, BLIND, False),
        (Concern.TAKE_OFF, {"gas_in_use": 75.0}, False),
        (Concern.TAKE_OFF, {"gas_in_use": 75.1}, True),
        (Concern.TAKE_OFF, {"motors_running": None}, False),
    ],
)
def test_a_stream_waits_up_to_a_limit_and_not_beyond(concern, change, waits):
    begins_in = STANDING if concern is Concern.TAKE_OFF else GOOD
    assert bool(waits_for(NewManoeuvre(concern), replace(begins_in, **change))) is waits


def test_what_a_take_off_waits_for_is_told_with_its_number():
    high = replace(GOOD, **sees(height=CFG.stand_height + 0.4))
    assert "its feet are 0.4 m above" in waits_for(NewManoeuvre(Concern.TAKE_OFF), high)
    strong = replace(STANDING, gas_in_use=130.0)
    assert "it is at +3" in waits_for(NewManoeuvre(Concern.TAKE_OFF), strong)


LIMIT = GOOD.cfg.lease.max_path_delay


@pytest.mark.parametrize(
    ("delay", "words"), [(None, ""), (0.0, ""), (LIMIT, ""), (LIMIT + 0.01, "takes 0.51 s"), (math.inf, "is unknown")]
)
def test_the_way_to_the_client_may_take_its_limit_and_no_longer(delay, words):
    error = refusal(TakeLease(path_delay=delay), GOOD)
    assert (error is None) is (words == "")
    assert error is None or words in error.reason


@pytest.mark.parametrize(
    ("change", "force", "refused"),
    [
        ({"holder": "alice", "lease_left": 0.5, "phase": Phase.LEASED}, False, True),
        ({"holder": "alice", "lease_left": 0.5, "phase": Phase.LEASED}, True, False),
        ({"holder": "alice", "lease_left": 0.0, "phase": Phase.LEASED}, False, False),
        ({"holder": "", "lease_left": 0.5, "phase": Phase.LEASED}, False, False),
        ({"holder": "", "phase": Phase.RELEASING}, False, True),
        ({"holder": "bob", "phase": Phase.RELEASING}, False, False),
    ],
)
def test_a_lease_belongs_to_its_holder_while_it_lives(change, force, refused):
    error = refusal(TakeLease(holder="bob", force=force), replace(GOOD, **change))
    assert (error is not None) is refused
    if error is not None and change["holder"]:
        assert "alice" in error.reason
        assert "0.5" in error.reason


def test_a_procedure_that_could_be_done_in_flight_says_how():
    wanted = Procedure(verb="waypoints_upload", is_alone=True, can_fly=True)
    running = refusal(wanted, replace(GOOD, motors_running=True))
    unknown = refusal(wanted, replace(GOOD, motors_running=None))
    assert (running.token, unknown.token) == ("in_flight_needed", "in_flight_needed")
    assert "motors are running" in running.reason
    assert "it is not known whether motors run" in unknown.reason
    assert refusal(wanted, replace(GOOD, motors_running=False)) is None
