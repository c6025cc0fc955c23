"""What manoeuvres against a target have in common: the ladder out of sight, the reference, fence, arrival, error."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mkdaemon.config.autopilot import AutopilotConfig
from mkdaemon.control.limiter import Sticks
from mkdaemon.control.manoeuvres.by_target import SEARCHES, TURNED, Arrival, error_value
from mkdaemon.control.manoeuvres.goto import Goto
from mkdaemon.control.manoeuvres.hold import Hold
from mkdaemon.control.manoeuvres.velocity import FlyVelocity
from mkdaemon.control.regulator.autopilot import Goal
from mkdaemon.control.sight import Sight
from mkdaemon.telemetry.control import Outcome
from mkdaemon.telemetry.setpoint import PositionSetpoint, SetpointFrame, VelocitySetpoint
from tests.control.flying import placed
from tests.control.manoeuvres.hovering import CFG, STEP, Hovering

BASE = {"epoch": 1, "sequence": 1, "ttl": 0.3}
ABOVE = (0.0, 0.0, 2.0)


def to(position, frame=SetpointFrame.PAD, yaw=None):
    return PositionSetpoint(**BASE, position=position, frame=frame, yaw=yaw)


def at_speed(velocity, frame=SetpointFrame.PAD, yaw_rate=0.0):
    return VelocitySetpoint(**BASE, velocity=velocity, frame=frame, yaw_rate=yaw_rate)


def goto(aircraft, position, frame=SetpointFrame.PAD, yaw=None, before=None):
    return aircraft.begin(Goto(aircraft.sight, aircraft.cfg, to(position, frame, yaw)), before)


def where_it_rests(aircraft, manoeuvre):
    """Where a hold stays that begins now: the one place where the reference shows."""
    [step] = aircraft.fly(aircraft.begin(Hold(aircraft.sight, aircraft.cfg), manoeuvre), STEP)
    return np.array(step.error.goal)


@pytest.fixture(scope="module")
def settled():
    """Seconds of images at one place; who flies from here takes an aircraft of his own."""

    def make(place=ABOVE, **fields):
        return Hovering(place, **fields).watch(1.0)

    return make


def test_without_any_target_it_ends_at_once_at_the_throttle_that_was_believed():
    sight = Sight(CFG, -9.0)
    step = Hold(sight, CFG).step(1.0, is_flying=True)
    assert step.end.outcome is Outcome.NO_TARGET
    assert step.sticks == Sticks(0.0, 0.0, 0.0, -9.0)
    assert step.obstacle == "waiting for a target in sight"


def test_out_of_sight_it_flies_on_then_searches_then_ends(settled):
    aircraft = settled()
    hold = aircraft.begin(Hold(aircraft.sight, CFG))
    aircraft.fly(hold, 1.0)
    aircraft.sees, last = False, aircraft.now
    steps = {round(step_at - last, 3): step for step_at, step in timed(aircraft, hold, 3.2)}
    flown = [step for age, step in steps.items() if age < CFG.search_after]
    assert all(step.error is not None and not step.obstacle for step in flown)
    search = {age: step for age, step in steps.items() if age > CFG.search_after + 2 * STEP}
    assert {(step.obstacle, step.stage, step.error) for age, step in search.items() if age < 1.5} == {
        ("waiting for a target in sight", SEARCHES, None)
    }
    carries = aircraft.sight.estimator.hover_gas - 127.0
    assert max(step.sticks.throttle for age, step in search.items() if age < 1.5) > carries, "it rises"
    ends = [age for age, step in steps.items() if step.end is not None]
    assert min(ends) == pytest.approx(CFG.exit_after, abs=2 * STEP + 1e-6)
    end = steps[min(ends)].end
    assert (end.outcome, end.is_failure) == (Outcome.SIGHT_LOST, True)
    assert end.words.startswith("no image of pad for 3.")


def test_where_the_aircraft_may_be_outside_the_fence_it_does_not_search():
    cfg = AutopilotConfig(fence_radius=0.2)
    aircraft = Hovering(ABOVE, cfg=cfg).watch(1.0)
    hold = aircraft.begin(Hold(aircraft.sight, cfg))
    aircraft.fly(hold, 1.0)
    aircraft.sees = False
    step = aircraft.fly(hold, 2.5)[-1]
    level = Sticks(0.0, 0.0, 0.0, round(aircraft.sight.estimator.hover_gas - 127.0))
    assert (step.stage, step.sticks) == ("", level)


def timed(aircraft, manoeuvre, seconds):
    for _ in range(round(seconds / STEP)):
        [step] = aircraft.fly(manoeuvre, STEP)
        yield aircraft.now, step


def test_without_a_young_image_the_goal_waits_where_the_reference_is(settled):
    aircraft = settled()
    ahead = goto(aircraft, (3.0, 0.0, 2.5))
    assert aircraft.fly(ahead, 1.0)[-1].error.goal == (3.0, 0.0, 2.5)
    aircraft.sees = False
    aircraft.fly(ahead, CFG.freeze_after + 2 * STEP)
    frozen = [step.error.goal for step in aircraft.fly(ahead, 0.6)]
    resting = where_it_rests(aircraft, ahead)
    assert 0.2 < frozen[-1][0] < 2.0, "on the way"
    assert frozen[-1][2] == pytest.approx(2.0, abs=0.05), "the height it is at, not the one wanted"
    assert frozen[-1][0] == pytest.approx(resting[0], abs=0.3)
    speeds = np.diff([goal[0] for goal in frozen]) / STEP
    assert speeds[-1] < 0.5 * speeds[0], "the reference comes to a stop"


def test_nothing_is_reached_out_of_sight(settled):
    aircraft = settled()
    there = goto(aircraft, ABOVE)
    assert aircraft.fly(there, 2.0)[-1].is_done
    aircraft.sees = False
    steps = aircraft.fly(there, 0.5)
    assert steps[0].is_done
    assert not steps[-1].is_done


def test_nothing_is_reached_before_the_flight(settled):
    aircraft = settled()
    there = goto(aircraft, ABOVE)
    assert not any(step.is_done for step in aircraft.fly(there, 2.0, is_flying=False))
    assert not aircraft.fly(there, CFG.arrived_for - 2 * STEP)[-1].is_done, "the time counts from the flight on"
    assert aircraft.fly(there, 3 * STEP)[-1].is_done


def test_before_the_flight_the_reference_begins_anew_at_every_step(settled):
    aircraft = settled()
    ahead = goto(aircraft, (4.0, 0.0, 2.0))
    aircraft.fly(ahead, 2.0, is_flying=False)
    assert where_it_rests(aircraft, ahead) == pytest.approx(ABOVE, abs=0.05)


def test_reference_goes_no_faster_than_configured(settled):
    for cfg in (CFG, AutopilotConfig(max_speed=0.6, max_acceleration=0.5, max_climb=0.3)):
        aircraft = settled(cfg=cfg)
        ahead = goto(aircraft, (4.5, 0.0, 6.0))
        aircraft.fly(ahead, 3.0)
        x, y, z = where_it_rests(aircraft, ahead)
        # Up to speed with constant acceleration, the rest at speed, a third of a second more until it comes to rest.
        gone = [
            v * (3.0 - v / a / 2.0) + 0.335 * v
            for v, a in ((cfg.max_speed, cfg.max_acceleration), (cfg.max_climb, 0.8))
        ]
        assert (x, y) == pytest.approx((gone[0], 0.0), abs=0.12)
        assert z - 2.0 == pytest.approx(gone[1], abs=0.08)


def test_tilt_asked_for_is_bounded_as_configured(settled):
    largest = {}
    for max_tilt in (0.1, 0.2):
        aircraft = settled(cfg=AutopilotConfig(max_tilt=max_tilt))
        ahead = goto(aircraft, (4.5, 0.0, 2.0))
        counts = [step.sticks.pitch for step in aircraft.fly(ahead, 2.0)]
        largest[max_tilt] = max(counts) * aircraft.sight.model.rad_per_count
    assert largest == pytest.approx({0.1: 0.1, 0.2: 0.2}, abs=0.01)


def test_manoeuvre_goes_on_with_the_reference_of_the_one_before_it(settled):
    aircraft = settled()
    ahead = goto(aircraft, (4.0, 0.0, 2.0))
    aircraft.fly(ahead, 2.0)
    then = goto(aircraft, (4.0, 0.0, 2.0), before=ahead)
    assert then.stepped_at == ahead.stepped_at
    aircraft.fly(then, 1.0)
    alone = settled()
    one = goto(alone, (4.0, 0.0, 2.0))
    alone.fly(one, 3.0)
    assert where_it_rests(aircraft, then) == pytest.approx(where_it_rests(alone, one), abs=1e-9)


@pytest.mark.parametrize("pause", [0.1, 0.5, 3.0])
def test_reference_never_leaps_after_a_pause(settled, pause):
    aircraft = settled()
    ahead = goto(aircraft, (4.5, 0.0, 2.0))
    aircraft.fly(ahead, 2.0)
    before = where_it_rests(aircraft, ahead)[0]
    aircraft.watch(pause - STEP)
    [step] = aircraft.fly(ahead, STEP)
    gone = where_it_rests(aircraft, ahead)[0] - before
    assert step.error.goal == (4.5, 0.0, 2.0)
    assert gone == pytest.approx(CFG.max_speed * 0.1, abs=0.03), "a tenth of a second at most"


def test_another_estimate_begins_another_reference(settled):
    aircraft = settled()
    ahead = goto(aircraft, (4.0, 0.0, 2.0))
    aircraft.fly(ahead, 2.0)
    aircraft.sight.estimator = None
    aircraft.place = (0.5, -0.5, 1.5)
    aircraft.look()
    aircraft.fly(ahead, STEP)
    assert where_it_rests(aircraft, ahead) == pytest.approx(aircraft.place, abs=0.1)


def test_hold_stays_at_one_place_until_the_estimate_is_another(settled):
    aircraft = settled()
    hold = aircraft.begin(Hold(aircraft.sight, CFG))
    [place] = {step.error.goal for step in aircraft.fly(hold, 1.0)}
    assert place == pytest.approx(ABOVE, abs=0.05)
    aircraft.sight.estimator = None
    aircraft.place = (0.5, -0.5, 1.5)
    aircraft.look()
    [place] = {step.error.goal for step in aircraft.fly(hold, 1.0)}
    assert place == pytest.approx(aircraft.place, abs=0.1)


def body_goal(aircraft, manoeuvre):
    return np.array(aircraft.fly(manoeuvre, STEP)[-1].error.goal)


def test_place_from_the_aircrafts_own_counts_from_where_it_was_and_how_it_pointed(settled):
    aircraft = settled((0.4, 0.3, 2.0), yaw=math.pi / 2)
    ahead = goto(aircraft, (1.0, 0.5, 0.25), SetpointFrame.BODY)
    assert body_goal(aircraft, ahead) == pytest.approx((0.4 - 0.5, 0.3 + 1.0, 2.25), abs=0.05)
    first = body_goal(aircraft, ahead)
    aircraft.fly(ahead, 1.0)
    assert body_goal(aircraft, ahead) == pytest.approx(first, abs=1e-9), "it was there when the position first arrived"
    ahead.follow(to((1.0, 0.5, 0.25), SetpointFrame.BODY).model_copy(update={"sequence": 2}))
    assert body_goal(aircraft, ahead) == pytest.approx(first, abs=1e-9), "the same place again is the same place"
    ahead.follow(to((1.0, 0.5, 0.5), SetpointFrame.BODY))
    moved = body_goal(aircraft, ahead) - first
    assert moved[1] > 0.3, "another place counts from where the reference is by now"
    assert moved[1] == pytest.approx(-2.0 * moved[0], abs=0.1), "it is on its way"
    assert moved[2] > 0.25


@pytest.mark.parametrize("yaw", [0.3, -0.3, None])
def test_heading_from_the_aircrafts_own_counts_from_where_the_nose_pointed(settled, yaw):
    aircraft = settled(yaw=1.0)
    [step] = aircraft.fly(goto(aircraft, (0.0, 0.0, 0.0), SetpointFrame.BODY, yaw), STEP)
    assert step.error.error_yaw == (None if yaw is None else pytest.approx(-yaw, abs=0.01))
    assert np.sign(step.sticks.yaw) == np.sign(yaw or 0.0)


@pytest.mark.parametrize(("frame", "direction"), [(SetpointFrame.PAD, (1.0, 0.0)), (SetpointFrame.BODY, (0.0, 1.0))])
def test_velocity_aims_ahead_in_its_frame_and_goes_no_faster_than_asked(settled, frame, direction):
    aircraft = settled(yaw=math.pi / 2)
    ahead = aircraft.begin(FlyVelocity(aircraft.sight, CFG, at_speed((0.4, 0.0, 0.1), frame)))
    first = body_goal(aircraft, ahead)
    lead = CFG.velocity_lead
    assert first == pytest.approx((0.4 * lead * direction[0], 0.4 * lead * direction[1], 2.0 + 0.1 * lead), abs=0.05)
    aircraft.fly(ahead, 3.0)
    gone = where_it_rests(aircraft, ahead)
    assert gone[:2] @ np.array(direction) == pytest.approx(0.4 * 3.3, abs=0.12)
    assert abs(gone[:2] @ np.array([direction[1], -direction[0]])) < 0.06


@pytest.mark.parametrize("yaw_rate", [0.1, -0.1, 0.0])
def test_velocity_turns_as_it_is_asked_to(settled, yaw_rate):
    aircraft = settled()
    ahead = aircraft.begin(FlyVelocity(aircraft.sight, CFG, at_speed((0.0, 0.0, 0.0), yaw_rate=yaw_rate)))
    assert np.sign(aircraft.fly(ahead, STEP)[-1].sticks.yaw) == np.sign(yaw_rate)


def test_velocity_that_changes_is_followed(settled):
    aircraft = settled()
    ahead = aircraft.begin(FlyVelocity(aircraft.sight, CFG, at_speed((0.4, 0.0, 0.0))))
    aircraft.fly(ahead, 0.5)
    ahead.follow(at_speed((0.0, -0.4, 0.0)))
    assert body_goal(aircraft, ahead)[1] < -0.4


@given(
    wanted=st.tuples(*[st.floats(-20.0, 20.0)] * 3),
    radius=st.floats(0.5, 8.0),
    floor=st.floats(0.0, 1.0),
    height=st.floats(2.0, 6.0),
)
def test_place_outside_the_fence_becomes_the_nearest_one_inside(wanted, radius, floor, height):
    cfg = AutopilotConfig(fence_radius=radius, fence_floor=floor, fence_height=height)
    found = Hold(Sight(cfg, 0.0), cfg)._inside_fence(np.array(wanted))
    away = math.hypot(*wanted[:2])
    assert found[2] == min(max(wanted[2], floor), height)
    assert math.hypot(*found[:2]) == pytest.approx(min(away, radius), abs=1e-9)
    assert found[:2] * away == pytest.approx(np.array(wanted[:2]) * math.hypot(*found[:2]), abs=1e-6), "same direction"


STILL = Hovering().watch(0.1)


def estimate_at(aircraft, position, yaw=0.0):
    return replace(placed(aircraft.sight.estimator.estimate(aircraft.now), position), yaw=yaw)


@pytest.mark.parametrize(
    ("place", "yaw", "arrives"),
    [
        ((0.149, 0.0, 2.0), 0.0, True),
        ((0.151, 0.0, 2.0), 0.0, False),
        ((0.0, 0.0, 1.849), 0.0, False),
        ((0.1, 0.1, 2.1), 0.0, False),
        (ABOVE, TURNED - 1e-6, True),
        (ABOVE, TURNED + 1e-6, False),
        (ABOVE, -TURNED - 1e-6, False),
        (ABOVE, math.tau - 0.1, True),
    ],
)
def test_place_is_reached_within_a_distance_and_eight_degrees(settled, place, yaw, arrives):
    aircraft, arrival = settled(), Arrival(0.15, 1.0)
    goal = Goal(position=np.array(ABOVE), yaw=0.0)
    seen = estimate_at(aircraft, place, yaw)
    found = [arrival.has_arrived(goal, seen, at) for at in (5.0, 5.5, 5.99, 6.0, 7.0)]
    assert found == [False, False, False, arrives, arrives]
    assert math.degrees(TURNED) == pytest.approx(8.0), "within half of it the compass lock holds"


def test_time_at_a_place_counts_anew_after_leaving_it_and_for_another_place(settled):
    aircraft, arrival = settled(), Arrival(0.15, 1.0)
    goal, there, away = Goal(position=np.array(ABOVE)), estimate_at(aircraft, ABOVE), estimate_at(aircraft, (1, 0, 2))
    assert not arrival.has_arrived(goal, there, 5.0)
    assert arrival.has_arrived(goal, there, 6.0)
    assert not arrival.has_arrived(goal, away, 6.1)
    assert not arrival.has_arrived(goal, there, 7.0)
    assert arrival.has_arrived(goal, there, 7.2)
    near = Goal(position=np.array([0.1, 0.0, 2.0]))
    assert not arrival.has_arrived(near, there, 7.3)
    assert arrival.has_arrived(near, there, 8.4)


@given(yaw=st.floats(-3.0, 3.0), wanted=st.floats(-3.0, 3.0), place=st.tuples(*[st.floats(-3.0, 3.0)] * 3))
def test_error_points_from_the_goal_to_the_aircraft_in_both_frames(yaw, wanted, place):
    goal = Goal(position=np.array([1.0, -2.0, 0.5]), yaw=wanted)
    error = error_value("hold", goal, estimate_at(STILL, place, yaw))
    assert (error.manoeuvre, error.goal) == ("hold", (1.0, -2.0, 0.5))
    assert error.error_pad == pytest.approx((place[0] - 1.0, place[1] + 2.0, place[2] - 0.5))
    body = complex(*error.error_body[:2]) * complex(math.cos(yaw), math.sin(yaw))
    assert (body.real, body.imag, error.error_body[2]) == pytest.approx(error.error_pad, abs=1e-9)
    assert math.remainder(yaw - wanted - error.error_yaw, math.tau) == pytest.approx(0.0, abs=1e-9)
    assert abs(error.error_yaw) <= math.pi
