"""Reference, regulators, shaping: bounds, signs and rest positions."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mkdaemon.control.estimator.model import GRAVITY, LEVEL_STATES, TH, US, AircraftModel, B, D, P, T, V, W
from mkdaemon.control.estimator.values import Estimate
from mkdaemon.control.regulator.autopilot import CountShaper, yaw_stick
from mkdaemon.control.regulator.horizontal import PREVIEW, STEP, HorizontalCosts, HorizontalRegulator
from mkdaemon.control.regulator.reference import Reference, ReferenceLimits
from mkdaemon.control.regulator.vertical import VerticalGains, gas

MODEL = AircraftModel()
REST = Estimate(
    at=0.0,
    yaw=0.0,
    hover_gas=125.0,
    axes=np.zeros((2, LEVEL_STATES)),
    vertical=np.array([2.0, 0.0, 0.0, 0.0]),
    position_sd=np.full(3, 0.01),
    age=0.0,
)


def moved(**places):
    axes = np.zeros((2, LEVEL_STATES))
    for place, value in {"p": P, "d": D}.items():
        if place in places:
            axes[:, value] = places[place]
    return replace(REST, axes=axes)


def leant(x, y):
    axes = np.zeros((2, LEVEL_STATES))
    axes[:, T] = x, y
    return replace(REST, axes=axes)


@pytest.mark.parametrize("distance", [0.05, 0.3, 1.0, 8.0])
def test_a_reference_reaches_its_goal_within_its_limits_and_does_not_pass_it(distance):
    limits = ReferenceLimits(1.2, 1.5)
    reference, goal = Reference(np.zeros(2)), np.array([distance, 0.0])
    for _ in range(int((distance / 1.2 + 4) / 0.02)):
        reference.move(goal, limits, 0.02)
        assert np.linalg.norm(reference.velocity) <= 1.2 + 1e-9
        assert np.linalg.norm(reference.acceleration) <= 1.5 + 1e-9
        assert reference.position[0] <= distance * 1.02 + 0.002
    assert reference.position == pytest.approx(goal, abs=0.005)


@given(st.floats(-0.5, 0.5))
def test_rounding_loses_nothing_over_time(wanted):
    shaper = CountShaper(-127, 127)
    total = sum(shaper.count(wanted) for _ in range(100))
    assert total == pytest.approx(100 * wanted, abs=1.0)


@pytest.mark.parametrize(
    ("yaw", "wanted", "stick"),
    [
        (0.2, 0.5, 8.0 + 0.7 * math.degrees(0.3)),
        (0.8, 0.5, -8.0 - 0.7 * math.degrees(0.3)),
        (-3.0, 3.0, -8.0 - 0.7 * math.degrees(math.tau - 6.0)),
        (0.0, 2.0, 28.0),
        (0.0, -2.0, -28.0),
        (0.0, math.radians(4.1), 8.0 + 0.7 * 4.1),
        (0.0, math.radians(3.9), 0.0),
        (0.5, None, 0.0),
    ],
)
def test_the_yaw_stick_grows_with_the_error_from_what_unlocks_the_compass(yaw, wanted, stick):
    assert yaw_stick(replace(REST, yaw=yaw), wanted) == round(stick)


def state(**values):
    axes = np.zeros((2, LEVEL_STATES))
    for name, value in values.items():
        axes[0, {"p": P, "v": V, "d": D, "b": B, "t": T, "th": TH}[name]] = value
    return replace(REST, axes=axes)


DRAG, PUSH, MORE = 0.35 * 0.8 / 9.81, -0.5 / 9.81, 0.6 / 9.81


@pytest.mark.parametrize(
    ("values", "stick", "velocity", "acceleration", "tilt"),
    [
        # At rest under a push of 0.5 m/s2 the board believes the tilt crooked by what leans its accelerometers.
        ({"d": 0.5, "b": 0.02, "t": PUSH, "th": PUSH + 0.02}, PUSH + 0.02, 0.0, 0.0, PUSH + 0.02),
        # A reference that flies is flown after with the tilt of its drag.
        ({"v": 0.8, "t": DRAG, "th": DRAG}, DRAG, 0.8, 0.0, DRAG),
        # One that accelerates, with the tilt that accelerates.
        ({"t": MORE}, 0.0, 0.0, 0.6, 0.0),
    ],
)
def test_in_balance_the_stick_stays_as_it_is(values, stick, velocity, acceleration, tilt):
    balanced, reference = state(**values), Reference(np.zeros(2), np.array([velocity, 0.0]))
    balanced.axes[0, US] = stick
    reference.acceleration = np.array([acceleration, 0.0])
    found = HorizontalRegulator(MODEL, HorizontalCosts()).tilt(balanced, reference)
    assert found == pytest.approx([tilt, 0.0])


@pytest.mark.parametrize(("far", "same"), [(0.5, False), (0.6, True), (5.0, True)])
def test_an_error_beyond_its_reach_is_the_references_business(far, same):
    regulator = HorizontalRegulator(MODEL, HorizontalCosts(steepest=9.0))
    asked, most = (regulator.tilt(state(p=-size), Reference(np.zeros(2)))[0] for size in (far, 0.6))
    assert asked > 0.0
    assert bool(asked == pytest.approx(most)) is same


@pytest.mark.parametrize(
    ("vertical", "wanted", "tilt", "share"),
    [
        # Height and speed, thrust that lags and acceleration that nothing explains; height and climb that are wanted.
        ((0.0, 0.0, 0.0, 0.0), (0.0, 0.0), 0.0, 1.0),
        ((0.0, 0.0, 0.0, 0.0), (0.1, 0.0), 0.0, 1.0 + 1.5 * 2.7 * 0.2 / 9.81),
        ((0.1, 0.0, 0.0, 0.0), (0.0, 0.0), 0.0, 1.0 - 1.5 * 2.7 * 0.2 / 9.81),
        ((0.0, 0.0, 0.0, 0.0), (5.0, 0.0), 0.0, 1.0 + 1.5 * 2.7 * 0.6 / 9.81),  # no faster than 0.6 m/s
        ((5.0, 0.0, 0.0, 0.0), (0.0, 0.0), 0.0, 1.0 - 1.5 * 2.7 * 0.6 / 9.81),
        ((0.0, 0.0, 0.0, 0.0), (0.0, 0.2), 0.0, 1.0 + 1.5 * 2.7 * 0.2 / 9.81),
        ((0.0, 0.2, 0.0, 0.0), (0.0, 0.0), 0.0, 1.0 - 1.5 * 2.7 * 0.2 / 9.81),
        ((0.0, 0.0, 0.0, 0.5), (0.0, 0.0), 0.0, 1.0 - 1.5 * 0.5 / 9.81),
        ((0.0, 0.0, -0.1, 0.0), (0.0, 0.0), 0.0, 0.9 + 1.5 * 0.1),  # it leads the motors
        ((0.0, -5.0, 0.0, 0.0), (0.0, 0.0), 0.0, 1.0 + 1.5 * 0.5),
        ((-9.0, -9.0, 2.0, 0.0), (0.0, 0.0), 0.0, 0.75),  # three weights lift and 1.5 are wanted: 3 - 1.5 x 1.5
        ((0.0, 9.0, 0.0, 0.0), (0.0, 0.0), 0.0, 0.4),  # one lifts and 0.6 is wanted: 1 - 1.5 x 0.4
        ((0.0, 9.0, 0.5, 0.0), (0.0, 0.0), 0.0, 0.3),  # 1.5 - 1.5 x 0.9 is less than what is ever asked for
        ((-9.0, -9.0, 0.0, 0.0), (0.0, 0.0), 0.6, 1.9),  # and here more
        ((0.0, 0.0, 0.0, 0.0), (0.0, 0.0), 0.5, 1.0 / math.cos(0.5)),
        ((0.0, 0.0, 0.0, 0.0), (0.0, 0.0), 0.8, 1.0 / 0.8),  # steeper leans count as 37 degrees
    ],
)
def test_throttle_is_that_of_the_cascade_within_what_motors_can_follow(vertical, wanted, tilt, share):
    asked = gas(replace(leant(0.0, tilt), vertical=np.array(vertical)), *wanted, VerticalGains())
    assert asked == pytest.approx(125.0 * math.sqrt(share))


LIMITS = ReferenceLimits(speed=1.2, acceleration=1.0)


@pytest.mark.parametrize(
    ("distance", "speed"),
    [
        # 2 a second of what is left, up to 0.1625 m, where that slows down by 0.65 of the acceleration; beyond, what
        # this still brakes to the same line. The largest speed, 1.2 m/s, takes 1.189 m.
        (0.0, 0.0),
        (0.05, 0.1),
        (0.162, 0.324),
        (0.165, math.sqrt(1.3 * (0.165 - 0.08125))),
        (0.5, math.sqrt(1.3 * (0.5 - 0.08125))),
        (1.15, math.sqrt(1.3 * (1.15 - 0.08125))),
        (1.195, 1.2),
        (9.0, 1.2),
    ],
)
def test_a_reference_that_has_the_speed_it_can_still_brake_keeps_it(distance, speed):
    way = np.array([0.6, -0.8])
    reference = Reference(np.array([3.0, 4.0]), speed * way)
    reference.move(np.array([3.0, 4.0]) + distance * way, LIMITS, 0.02)
    assert reference.acceleration == pytest.approx([0.0, 0.0], abs=1e-9)
    assert reference.velocity == pytest.approx(speed * way)
    assert reference.position == pytest.approx(np.array([3.0, 4.0]) + 0.02 * speed * way)


@pytest.mark.parametrize(
    ("velocity", "step", "acceleration"),
    [
        (0.0, 0.02, 1.0),  # 1.2 m/s in 0.12 s is more than it may
        (1.15, 0.02, 0.05 / 0.12),
        (1.15, 0.2, 0.05 / 0.2),  # no more in a long step than takes it there
        (1.3, 0.02, -0.1 / 0.12),
        (3.0, 0.02, -1.0),
    ],
)
def test_a_reference_takes_up_its_speed_within_its_acceleration(velocity, step, acceleration):
    reference = Reference(np.zeros(1), np.array([velocity]))
    reference.move(np.array([20.0]), LIMITS, step)
    assert reference.acceleration[0] == pytest.approx(acceleration)
    assert reference.velocity[0] == pytest.approx(velocity + step * acceleration)
    assert reference.position[0] == pytest.approx(velocity * step + acceleration * step**2 / 2.0)


def test_what_lies_ahead_of_a_reference_is_what_it_does_then():
    reference, goal = Reference(np.zeros(2)), np.array([0.9, -0.3])
    for _ in range(30):
        reference.move(goal, LIMITS, 0.02)
    told, before, done = reference.jumps_ahead(goal, LIMITS, 0.02, 60), reference.acceleration, []
    for _ in range(60):
        reference.move(goal, LIMITS, 0.02)
        done.append(reference.acceleration - before)
        before = reference.acceleration
    assert np.abs(done).max() > 0.2, "it begins to brake"
    assert told == pytest.approx(np.array(done), abs=1e-9)


@pytest.mark.parametrize(("place", "speed", "rests"), [(0.0, 0.0, True), (0.002, 0.0, False), (0.0, 0.002, False)])
def test_nothing_lies_ahead_of_a_reference_that_rests_on_its_goal(place, speed, rests):
    reference = Reference(np.array([place, 1.0]), np.array([0.0, speed]))
    assert (reference.jumps_ahead(np.array([0.0, 1.0]), LIMITS, 0.02, 3) is None) is rests


def test_a_brake_that_lies_ahead_is_begun_before_at_the_least_cost():
    """With the costs that made it: more of the preview is worse, and so is less, and none much more so."""
    costs = HorizontalCosts()
    regulator, (f, g) = HorizontalRegulator(MODEL, costs), MODEL.horizontal(STEP)
    weights = np.zeros(7)
    weights[[P, V, W]] = costs.position, costs.velocity, costs.rate
    at, jump = 20, -1.0

    def cost(share):
        error, total = np.zeros(7), 0.0
        for step in range(400):
            seen = regulator.preview[at - 1 - step] * jump if 0 <= at - 1 - step < PREVIEW else 0.0
            stick = share * seen - regulator.gain @ error
            total += error @ (weights * error) + costs.stick * stick**2
            error = f[:7, :7] @ error + g[:7] * stick
            if step == at - 1:
                error[T] -= jump / GRAVITY
        return total

    assert cost(1.0) < min(cost(0.97), cost(1.03))
    assert cost(1.0) < 0.7 * cost(0.0)


def test_a_reference_keeps_numbers_of_its_own():
    place, speed = np.zeros(2), np.ones(2)
    reference = Reference(place, speed)
    place += 1.0
    speed += 1.0
    assert (tuple(reference.position), tuple(reference.velocity)) == ((0.0, 0.0), (1.0, 1.0))
    assert (tuple(Reference(place).velocity), tuple(reference.acceleration)) == ((0.0, 0.0), (0.0, 0.0))


def test_the_gain_is_that_of_the_costs():
    """By going back from the end, step by step, until the cost to go stands still."""
    f, g = (each[:7] for each in MODEL.horizontal(0.02))
    f = f[:, :7]
    weights = 0.02 * np.diag([6.0, 0.6, 0.0, 0.0, 0.0, 0.1, 0.0])
    to_go, gain = weights, np.zeros(7)
    for _ in range(2000):
        gain = (g @ to_go @ f) / (0.02 * 3.0 + g @ to_go @ g)
        to_go = weights + f.T @ to_go @ (f - np.outer(g, gain))
    assert HorizontalRegulator(MODEL, HorizontalCosts()).gain == pytest.approx(gain, rel=1e-4, abs=1e-6)


def test_a_tilt_that_is_too_steep_keeps_its_direction():
    reference = Reference(np.zeros(2))
    far = moved(p=(0.3, -0.6))
    free, bound = (
        HorizontalRegulator(MODEL, HorizontalCosts(steepest=steepest)).tilt(far, reference) for steepest in (9.0, 0.05)
    )
    assert np.hypot(*bound) == pytest.approx(0.05)
    assert bound / 0.05 == pytest.approx(free / np.hypot(*free))
    assert HorizontalCosts().steepest == 0.35


def test_what_is_left_over_is_carried_over_and_at_the_end_of_the_range_at_most_one():
    shaper = CountShaper(-10, 20)
    assert [shaper.count(0.4) for _ in range(5)] == [0, 1, 0, 1, 0]
    shaper = CountShaper(-10, 20)
    assert [shaper.count(wanted) for wanted in (30.0, 19.3, 0.0, -30.0, -9.3, 0.0)] == [20, 20, 0, -10, -10, 0]


def test_a_gain_that_is_computed_once_for_all_flights_cannot_be_changed():
    with pytest.raises(ValueError, match="read-only"):
        HorizontalRegulator(MODEL, HorizontalCosts()).gain[0] = 1.0
