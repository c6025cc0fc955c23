"""Discretisation and regulator gains against closed forms."""

from __future__ import annotations

import math

import numpy as np
import pytest

from mkdaemon.control.linear import discretise, exponential, regulator_gain, spectral_radius


def test_exponential_of_nothing_is_one():
    assert np.array_equal(exponential(np.zeros((3, 3))), np.eye(3))


@pytest.mark.parametrize("angle", [1e-6, 0.1, 2.0, 50.0])
def test_exponential_of_a_rotation_rate_is_the_rotation(angle):
    got = exponential(np.array([[0.0, -angle], [angle, 0.0]]))
    want = [[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]]
    assert np.allclose(got, want, atol=1e-10)


def test_discretise_a_lag_and_an_integrator():
    f, g = discretise(np.array([[-2.0, 0.0], [1.0, 0.0]]), np.array([[2.0], [0.0]]), 0.1)
    decay = math.exp(-0.2)
    assert np.allclose(f, [[decay, 0.0], [(1 - decay) / 2, 1.0]])
    assert np.allclose(g[:, 0], [1 - decay, 0.1 - (1 - decay) / 2])


def test_regulator_gain_of_a_double_integrator_is_stable_and_optimal():
    f, g = np.array([[1.0, 0.1], [0.0, 1.0]]), np.array([[0.005], [0.1]])
    q, r = np.diag([1.0, 0.1]), np.array([[0.5]])
    gain, to_go = regulator_gain(f, g, q, r)
    assert spectral_radius(f - g @ gain) < 1.0
    cost = _cost(f, g, q, r, gain)
    assert to_go[0, 0] == pytest.approx(cost)
    for change in (0.97, 1.03):
        assert _cost(f, g, q, r, gain * change) > cost


def _cost(f, g, q, r, gain):
    x, total = np.array([1.0, 0.0]), 0.0
    for _ in range(2000):
        u = -gain @ x
        total += x @ q @ x + u @ r @ u
        x = f @ x + g @ u
    return total


def test_a_system_that_cannot_be_reached_is_refused():
    with pytest.raises(ValueError, match="stabilises"):
        regulator_gain(np.diag([1.5, 0.5]), np.array([[0.0], [1.0]]), np.eye(2), np.eye(1))


@pytest.mark.parametrize("angle", [0.25, 0.49, 0.51, 0.9, 1.0, 1.9, 3.9])
def test_an_exponential_is_exact_to_its_rounding_however_often_it_is_squared(angle):
    got = exponential(np.array([[0.0, -angle], [angle, 0.0]]))
    assert np.allclose(
        got, [[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]], rtol=0, atol=3e-13
    )


def test_the_norm_is_that_of_the_largest_row():
    """A nilpotent matrix: its exponential is one more than itself."""
    tall = np.zeros((3, 3))
    tall[0, 1:] = 40.0, -90.0
    assert np.allclose(exponential(tall), np.eye(3) + tall, atol=1e-9)


def test_a_regulator_of_two_inputs_solves_the_equation_of_riccati():
    f = np.array([[1.0, 0.1, 0.0], [0.0, 0.9, 0.2], [0.1, 0.0, 1.05]])
    g = np.array([[0.0, 0.1], [0.1, 0.0], [0.0, 0.3]])
    q, r = np.diag([1.0, 2.0, 0.5]), np.array([[0.5, 0.1], [0.1, 0.8]])
    to_go = q
    for _ in range(3000):
        gain = np.linalg.solve(r + g.T @ to_go @ g, g.T @ to_go @ f)
        to_go = q + f.T @ to_go @ (f - g @ gain)
    found, cost = regulator_gain(f, g, q, r)
    assert np.allclose(found, gain, rtol=1e-9)
    assert np.allclose(cost, to_go, rtol=1e-9)
    assert spectral_radius(np.diag([0.5, -2.0, 1.0])) == 2.0


def test_what_is_stable_and_costs_nothing_needs_no_gain():
    assert np.allclose(regulator_gain(np.diag([0.5, 0.2]), np.eye(2), np.zeros((2, 2)), np.eye(2))[0], 0.0)
