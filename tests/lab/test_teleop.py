from __future__ import annotations

import pytest

from lab.rigs.boardport import ADAPTER_TIME
from lab.rigs.cockpit import Boards
from lab.teleop.losses import Way, lose_hands


@pytest.mark.parametrize("way", list(Way))
def test_lost_hands_are_neutral_and_released_in_time(way: Way) -> None:
    [lost] = lose_hands(Boards("2.12a"), way, 1, 3, ADAPTER_TIME)
    assert not lost["is_wrong"], lost


def test_latency_is_counted_to_the_first_frame_that_shows_the_move() -> None:
    latency = pytest.importorskip("lab.teleop.latency", reason="evdev is not installed")
    rolls = [(0.00, 5), (0.02, 5), (0.04, 9), (0.06, 9), (0.08, 5)]
    found = latency.summed_up([0.025, 0.065], rolls, 0.1)
    assert [found[name] for name in ("moves", "unseen", "p50_ms", "max_ms", "is_wrong")] == [2, 0, 15.0, 15.0, False]
    missed = latency.summed_up([0.025, 0.030], rolls, 0.1)
    assert (missed["unseen"], missed["is_wrong"]) == (1, True)
