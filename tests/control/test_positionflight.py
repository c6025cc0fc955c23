"""Flights by motion capture alone, and each of its faults: named, and never flown by. The physics is the judge."""

from __future__ import annotations

import math

import pytest

from lab.positions import ALONE_UNSEEN, IN_FLIGHT, VOLUME, Flight, fly
from mksim.physics.mocap import FAULTS


def test_it_takes_off_holds_steps_and_lands_by_motion_capture_alone():
    row = fly(Flight(seed=3, wind="indoor"))
    assert (row["ending"], row["why"]) == ("finished", "")
    assert row["hold_cm"] < 2.5
    assert row["touch_cm"] < 6.0


ON_GROUND = {
    "silent": "no report yet",
    "late": "older than max_age",
    "late_unsaid": "it does not tilt as the boards do",
    "mirrored": "it does not tilt as the boards do",
    "mirrored_place": "it does not move as the aircraft tilts",
    "wrong_up": "it leans against the boards",
    "other_body": "waiting for",
    "neighbour": "it does not tilt as the boards do",
    "frozen": "the same numbers come again and again",
}
"""What names a fault that is there from the start: the state of the source, or what the take-off waits for."""
IN_THE_AIR = {
    **ON_GROUND,
    "off": "they jumped",
    "silent": "the last report is",
    "wrong_up": "they jumped",
    "other_body": "they jumped",
    "neighbour": "they jumped",
}


@pytest.mark.parametrize(
    ("fault", "at", "words"),
    [
        *((fault, 0.0, words) for fault, words in ON_GROUND.items()),
        *((fault, IN_FLIGHT, words) for fault, words in IN_THE_AIR.items()),
    ],
)
def test_a_source_that_is_wrong_is_named_and_the_aircraft_stays_whole_and_near(fault, at, words):
    row = fly(Flight(seed=1, wind="light", fault=fault, at=at))
    assert (row["ending"], row["why"]) == ("finished", "")
    assert words in row["words"]
    assert row["farthest"] < VOLUME
    if at > 0.0:
        assert math.isfinite(row["named"])
        assert row["released"]


def test_every_fault_is_flown():
    assert set(IN_THE_AIR) == set(FAULTS)
    assert set(ON_GROUND) == set(FAULTS) - set(ALONE_UNSEEN)
