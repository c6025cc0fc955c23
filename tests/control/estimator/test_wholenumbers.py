"""The mean count and its slope are those of the truncated numbers themselves, drawn many times."""

from __future__ import annotations

import numpy as np
import pytest

from mkdaemon.control.estimator.model import LEVEL_STATES, TH, AircraftModel, B, D, V
from mkdaemon.control.estimator.rollback import STEP, Measurement, RollbackFilter
from mkdaemon.control.estimator.wholenumbers import WholeNumbers

ROW, EFFECT = np.array([2.0, 0.0]), np.array([0.0, -0.1])
F, G = np.array([[1.0, STEP], [0.0, 1.0]]), np.zeros(2)


@pytest.mark.parametrize(
    ("mean", "blur", "sd"),
    [
        *((mean, blur, 0.1) for mean in (-3.3, -0.4, 0.0, 0.3, 0.9, 1.5, 6.2) for blur in (0.25, 0.5, 2.0)),
        *((mean, 0.2, 0.0) for mean in (0.25, 0.75, 1.25, 2.5)),  # the least noise that blurs
    ],
)
def test_the_mean_count_and_its_slope_are_those_of_truncated_numbers(mean, blur, sd):
    draws = np.random.default_rng(1).normal(0.0, 1.0, 400_000)
    spread, reach = np.hypot(blur, 2.0 * sd), 0.05
    lower, middle, upper = (np.trunc(mean + step + spread * draws).mean() for step in (-reach, 0.0, reach))
    whole = WholeNumbers(ROW, EFFECT, blur)
    counts, slopes = whole.linearised(np.array([[mean / 2.0, 7.0]]), np.diag([sd**2, 9.0])[None])
    assert counts[0] == pytest.approx(middle, abs=0.02)
    assert sd == 0.0 or slopes[0] == pytest.approx((upper - lower) / (2.0 * reach), abs=0.08)


def test_a_filter_feeds_back_what_is_counted_and_looks_ahead_by_it():
    whole = WholeNumbers(ROW, EFFECT, 0.25)
    filter_ = RollbackFilter(F, G, np.zeros((2, 2)), np.array([[0.2, 0.0], [3.0, 0.0]]), np.zeros((2, 2)), 0.0, whole)
    ahead = filter_.ahead(np.zeros((1, 2)))
    filter_.advance(np.zeros(2))
    assert filter_.states == pytest.approx(ahead)
    assert filter_.states[:, 1] == pytest.approx([0.0, -0.55], abs=0.01)  # 0.4 counts are none, 6 at an edge are 5.5


def test_a_late_measurement_comes_forward_through_the_counts():
    whole, late = WholeNumbers(ROW, EFFECT, 0.4), Measurement(0.015, np.array([1.0, 0.0]), np.array([1.0]), 0.01)
    first = (np.array([[0.8, 0.3]]), np.diag([0.05, 0.02]), 0.0, whole)
    early, after = (RollbackFilter(F, G, 1e-4 * np.eye(2), *first) for _ in range(2))
    for k in range(20):
        if k == 2:
            early.measure(late)
        early.advance(np.zeros(1))
        after.advance(np.zeros(1))
    after.measure(late)
    assert early.states == pytest.approx(after.states, abs=1e-12)
    assert early.covariances == pytest.approx(after.covariances, abs=1e-12)


def test_doubted_inputs_make_uncertain_along_what_they_move():
    filter_ = RollbackFilter(F, np.array([0.0, 2.0]), np.zeros((2, 2)), np.zeros((2, 2)), np.zeros((2, 2)), 0.0)
    filter_.advance(np.zeros(2), np.array([0.25, 0.0]))
    assert filter_.covariances[:, 1, 1] == pytest.approx([1.0, 0.0])


def test_the_leak_of_an_aircraft_that_is_far_from_balance_is_the_linear_one_less_half_a_count():
    model = AircraftModel()
    linear, _ = model.horizontal(STEP)
    f, _, leak = model.counted(STEP)
    state = np.zeros((1, LEVEL_STATES))
    state[0, [TH, V, D, B]] = 0.3, 1.0, -0.5, 0.01
    counts, slopes = leak.linearised(state, np.zeros((1, LEVEL_STATES, LEVEL_STATES)))
    assert counts[0] == pytest.approx(leak.row @ state[0] - 0.5, abs=0.03)
    assert slopes[0] == pytest.approx(1.0, abs=0.2)
    assert f + np.outer(leak.effect, leak.row) == pytest.approx(linear, abs=2e-4)


def test_the_leak_of_an_aircraft_near_balance_is_nothing():
    leak, state = AircraftModel().counted(STEP)[2], np.zeros((1, LEVEL_STATES))
    state[0, TH] = np.radians(0.1)
    assert leak.linearised(state, np.zeros((1, LEVEL_STATES, LEVEL_STATES)))[0][0] == pytest.approx(0.0, abs=0.05)
