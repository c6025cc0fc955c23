"""The plant in its equations: docs/control.md, "The attitude loop"."""

from __future__ import annotations

import math

import numpy as np
import pytest

from mkdaemon.control.estimator.model import LEVEL_STATES, TH, US, AircraftModel, B, D, E, F, H, P, S, T, V, W, Z

MODEL = AircraftModel()
TINY = 1e-6
G = 9.81
EASY = {"stick_p": 6, "gyro_p": 100, "gyro_i": 120, "integral_factor": 16, "gyro_stability": 6, "stick_yaw_p": 4}
LATE = {"has_stick_filter": True, "has_slow_leak": False}

HORIZONTAL = {
    (P, V): 1.0,
    (V, T): G,
    (V, V): -0.35,
    (V, D): 1.0,
    (T, W): 1.0,
    # The board's tilt turns with the rate, and leaks to what its accelerometers show: what pushes less drag, crooked.
    (TH, W): 1.0,
    (TH, TH): -1.0 / 0.885,
    (TH, V): 0.9 * 0.35 / G / 0.885,
    (TH, D): -0.9 / G / 0.885,
    (TH, B): 1.0 / 0.885,
    (Z, TH): 1.0,
    (Z, US): -1.0,
    # The rate follows a proportional and an integral part of the error of the board's tilt.
    (W, TH): -3.10 / 0.022,
    (W, US): 3.10 / 0.022,
    (W, Z): -3.33 / 0.022,
    (W, W): -1.0 / 0.022,
    (US, US): -1.0 / 0.078,
}
VERTICAL = {(H, S): 1.0, (S, F): G, (S, E): 1.0, (S, S): -0.35, (F, F): -1.0 / 0.060}


def rates(transition, equations):
    """Rates of change from one tiny step, and those of the equations."""
    size = len(transition)
    wanted = np.zeros((size, size))
    for place, rate in equations.items():
        wanted[place] = rate
    return (transition - np.eye(size)) / TINY, wanted


def test_a_horizontal_axis_moves_by_its_equations():
    f, g = MODEL.horizontal(TINY)
    found, wanted = rates(f, HORIZONTAL)
    assert found == pytest.approx(wanted, rel=1e-3, abs=2e-3)
    assert g / TINY == pytest.approx([0.0] * US + [1.0 / 0.078] + [0.0] * (LEVEL_STATES - US - 1), rel=1e-3, abs=2e-3)


def test_the_vertical_axis_moves_by_its_equations():
    f, g = MODEL.vertical(TINY)
    found, wanted = rates(f, VERTICAL)
    assert found == pytest.approx(wanted, rel=1e-3, abs=2e-3)
    assert g[F] / TINY == pytest.approx(1.0 / 0.060, rel=1e-3)


def test_the_set_easy_is_the_aircraft_that_is_flown_where_none_is_known():
    found = AircraftModel.from_parameters(**EASY, **LATE)
    for name in ("rad_per_count", "a1", "a2", "leak", "stick_filter", "yaw_linear", "yaw_square"):
        assert getattr(found, name) == pytest.approx(getattr(MODEL, name), rel=0.005), name


@pytest.mark.parametrize(
    ("change", "name", "factor"),
    [
        ({"stick_p": 12}, "rad_per_count", 2.0),
        ({"gyro_i": 60}, "rad_per_count", 2.0),
        ({"gyro_i": 60}, "a1", 0.5),
        ({"gyro_p": 210}, "a1", 0.5),
        ({"gyro_stability": 3}, "a2", 2.0),
        ({"gyro_stability": 3}, "a1", 1.0),
        ({"integral_factor": 33}, "a2", 2.0),
        ({"stick_yaw_p": 8}, "yaw_linear", 2.0),
        ({"stick_yaw_p": 8}, "yaw_square", 2.0),
        ({"has_slow_leak": True}, "leak", 7.1 / 0.885),
        ({"has_stick_filter": False}, "stick_filter", 0.0113 / 0.078),
    ],
)
def test_each_parameter_acts_as_in_the_firmware(change, name, factor):
    before = AircraftModel.from_parameters(**EASY, **LATE)
    after = AircraftModel.from_parameters(**EASY | LATE | change)
    assert getattr(after, name) / getattr(before, name) == pytest.approx(factor, rel=0.005)


def test_an_integral_factor_that_is_all_there_is_keeps_a_gain():
    assert math.isfinite(AircraftModel.from_parameters(**EASY | LATE | {"integral_factor": 20_000}).a2)


@pytest.mark.parametrize("stick", [5.0, 8.0, 20.0, 60.0, -8.0, -60.0])
def test_a_yaw_stick_is_the_inverse_of_the_firmwares_parabola(stick):
    """Beyond a dead band of 4 counts: 0.4 deg/s a count, and 4 x 0.0047 / 6 deg/s a squared one."""
    beyond = abs(stick) - 4.0
    rate = math.copysign(math.radians(0.4 * beyond + 4.0 * 0.0047 / 6.0 * beyond**2), stick)
    assert MODEL.yaw_stick(rate) == pytest.approx(stick)


def test_a_rate_that_one_count_gives_is_no_stick():
    assert MODEL.yaw_stick(math.radians(0.39)) == 0.0
    assert MODEL.yaw_stick(math.radians(0.4032)) == pytest.approx(5.0, abs=0.01)


def test_an_aircraft_has_the_other_filter_twice():
    other = MODEL.with_other_filter()
    assert other.stick_filter == 0.0113
    assert other.with_other_filter() == MODEL


@pytest.mark.parametrize("number", [0.0, -1.0, math.nan, math.inf])
def test_every_constant_is_a_positive_number(number):
    with pytest.raises(ValueError, match="positive"):
        AircraftModel(drag=number)


def test_every_place_of_a_horizontal_axis_is_named():
    places = [P, V, T, TH, Z, W, US, D, B]
    assert sorted(places) == list(range(LEVEL_STATES))
    assert MODEL.horizontal(TINY)[0].shape == (len(places), len(places))
