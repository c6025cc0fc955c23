"""Every trigger of the safety table fires at its time; the campaign lets each fire on every generation."""

from __future__ import annotations

import importlib.util
import math
from dataclasses import replace

import pytest

from lab.control import triggers
from lab.control.triggers import ELSEWHERE, TRIGGERS, fire
from lab.rigs.boardport import ADAPTER_TIME
from lab.rigs.cockpit import Boards
from tests.places import DOCS


@pytest.mark.parametrize("number", range(len(TRIGGERS)), ids=[trigger.name for trigger in TRIGGERS])
def test_a_trigger_fires_at_its_time(number):
    trigger = TRIGGERS[number]
    fired = fire(trigger.name, trigger.boards[number % len(trigger.boards)], seed=number, tick=ADAPTER_TIME)
    assert fired["ending"] == "finished", fired


def test_a_trigger_that_is_late_early_or_never_is_wrong(monkeypatch):
    times = {0.36: "finished", 0.37: "wrong", 0.23: "wrong", math.inf: "wrong"}
    monkeypatch.setitem(triggers.BY_NAME, "stale", replace(triggers.BY_NAME["stale"], slack=0.0))
    for at, ending in times.items():
        monkeypatch.setattr(triggers, "_fire", lambda *_, at=at: at)
        assert fire("stale", Boards("2.08"), 1)["ending"] == ending


def test_a_trigger_is_tried_on_the_boards_that_show_it():
    by_name = triggers.BY_NAME
    assert not any(boards.nc for boards in by_name["dead_man"].boards)
    assert all(boards.nc for boards in by_name["gps_switch"].boards)
    assert len(by_name["aborted"].boards) == 6
    assert (by_name["dead_man"].time(Boards("2.08")), by_name["aborted"].time(Boards("2.08"))) == (5.25, 0.0)


def test_every_row_of_the_safety_table_has_a_story():
    page = (DOCS / "safety.md").read_text(encoding="utf-8")
    table = page.split("| event | after | action |\n")[1].split("\n\n")[0]
    rows = [line.split(" | ")[0].removeprefix("| ") for line in table.splitlines()[1:]]
    assert sorted(rows) == sorted({trigger.event for trigger in TRIGGERS} | set(ELSEWHERE))
    for module in ELSEWHERE.values():
        assert importlib.util.find_spec(module)
