"""How `python -m lab control` judges its figures."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lab.campaign import quantile
from lab.control.cases import landing_figures, step_figures
from lab.control.flights import Record
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
        ("step_1m_t90_s", [1.5] * 23 + [math.inf], False),
        ("step_1m_t90_s", [1.5] * 23 + [math.nan], True),
    ],
)
def test_an_overshoot_is_judged_by_its_p90_and_no_case_holds_with_a_worst_beyond_three_goals(key, values, holds):
    assert sum_up(key, values, [], GOAL)["holds"] is holds


def test_what_never_happened_is_counted_as_the_worst_and_shown_as_none():
    figure = sum_up("step_1m_t90_s", [1.5, math.inf, math.inf], [], GOAL)
    assert (figure["median"], figure["p90"], figure["worst"], figure["never"]) == (None, None, None, 2)
    figure = sum_up("step_1m_t90_s", [1.5, 1.6, math.inf], [], GOAL)
    assert (figure["median"], figure["worst"], figure["never"]) == (1.6, None, 1)


@given(st.lists(st.floats(-1e6, 1e6), min_size=1), st.floats(0.0, 1.0))
def test_percentiles_of_finite_values_are_those_of_numpy(values, share):
    found = quantile(sorted(values), share)
    assert found == pytest.approx(float(np.quantile(values, share)), rel=1e-6, abs=1e-6)


def test_a_step_that_is_never_answered_has_no_overshoot_of_zero():
    times = np.arange(0.0, 25.0, 0.02)
    still = Record(times=list(times), positions=[np.array([-0.5, 0.0, 2.0])] * len(times))
    assert step_figures(still) == {"step_1m_t90_s": math.inf, "step_overshoot_percent": math.inf}
    stepped = Record(times=list(times), positions=[np.array([-0.5 + (t > 16.0), 0.0, 2.0]) for t in times])
    assert step_figures(stepped)["step_1m_t90_s"] == pytest.approx(1.02, abs=0.03)


@pytest.mark.parametrize(
    ("record", "success"),
    [
        (Record(touched=20.0, touch_error=0.1, touch_sink=0.3, stands=True), 100.0),
        (Record(touched=20.0, touch_error=0.1, touch_sink=0.3, stands=False), 0.0),
        (Record(touched=20.0, touch_error=0.4, touch_sink=0.3, stands=True), 0.0),
        (Record(touched=20.0, touch_error=0.1, touch_sink=0.3, stands=True, lost="tipped over"), 0.0),
        (Record(), 0.0),
    ],
)
def test_a_landing_counts_by_where_the_feet_stand_at_the_end(record, success):
    figures = landing_figures("land", record)
    assert figures["land_success_percent"] == success
    assert math.isfinite(figures["land_p90_cm"]) == math.isfinite(record.touched)
