from __future__ import annotations

import pytest

from lab.rigs.boardport import ADAPTER_TIME
from lab.rigs.cockpit import Boards
from lab.teleop.losses import HandsLost, Way, lose_hands
from lab.teleop.main import loss_row


@pytest.mark.parametrize("way", list(Way))
def test_lost_hands_are_neutral_and_released_in_time(way: Way) -> None:
    row = loss_row("FC 2.12a", way, lose_hands(Boards("2.12a"), 3, way, 1, ADAPTER_TIME))
    assert row.holds, row.figure


def test_row_fails_for_what_was_never_released_or_moved_after() -> None:
    right = HandsLost(1, 0, Way.UNPLUG, 0.02, 0.05, 0, 0)
    assert loss_row("FC", Way.UNPLUG, [right]).holds
    assert not loss_row("FC", Way.UNPLUG, [right, HandsLost(1, 1, Way.UNPLUG, 0.02, None, 0, 0)]).holds
    assert not loss_row("FC", Way.UNPLUG, [right, HandsLost(1, 1, Way.UNPLUG, 0.36, 0.5, 0, 0)]).holds
    assert not loss_row("FC", Way.UNPLUG, [right, HandsLost(1, 1, Way.UNPLUG, 0.02, 0.5, 1, 0)]).holds
    assert not loss_row("FC", Way.TWO_PADS, [HandsLost(1, 1, Way.TWO_PADS, 0.02, 0.5, 0, 1)]).holds


def test_latency_is_counted_to_the_first_frame_that_shows_the_move() -> None:
    latency = pytest.importorskip("lab.teleop.latency", reason="evdev is not installed")
    rolls = [(0.00, 5), (0.02, 5), (0.04, 9), (0.06, 9), (0.08, 5)]
    found = latency.summed_up([0.025, 0.065], rolls, 0.1)
    assert (found.moves, found.unseen, found.p50_ms, found.max_ms) == (2, 0, 15.0, 15.0)
    assert found.holds
    assert latency.summed_up([0.025, 0.030], rolls, 0.1).unseen == 1
