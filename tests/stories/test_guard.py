"""The daemon is killed or frozen in flight and nobody starts it again; `python -m lab attack` does it more often."""

from __future__ import annotations

import pytest

from lab.attack.deaths import WATCH, ControlLostError, Death, attack
from lab.rigs.cockpit import Boards
from lab.rigs.pilot import NotObeyedError
from tests.repeats import InconclusiveError

SLOW_MACHINE = 0.5
"""Added to the limits: the simulator, the guard and the test share two cores with everything else [s]."""


@pytest.mark.real_time(tolerance=SLOW_MACHINE)
@pytest.mark.parametrize(("kind", "limit"), [(Death.KILLED, 0.35), (Death.FROZEN, 1.1)])
async def test_the_guard_releases_the_aircraft_of_a_daemon_that_is_gone(kind, limit):
    try:
        found = await attack(Boards("2.08"), kind, 7)
    except (ControlLostError, NotObeyedError) as lost:
        raise InconclusiveError(f"control was lost before the attack: {lost}") from lost
    if found.is_machine_late:
        raise InconclusiveError(f"the machine was late by {found.late} s")
    assert found.released <= limit + SLOW_MACHINE, "without the guard FC 2.08 obeys for 5.3 s"
    assert found.steered == 0
    assert WATCH >= 3.0
