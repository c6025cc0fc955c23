"""Every trigger of the safety table fires at its time; the campaign lets each fire on every generation."""

from __future__ import annotations

import importlib.util
import math

import pytest

from lab.control.linestories import dead_man
from lab.control.triggers import ELSEWHERE, TRIGGERS, Fired, Shown, Trigger, fire
from lab.control.triggerstories import aborted
from lab.rigs.boardport import ADAPTER_TIME
from lab.rigs.cockpit import Boards
from tests.places import DOCS


@pytest.mark.parametrize("number", range(len(TRIGGERS)), ids=[trigger.name for trigger in TRIGGERS])
def test_a_trigger_fires_at_its_time(number):
    trigger = TRIGGERS[number]
    fired = fire(trigger, trigger.boards[number % len(trigger.boards)], seed=number, tick=ADAPTER_TIME)
    assert fired.is_right, fired


def test_a_trigger_that_is_late_early_or_never_is_wrong():
    assert Fired("x", "y", 0.36, 0.3, 0.0).is_right
    assert not Fired("x", "y", 0.37, 0.3, 0.0).is_right
    assert not Fired("x", "y", 0.23, 0.3, 0.0).is_right
    assert not Fired("x", "y", math.inf, 0.3, 0.0).is_right
    assert Trigger("x", dead_man, None).time(Boards("2.08")) == 5.25
    assert Trigger("x", aborted, 0.0).time(Boards("2.08")) == 0.0


def test_a_trigger_is_tried_on_the_boards_that_show_it():
    assert not any(boards.nc for boards in Trigger("x", aborted, 0.0, Shown.ON_A_CABLE).boards)
    assert all(boards.nc for boards in Trigger("x", aborted, 0.0, Shown.BY_A_NAVICTRL).boards)
    assert len(Trigger("x", aborted, 0.0).boards) == 6


def test_every_row_of_the_safety_table_has_a_story():
    page = (DOCS / "safety.md").read_text(encoding="utf-8")
    table = page.split("| event | after | action |\n")[1].split("\n\n")[0]
    rows = [line.split(" | ")[0].removeprefix("| ") for line in table.splitlines()[1:]]
    assert sorted(rows) == sorted({trigger.event for trigger in TRIGGERS} | set(ELSEWHERE))
    for module in ELSEWHERE.values():
        assert importlib.util.find_spec(module)
