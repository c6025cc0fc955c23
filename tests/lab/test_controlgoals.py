"""How `python -m lab control` judges its figures."""

from __future__ import annotations

import pytest

from lab.control.main import sum_up

GOAL = {"step_overshoot_percent": 10.0, "step_1m_t90_s": 1.8}


@pytest.mark.parametrize(
    ("key", "values", "holds"),
    [
        ("step_overshoot_percent", [4.0] * 8 + [12.0] * 2, False),
        ("step_overshoot_percent", [4.0] * 10, True),
        ("step_overshoot_percent", [4.0] * 23 + [122.0], False),
        ("step_1m_t90_s", [1.5] * 8 + [1.9] * 2, True),
        ("step_1m_t90_s", [1.5] * 23 + [5.5], False),
    ],
)
def test_an_overshoot_is_judged_by_its_p90_and_no_case_holds_with_a_worst_beyond_three_goals(key, values, holds):
    assert sum_up(key, values, [], GOAL)["holds"] is holds
