"""The eyes under a few hardships, a third of a second each; `lab vision --case conditions` flies through all."""

from __future__ import annotations

import pytest

from lab.vision.looks import WITH, figures
from lab.vision.weather import fly_conditions

SEED = 3_001_401


@pytest.mark.parametrize("name", ["curl", "auto_exposure"])
def test_a_hardship_costs_poses_but_gives_no_wrong_one(name: str) -> None:
    found = figures(fly_conditions(name, SEED, 0.34)[WITH])
    print(name, found)
    assert found["images"] == 10
    assert found["wrong"] == 0
    assert found["posed"] >= 5
