"""Boards and daemons that begin anew while a client flies; a few runs of each campaign, and what breaks its limits."""

from __future__ import annotations

from dataclasses import replace

import pytest

from lab.rigs.boardport import ADAPTER_TIME
from lab.rigs.cockpit import Boards
from lab.stories.cable import Cut, Cycle
from lab.stories.interruptions import reboot_row, restart_row, standstill_row, swap_row
from lab.stories.restarts import Restart, restart
from lab.stories.standstills import Standstill, Stopped, stand_still
from lab.stories.swaps import Swap, Swapped, swap_aircraft


@pytest.mark.parametrize("who", Stopped)
def test_after_a_standstill_nobody_tilts_and_control_is_cleared(who):
    found = stand_still(Boards("2.12a"), who, 3.0, seed=1, count=1, tick=ADAPTER_TIME)
    assert standstill_row("FC 2.12a", str(who), found).holds, found


def test_a_restart_in_flight_clears_the_old_command_and_waits_for_the_confirmation():
    found = restart(Boards("2.12a", "0.24"), 1, count=1, tick=ADAPTER_TIME)
    assert restart_row("FC 2.12a behind NC 0.24", found).holds, found


def test_a_swap_in_flight_is_noticed():
    found = swap_aircraft(1, count=1)
    assert swap_row(found).holds, found


def test_what_breaks_a_limit():
    stop = Standstill(0, tilted=0, cleared=0.1)
    assert standstill_row("", "", [stop]).holds
    for change in ({"tilted": 1}, {"cleared": None}, {"cleared": 1.2}):
        assert not standstill_row("", "", [replace(stop, **change)]).holds
    begun = Restart(0, cleared=0.1, steered=0, token="remembered_only", layout="v2")
    assert restart_row("", [begun]).holds
    for change in ({"cleared": None}, {"cleared": 0.4}, {"steered": 1}, {"token": ""}, {"layout": ""}):
        assert not restart_row("", [replace(begun, **change)]).holds
    assert not restart_row("", [begun, replace(begun, layout="v1")]).holds
    swap = Swapped(0, Swap.CABLE, wrong=0, right=3, found="2.08a", expected="2.08")
    assert swap_row([swap]).holds
    for change in ({"wrong": 1}, {"right": 0}, {"found": ""}):
        assert not swap_row([replace(swap, **change)]).holds
    boot = Cycle(0, Cut.REBOOT, back=1.0, first="release", steered=0, is_held=False, obeyed=0.2)
    assert reboot_row("", [boot]).holds
    assert not reboot_row("", [replace(boot, steered=1)]).holds
