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
    ("fault", "words"),
    [("silent", "the last report is"), ("mirrored_place", "it does not move as the aircraft tilts")],
)
def test_a_source_that_is_wrong_is_named_and_the_aircraft_stays_whole_and_near(fault, words):
    row = fly(Flight(seed=1, wind="light", fault=fault, at=AT_HEIGHT))
    assert (row["ending"], row["why"]) == ("finished", "")
    assert words in row["words"]
    assert row["farthest"] < VOLUME
    assert math.isfinite(row["named"])
    assert row["released"]
