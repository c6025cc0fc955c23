"""A motion capture system that is wrong and flies alone is named, and never flown by. The physics is the judge.

How each fault of the simulated system is told from motion is asked in `tests/positions/test_motionjudge.py`; a flight
without one is flown by the whole daemon in `tests/daemon/test_positions.py`; `python -m lab positions` flies all.
"""

from __future__ import annotations

import math

from lab.positions import VOLUME, Flight, fly


def test_a_source_whose_place_is_mirrored_is_named_and_the_aircraft_stays_whole_and_near():
    # It has taken off; what moves the place shows in a hold, which begins later.
    row = fly(Flight(seed=1, wind="light", fault="mirrored_place", at=11.0))
    assert (row["ending"], row["why"]) == ("finished", "")
    assert "it does not move as the aircraft tilts" in row["words"]
    assert row["farthest"] < VOLUME
    assert math.isfinite(row["named"])
    assert row["released"]
