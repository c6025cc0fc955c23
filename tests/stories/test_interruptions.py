"""Daemons that stand still while a client flies; a few runs of the campaign."""

from __future__ import annotations

import pytest

from lab.rigs.boardport import ADAPTER_TIME
from lab.rigs.cockpit import Boards
from lab.stories.standstills import Stopped, stand_still


@pytest.mark.parametrize("who", Stopped)
def test_after_a_standstill_nobody_tilts_and_control_is_cleared(who):
    found = stand_still(Boards("2.12a"), who, 3.0, 1, 1, tick=ADAPTER_TIME)
    assert not found[0]["is_wrong"], found
