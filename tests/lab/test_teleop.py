from __future__ import annotations

import pytest

from lab.rigs.boardport import ADAPTER_TIME
from lab.rigs.cockpit import Boards
from lab.teleop.losses import HandsLost, Way, lose_hands


@pytest.mark.parametrize("way", list(Way))
def test_lost_hands_are_neutral_and_released_in_time(way: Way) -> None:
    [lost] = lose_hands(Boards("2.12a"), 3, way, 1, ADAPTER_TIME)
    assert not lost.is_wrong, lost


def test_hands_that_were_never_released_or_moved_after_are_wrong() -> None:
    right = HandsLost(1, 0, Way.UNPLUG, 0.02, 0.05, 0, 0)
    assert not right.is_wrong
    assert HandsLost(1, 1, Way.UNPLUG, 0.02, None, 0, 0).is_wrong
    assert HandsLost(1, 1, Way.UNPLUG, 0.36, 0.5, 0, 0).is_wrong
    assert HandsLost(1, 1, Way.UNPLUG, 0.02, 0.5, 1, 0).is_wrong
    assert HandsLost(1, 1, Way.TWO_PADS, 0.02, 0.5, 0, 1).is_wrong


def test_latency_is_counted_to_the_first_frame_that_shows_the_move() -> None:
    latency = pytest.importorskip("lab.teleop.latency", reason="evdev is not installed")
    rolls = [(0.00, 5), (0.02, 5), (0.04, 9), (0.06, 9), (0.08, 5)]
    found = latency.summed_up([0.025, 0.065], rolls, 0.1)
    assert (found.moves, found.unseen, found.p50_ms, found.max_ms) == (2, 0, 15.0, 15.0)
    assert not found.is_wrong
    assert latency.summed_up([0.025, 0.030], rolls, 0.1).unseen == 1
