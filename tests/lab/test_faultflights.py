"""Flights with faults: how each is judged, and that broken rules are found."""

from __future__ import annotations

import math
from collections import Counter

import pytest

from lab.campaign import Ending
from lab.control.faultflights import Drawn, fly_one, judge, sum_up
from lab.control.faultrig import Expectation, FaultRig
from lab.control.faults import FAULTS
from lab.control.flights import Flight
from mkdaemon.control.actions import SendSticks
from mkdaemon.control.limiter import StickCounts


@pytest.mark.parametrize(("seed", "end"), [(20, Ending.RELEASED), (2, Ending.FINISHED)])
def test_a_flight_with_faults_ends_as_the_table_says(seed, end):
    flight = fly_one(seed)
    assert (flight["ending"], flight["violations"]) == (end, {})
    assert flight["frames"] > 100


@pytest.fixture
def rig():
    return FaultRig(Flight(seed=1))


def drawn(reason="", within=math.inf):
    return (Drawn("x", 6.0, Expectation((reason,) if reason else (), within)),)


def test_a_release_must_be_explained_and_in_time(rig):
    assert judge(rig, ()) == (Ending.WRONG, "it never began")
    rig.outcome.engaged = True
    assert judge(rig, ())[0] is Ending.HELD
    assert judge(rig, drawn("gone", 0.5))[0] is Ending.WRONG
    rig.outcome.released, rig.outcome.reason = 6.5, "client is gone"
    assert judge(rig, drawn("gone", 0.5))[0] is Ending.RELEASED
    assert judge(rig, drawn("gone", 0.1))[0] is Ending.WRONG
    assert judge(rig, drawn("something else"))[0] is Ending.WRONG


@pytest.mark.parametrize(
    ("reason", "stood", "aside", "end"),
    [
        ("landed on pad", True, 0.1, Ending.FINISHED),
        ("landed on pad", False, 0.1, Ending.WRONG),
        ("landed on pad", True, 0.5, Ending.WRONG),
        ("came down, but nothing shows", True, 2.0, Ending.RELEASED),
        ("came down, but nothing shows", False, 2.0, Ending.WRONG),
    ],
)
def test_a_landing_is_one_where_the_feet_stand_on_the_target(rig, reason, stood, aside, end):
    outcome = rig.outcome
    outcome.engaged, outcome.released, outcome.reason, outcome.stood, outcome.aside = True, 6.5, reason, stood, aside
    assert judge(rig, ())[0] is end


def test_a_client_without_setpoints_is_explained_by_why_they_were_refused(rig):
    rig.outcome.engaged, rig.outcome.released, rig.outcome.reason = True, 6.5, "no setpoint from lab for 1.00 s"
    assert judge(rig, drawn("a fresh image of"))[0] is Ending.WRONG
    rig.outcome.refused = "land cannot begin now; it needs a fresh image of pad: the last is 0.27 s old"
    assert judge(rig, drawn("a fresh image of"))[0] is Ending.RELEASED
    rig.outcome.reason = "the link is down"
    assert judge(rig, drawn("a fresh image of"))[0] is Ending.WRONG


def test_an_aircraft_that_is_lost_under_control_is_lost(rig):
    rig.outcome.engaged, rig.record.lost = True, "crashed"
    assert judge(rig, ()) == (Ending.LOST, "crashed")


@pytest.mark.parametrize(
    ("counts", "rule"),
    [
        (StickCounts(61, 0, 0, 0), "tilt"),
        (StickCounts(0, 0, 61, 0), "yaw"),
        (StickCounts(0, 0, 0, 81), "throttle"),
        (StickCounts(0, 0, 71, 0), "gesture"),
        (StickCounts(1, 0, 0, 0), "stale tilt"),
    ],
)
def test_a_frame_that_breaks_a_rule_is_found(rig, counts, rule):
    rig._check(SendSticks(counts, 9.0, 1, 1, 0.0, False), 8.0)
    assert rig.outcome.violations[rule] == 1
    assert rig.outcome.violations["without lease"] == 1
    assert rig.outcome.violations["old epoch"] == 1


def test_a_jump_of_the_sticks_and_a_frame_after_the_release_are_found(rig):
    rig._newest = 8.02
    for at, pitch in ((8.0, 0), (8.02, 40), (8.025, 40)):
        rig._check(SendSticks(StickCounts(pitch, 0, 0, 0), 9.0, 0, 1, 0.0, False), at)
    rig.outcome.released = 8.0
    rig._check(SendSticks(StickCounts(0, 0, 0, 0), 8.0, 0, 1, 0.0, False), 8.1)
    found = rig.outcome.violations
    assert (found["slew"], found["too soon"], found["after the release"], found["sent late"]) == (1, 1, 1, 1)


def test_the_sum_counts_every_end_and_every_broken_rule():
    rows = [
        {"faults": [fault], "ending": ending, "why": why, "frames": 10, "violations": violations}
        for fault, ending, why, violations in (
            ("blind", Ending.FINISHED, "landed on pad", {}),
            ("gust", Ending.LOST, "left at 3.2 s", {"slew": 2}),
            ("blind", Ending.RELEASED, "no image", {}),
        )
    ]
    good, bad, released = ({"seed": seed, **row} for seed, row in enumerate(rows, 1))
    found = sum_up([good, bad, good, released])
    assert (found["finished"], found["released"], found["lost"], found["frames"]) == (2, 1, 1, 40)
    assert found["unfinished"] == ["2: lost: left at 3.2 s"]
    assert found["violations"] == Counter(slew=2)
    assert not found["holds"]
    assert sum_up([good, released])["holds"]
    assert not sum_up([good | {"violations": {"slew": 1}}])["holds"]


def test_every_fault_can_be_drawn():
    assert len(FAULTS) == 15
