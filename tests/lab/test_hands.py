from __future__ import annotations

import pytest

from lab.rigs.boardport import ADAPTER_TIME
from lab.rigs.cockpit import Boards
from lab.stories.hands import Way, lose_hands


@pytest.mark.parametrize("way", list(Way))
def test_lost_hands_are_neutral_and_released_in_time(way: Way) -> None:
    [lost] = lose_hands(Boards("2.12a"), way, 1, 3, ADAPTER_TIME)
    assert not lost["is_wrong"], lost
