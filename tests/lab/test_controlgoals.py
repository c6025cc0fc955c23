"""How `python -m lab control` judges its flights."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lab.campaign import quantile
from lab.control.cases import CASES, landing_figures, step_figures
from lab.control.flights import Record
from lab.control.main import sum_up


def steps(overshoots, times=(1.5,), ending="finished"):
    times = [*times] * (len(overshoots) // len(times))
    return [
        {"seed": seed, "ending": ending, "why": "", "t90_s": t90, "overshoot_percent": over, "processor_s": 9.0}
        for seed, (over, t90) in enumerate(zip(overshoots, times, strict=True))
    ]


@pytest.mark.parametrize(
    ("rows", "holds"),
    [
        (steps([4.0] * 8 + [12.0] * 2), False),
        (steps([4.0] * 10), True),
        (steps([4.0] * 23 + [122.0]), False),
        (steps([4.0] * 10, [1.5] * 8 + [1.9] * 2), True),
        (steps([4.0] * 24, [1.5] * 23 + [5.5]), False),
        ([*steps([4.0] * 23), {"seed": 23, "ending": "held", "why": "it never came to nine tenths"}], False),
        (steps([4.0] * 10, ending="lost"), False),
    ],
)
def test_an_overshoot_is_judged_by_its_p90_and_no_case_holds_with_a_worst_beyond_three_goals(rows, holds):
    assert sum_up(CASES["step"], rows)["holds"] is holds


def test_of_a_hundred_take_offs_two_may_fail_and_none_may_be_lost():
    rows = [{"seed": seed, "ending": "finished", "why": "", "farthest_cm": 20.0} for seed in range(100)]
    for seed, ending, holds in ((0, "held", True), (1, "held", True), (2, "held", False), (2, "lost", False)):
        rows[seed] = rows[seed] | {"ending": ending}
        assert sum_up(CASES["takeoff_light"], rows)["holds"] is holds


@given(st.lists(st.floats(-1e6, 1e6), min_size=1), st.floats(0.0, 1.0))
def test_percentiles_of_finite_values_are_those_of_numpy(values, share):
    found = quantile(sorted(values), share)
    assert found == pytest.approx(float(np.quantile(values, share)), rel=1e-6, abs=1e-6)


def test_a_step_that_is_never_answered_has_no_overshoot_of_zero():
    times = np.arange(0.0, 25.0, 0.02)
    still = Record(times=list(times), positions=[np.array([-0.5, 0.0, 2.0])] * len(times))
    assert step_figures(still) == {"why": "it never came to nine tenths"}
    stepped = Record(times=list(times), positions=[np.array([-0.5 + (t > 16.0), 0.0, 2.0]) for t in times])
    assert step_figures(stepped)["t90_s"] == pytest.approx(1.02, abs=0.03)


@pytest.mark.parametrize(
    ("record", "stands"),
    [
        (Record(touched=20.0, touch_error=0.1, touch_sink=0.3, stands=True), True),
        (Record(touched=20.0, touch_error=0.1, touch_sink=0.3, stands=False), False),
        (Record(touched=20.0, touch_error=0.4, touch_sink=0.3, stands=True), False),
        (Record(), False),
    ],
)
def test_a_landing_counts_by_where_the_feet_stand_at_the_end(record, stands):
    figures = landing_figures(record)
    assert ("why" not in figures) is stands
    assert math.isfinite(figures["touch_cm"]) == math.isfinite(record.touched)
