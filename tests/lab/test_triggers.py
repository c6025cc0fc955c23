"""Every trigger of the safety table fires at its time; the campaign lets each fire on every generation."""

from __future__ import annotations

import math

import pytest

from lab.control.triggers import GENERATIONS, TRIGGERS, Fired, Trigger, aborted, dead_man, fire
from lab.rigs.cockpit import Boards

CABLE = tuple(boards for boards in GENERATIONS if boards.nc is None)


@pytest.mark.parametrize("number", range(len(TRIGGERS)), ids=[trigger.name for trigger in TRIGGERS])
def test_a_trigger_fires_at_its_time(number):
    trigger = TRIGGERS[number]
    boards = CABLE if trigger.is_direct else GENERATIONS
    fired = fire(trigger, boards[number % len(boards)], seed=number)
    assert fired.is_right, fired


def test_a_trigger_that_is_late_early_or_never_is_wrong():
    assert Fired("x", "y", 0.36, 0.3, 0.0).is_right
    assert not Fired("x", "y", 0.37, 0.3, 0.0).is_right
    assert not Fired("x", "y", 0.23, 0.3, 0.0).is_right
    assert not Fired("x", "y", math.inf, 0.3, 0.0).is_right
    assert Trigger(dead_man, None).time(Boards("2.08")) == 5.1
    assert Trigger(aborted, 0.0).time(Boards("2.08")) == 0.0
