"""Boards and daemons that begin anew while a client flies; a few runs of each campaign, and what breaks its limits."""

from __future__ import annotations

from dataclasses import replace

import pytest

from lab.rigs.boardport import ADAPTER_TIME
from lab.rigs.cockpit import Boards
from lab.stories.cable import Cut, Cycle
from lab.stories.restarts import Restart, restart
from lab.stories.standstills import Standstill, Stopped, stand_still
from lab.stories.swaps import Swap, Swapped, swap_aircraft


@pytest.mark.parametrize("who", Stopped)
def test_after_a_standstill_nobody_tilts_and_control_is_cleared(who):
    found = stand_still(Boards("2.12a"), who, 3.0, seed=1, count=1, tick=ADAPTER_TIME)
    assert not found[0].is_wrong, found


def test_a_restart_in_flight_clears_the_old_command_and_waits_for_the_confirmation():
    found = restart(Boards("2.12a", "0.24"), 1, count=1, tick=ADAPTER_TIME)
    assert not found[0].is_wrong, found


def test_a_swap_in_flight_is_noticed():
    found = swap_aircraft(1, count=1)
    assert not found[0].is_wrong, found


STOP = Standstill(0, tilted=0, cleared=0.1)
BEGUN = Restart(0, cleared=0.1, steered=0, token="remembered_only", layout="v2", expected="v2")
SWAP = Swapped(0, Swap.CABLE, wrong=0, right=3, found="2.08a", expected="2.08")
BOOT = Cycle(0, Cut.REBOOT, back=1.0, first="release", steered=0, is_held=False, obeyed=0.2)


@pytest.mark.parametrize(
    ("right", "changes"),
    [
        (STOP, [{"tilted": 1}, {"cleared": None}, {"cleared": 1.2}]),
        (BEGUN, [{"cleared": None}, {"cleared": 0.4}, {"steered": 1}, {"token": ""}, {"layout": ""}, {"layout": "v1"}]),
        (SWAP, [{"wrong": 1}, {"right": 0}, {"found": ""}]),
        (BOOT, [{"steered": 1}]),
    ],
)
def test_what_breaks_a_limit(right, changes):
    assert not right.is_wrong
    for change in changes:
        assert replace(right, **change).is_wrong, change
