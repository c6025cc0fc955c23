"""Boards and daemons that begin anew while a client flies; a few runs of each campaign."""

from __future__ import annotations

import pytest

from lab.rigs.boardport import ADAPTER_TIME
from lab.rigs.cockpit import Boards
from lab.stories.restarts import restart
from lab.stories.standstills import Stopped, stand_still
from lab.stories.swaps import swap_aircraft


@pytest.mark.parametrize("who", Stopped)
def test_after_a_standstill_nobody_tilts_and_control_is_cleared(who):
    found = stand_still(Boards("2.12a"), who, 3.0, 1, 1, tick=ADAPTER_TIME)
    assert not found[0]["is_wrong"], found


def test_a_restart_in_flight_clears_the_old_command_and_waits_for_the_confirmation():
    found = restart(Boards("2.12a", "0.24"), 1, count=1, tick=ADAPTER_TIME)
    assert not found[0]["is_wrong"], found


def test_a_swap_in_flight_is_noticed():
    found = swap_aircraft(1, 1)
    assert not any(one["is_wrong"] for one in found), found
