"""The daemon is frozen in flight; `python -m lab attack` does it more often, and kills it too."""

from __future__ import annotations

import pytest

from lab.attack.deaths import LIMITS, WATCH, ControlLostError, Death, attack
from lab.rigs.cockpit import Boards
from lab.rigs.pilot import NotObeyedError
from lab.rigs.sleeper import Sleeper
from tests.repeats import InconclusiveError

SLOW_MACHINE = 0.5
"""Added to the limits: the simulator, the guard and the test share two cores with everything else [s]."""


@pytest.mark.real_time(tolerance=SLOW_MACHINE)
async def test_the_guard_releases_the_aircraft_of_a_daemon_that_is_frozen():
    limit = LIMITS["released"]
    try:
        with Sleeper() as sleeper:
            found = await attack(Boards("2.08"), Death.FROZEN, 8)
    except (ControlLostError, NotObeyedError) as lost:
        raise InconclusiveError(f"control was lost before the attack: {lost}") from lost
    late = sleeper.percentile(100) / 1000
    if found["released"] - late <= limit < found["released"]:
        raise InconclusiveError(f"the machine was late by {late:.3f} s")
    assert found["released"] <= limit + SLOW_MACHINE, "without the guard FC 2.08 obeys for 5.3 s"
    assert found["steered"] == 0
    assert WATCH >= 3.0
