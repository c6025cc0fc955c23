"""Faults of a motion capture system that flies alone: each is named, and never flown by. The physics is the judge.

How each fault of the simulated system is told from motion is asked in `tests/positions/test_motionjudge.py`; a flight
without one is flown by the whole daemon in `tests/daemon/test_positions.py`; `python -m lab positions` flies all.
"""

from __future__ import annotations

import math

import pytest

from lab.positions import VOLUME, Flight, fly

AT_HEIGHT = 11.0
"""The aircraft has taken off; what moves the place shows in a hold, which begins later [s]."""


@pytest.mark.parametrize(
    ("fault", "at", "words"),
    [
        ("mirrored", 0.0, "it does not tilt as the boards do"),
        ("silent", AT_HEIGHT, "the last report is"),
        ("late_unsaid", AT_HEIGHT, "it does not tilt as the boards do"),
        ("mirrored_place", AT_HEIGHT, "it does not move as the aircraft tilts"),
        ("off", AT_HEIGHT, "they jumped"),
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
