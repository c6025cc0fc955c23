"""The beginning of a flight, and a model that changes in flight."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from mkdaemon.control.estimator.estimator import Estimator
from mkdaemon.control.estimator.model import AircraftModel, E, V
from mkdaemon.control.estimator.values import OURS, StickCommand, ThrottleUse
from mkdaemon.control.regulator.autopilot import UNKNOWN_SPEED, Autopilot, Goal, at_origin
from mkdaemon.control.regulator.horizontal import HorizontalCosts
from mkdaemon.control.regulator.reference import ReferenceLimits
from mkdaemon.control.regulator.vertical import VerticalGains
from tests.control.estimator.test_parts import level_view

MODEL = AircraftModel()
HOVER = 125.0


def look(at, east):
    """A level aircraft beside the target, two metres up."""
    return level_view(at, place=(east, 0.0, 2.0))


def begin(view):
    """An autopilot that begins with a view."""
    estimator = Estimator(MODEL, view, HOVER)
    limits = ReferenceLimits(1.2, 1.0), ReferenceLimits(0.6, 0.8)
    return Autopilot(
        estimator,
        costs=HorizontalCosts(),
        gains=VerticalGains(),
        level_limits=limits[0],
        height_limits=limits[1],
        estimate=estimator.estimate(view.at),
    )


def test_the_reference_begins_with_the_speed_that_made_it_known_and_not_with_the_one_before():
    autopilot = begin(look(0.0, 0.4))
    estimator = autopilot.estimator
    estimator._level.states[0, V] = 2.0
    autopilot.sticks(at_origin(2.0), 0.0)
    for k in range(1, 30):
        now = 0.02 * k
        estimator.advance(now)
        estimator.target_seen(look(now, 0.4), now)
        autopilot.sticks(at_origin(2.0), now)
        if estimator.velocity_sd <= UNKNOWN_SPEED:
            break
    assert autopilot.reference.velocity[0] == pytest.approx(autopilot.estimate.velocity[0])
    assert autopilot.height.velocity[0] == pytest.approx(autopilot.estimate.velocity[2], abs=0.02)


@pytest.mark.parametrize(("cap", "most"), [(None, 200), (135.0, 147), (100.0, HOVER)])
def test_while_the_pilots_throttle_caps_ours_not_much_more_is_asked_for_than_flies_or_hovers(cap, most):
    autopilot, asked = begin(look(0.0, 0.0)), []
    for k in range(100):
        now, is_known = 0.02 * k, k > 40
        sticks = autopilot.sticks(at_origin(5.0 if is_known else 2.0), now)
        use = ThrottleUse(cap, is_ours=False) if is_known and cap else OURS
        autopilot.estimator.sent(StickCommand(now, 0.0, 0.0, 0.0, sticks.throttle + 127.0, use))
        if not is_known:
            autopilot.estimator.target_seen(look(now, 0.0), now)
        elif k == 60:
            autopilot.estimator._vertical.shift(E, np.array([-5.0]))  # it sinks for no known reason
        asked.append(sticks.throttle + 127)
    assert max(asked) > 147 + 1 if cap is None else most - 1 <= max(asked) <= most + 1


def test_the_regulator_is_that_of_the_stick_filter_that_was_found():
    autopilot = begin(look(0.0, 0.0))
    estimator = autopilot.estimator
    other, now = MODEL.with_other_filter(), 0.0
    f, g = other.horizontal(0.01)
    axes, held = np.zeros((2, 9)), np.zeros(2)
    for k in range(150):
        now = 0.01 * k
        if k % 2 == 0:
            estimator.advance(now)
            estimator.attitude_received(now, float(axes[0, 3]), float(-axes[1, 3]), 0.0)
            held = np.array([round(15 * math.sin(5 * now)), round(15 * math.cos(4 * now))])
            estimator.sent(StickCommand(now - MODEL.uplink, held[0], -held[1], 0.0, HOVER))
        axes = axes @ f.T + (held * MODEL.rad_per_count)[:, None] * g
    assert estimator.model.stick_filter == other.stick_filter
    assert estimator.model.uplink == pytest.approx(MODEL.uplink, abs=0.003)
    assert isinstance(autopilot.sticks(at_origin(2.0), now).pitch, int)


def held(seconds, *, east=0.4, yaw=0.0, goal=None, climb=0.0, **fields):
    """An autopilot that saw an aircraft stand still for a time, and all sticks it asked for."""

    def seen(at):
        return level_view(at, place=(east, 0.0, 2.0 + climb * at), yaw=yaw)

    autopilot, sticks = begin(seen(0.0)), []
    for k in range(1, round(seconds / 0.02)):
        autopilot.estimator.advance(0.02 * k)
        autopilot.estimator.target_seen(seen(0.02 * k), 0.02 * k)
        sticks.append(autopilot.sticks(replace(goal or at_origin(2.0), **fields), 0.02 * k))
    return autopilot, sticks


def test_sticks_are_for_the_moment_when_they_act():
    autopilot, _ = held(0.2)
    assert autopilot.estimate.at == pytest.approx(0.02 * 9 + MODEL.uplink)


def test_a_height_begins_where_the_aircraft_is_once_its_speed_is_known():
    autopilot, _ = held(1.0, climb=0.3, goal=Goal(position=np.array([0.4, 0.0, 2.0]), climb=0.0))
    assert autopilot.height.position[0] == pytest.approx(2.1, abs=0.25)
    start = begin(look(0.0, 0.0))
    start.sticks(at_origin(5.0), 0.02)
    assert start.height.position[0] == pytest.approx(2.0, abs=0.02)
    assert start.reference.position.shape == (2,)


def test_a_climb_that_is_asked_for_is_its_own_reference():
    autopilot, _ = held(0.5, goal=Goal(position=np.array([0.4, 0.0, 1.7]), climb=-0.3))
    assert (autopilot.height.position[0], autopilot.height.velocity[0]) == (1.7, -0.3)


@pytest.mark.parametrize(("share", "throttle"), [(0.6, 0.6 * HOVER - 127), (1.1, 1.1 * HOVER - 127)])
def test_a_share_of_hover_is_the_throttle(share, throttle):
    _, sticks = held(0.5, gas_share=share)
    assert sticks[-1].throttle == pytest.approx(throttle, abs=1.0)


@pytest.mark.parametrize(("speed", "limit"), [(None, 1.2), (0.3, 0.3), (5.0, 1.2)])
def test_a_way_is_flown_no_faster_than_asked_and_never_faster_than_allowed(speed, limit):
    autopilot, _ = held(2.5, goal=Goal(position=np.array([20.0, 0.0, 2.0])), speed=speed)
    assert autopilot.reference.velocity[0] == pytest.approx(limit, rel=0.02)


@pytest.mark.parametrize(
    ("rate_deg", "stick"), [(0.0, 0), (0.5, 8), (-0.5, -8), (5.0, None), (-5.0, None), (60.0, 28), (-60.0, -28)]
)
def test_a_yaw_rate_becomes_a_stick_between_what_unlocks_the_compass_and_what_tilts_can_follow(rate_deg, stick):
    autopilot, sticks = held(0.3, yaw_rate=float(np.radians(rate_deg)))
    expected = round(autopilot.estimator.model.yaw_stick(float(np.radians(rate_deg)))) if stick is None else stick
    assert sticks[-1].yaw == expected
    assert np.sign(sticks[-1].yaw) == np.sign(rate_deg)


def asked_far(axis, sign, **model):
    """Sticks for a goal far away along an axis of the target, of an aircraft that has stood still for a while."""
    far = np.array([0.0, 0.0, 2.0])
    far[axis] += 9.0 * sign
    estimator = Estimator(replace(MODEL, **model), look(0.0, 0.0), HOVER)
    limits = ReferenceLimits(5.0, 3.0)
    autopilot = Autopilot(
        estimator,
        costs=HorizontalCosts(),
        gains=VerticalGains(),
        level_limits=limits,
        height_limits=limits,
        estimate=estimator.estimate(0.0),
    )
    sticks = []
    for k in range(1, 60):
        estimator.advance(0.02 * k)
        estimator.target_seen(look(0.02 * k, 0.0), 0.02 * k)
        sticks.append(autopilot.sticks(Goal(position=far), 0.02 * k))
    return sticks


@pytest.mark.parametrize(
    ("axis", "sign", "pitch", "roll"), [(0, 1, 127, 0), (0, -1, -127, 0), (1, 1, 0, -127), (1, -1, 0, 127)]
)
def test_sticks_end_where_the_wire_does(axis, sign, pitch, roll):
    """A count that asks for next to nothing: 0.35 rad would be 700 of them."""
    last = asked_far(axis, sign, rad_per_count=5e-4)[-1]
    assert (last.pitch, last.roll) == (
        pytest.approx(pitch, abs=60 * (pitch == 0)),
        pytest.approx(roll, abs=60 * (roll == 0)),
    )


def test_an_aircraft_that_answers_its_sticks_half_as_much_again_is_asked_for_less(monkeypatch):
    usual = asked_far(0, 1)
    monkeypatch.setattr(Estimator, "stick_gain", property(lambda self: 1.5))
    assert sum(each.pitch for each in asked_far(0, 1)) == pytest.approx(
        sum(each.pitch for each in usual) / 1.5, rel=0.02
    )


def test_the_regulator_moves_what_lifts_unexplained_into_the_hover_throttle_by_a_fiftieth_each_time():
    autopilot, _ = held(0.5, east=0.0)
    estimator, now = autopilot.estimator, 0.5
    for k in range(2):
        sticks = autopilot.sticks(at_origin(2.0), now + 0.02 * k)
        estimator.sent(StickCommand(now + 0.02 * k, 0.0, 0.0, 0.0, sticks.throttle + 127.0))
    estimator._vertical.shift(E, -0.981 - estimator._vertical.states[:, E])
    before = estimator.hover_gas
    autopilot.sticks(at_origin(2.0), now + 0.04)
    assert estimator.hover_gas == pytest.approx(before * (1.0 + 0.02 * 0.1 / 2.0), rel=2e-4)


def test_a_share_of_hover_teaches_nothing_about_it():
    autopilot, _ = held(0.5, gas_share=1.0, east=0.0)
    estimator = autopilot.estimator
    estimator.sent(StickCommand(0.5, 0.0, 0.0, 0.0, HOVER))
    estimator._vertical.shift(E, np.array([-3.0]))
    autopilot.sticks(replace(at_origin(2.0), gas_share=1.0), 0.5)
    assert estimator.hover_gas == HOVER


def test_the_speed_is_known_to_a_quarter_of_a_metre_a_second_before_the_reference_moves():
    autopilot, goal = begin(look(0.0, 0.4)), at_origin(2.0)
    for k in range(1, 40):
        autopilot.estimator.advance(0.02 * k)
        autopilot.estimator.target_seen(look(0.02 * k, 0.4), 0.02 * k)
        was_known = autopilot.estimator.velocity_sd <= 0.25
        autopilot.sticks(goal, 0.02 * k)
        if was_known:
            break
        assert autopilot.reference.position == pytest.approx(autopilot.estimate.position[:2])
    autopilot.sticks(goal, 0.02 * k + 0.02)
    assert autopilot.reference.acceleration[0] < 0.0, "now it moves"


def test_until_the_speed_is_known_the_height_asked_for_is_that_of_the_estimate_too():
    def rising(at):
        vague = np.diag([2e-2] * 6) ** 2
        return replace(look(at, 0.0), position_flu=np.array([0.0, 0.0, -2.0 - 0.6 * at]), covariance=vague)

    autopilot, at = begin(rising(0.0)), 0.0
    while True:
        at += 0.02
        autopilot.estimator.advance(at)
        autopilot.estimator.target_seen(rising(at), at)
        if autopilot.estimator.velocity_sd <= UNKNOWN_SPEED:
            break
        autopilot.sticks(at_origin(2.0), at)
        found = autopilot.estimate
        # From there it goes on towards its goal, for one step.
        assert autopilot.height.position[0] == pytest.approx(found.position[2] + 0.02 * found.velocity[2], abs=2e-3)
    assert found.position[2] > 2.01


@pytest.mark.parametrize(("yaw", "way"), [(0.8, (1.0, 0.0)), (2.3, (0.0, 1.0)), (-2.0, (-0.6, 0.8))])
def test_sticks_lean_towards_a_goal_in_any_direction(yaw, way):
    _, sticks = held(1.5, yaw=yaw, goal=Goal(position=np.array([0.4 + 0.5 * way[0], 0.5 * way[1], 2.0])))
    pitch, roll = (sum(getattr(each, axis) for each in sticks[-25:]) for axis in ("pitch", "roll"))
    forwards, right = np.array([np.cos(yaw), np.sin(yaw)]), np.array([np.sin(yaw), -np.cos(yaw)])
    size = np.hypot(pitch, roll)
    assert size > 25
    assert [pitch, roll] == pytest.approx([size * (forwards @ way), size * (right @ way)], abs=0.12 * size)
