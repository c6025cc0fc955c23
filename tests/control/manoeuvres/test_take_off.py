"""A take-off: throttle on the ground, blind, off the ground, at its height, in the air already, and what ends it."""

from __future__ import annotations

import math

import pytest

from mkdaemon.config.autopilot import AutopilotConfig
from mkdaemon.control.estimator.values import GAS_CENTRE, OURS
from mkdaemon.control.limiter import StickCounts, Sticks
from mkdaemon.control.manoeuvres.hold import Hold
from mkdaemon.control.manoeuvres.level import Level
from mkdaemon.control.manoeuvres.manoeuvre import WORDS
from mkdaemon.control.manoeuvres.take_off import IDLE_GAS, OLDEST, TakeOff, TakeOffFlight, TakeOffLimits, TakeOffPhase
from mkdaemon.telemetry.control import Outcome
from mkdaemon.telemetry.setpoint import TakeOffSetpoint
from mkdaemon.telemetry.state import AngleScale, Attitude
from tests.control.events import STAMP
from tests.control.manoeuvres.hovering import CFG, STEP, Hovering, view

IDLE = Sticks(0.0, 0.0, 0.0, IDLE_GAS - 127.0)
HOVER = 125.0
"""Throttle that the aircraft is believed to need [count of 254]."""
CLIMB_FROM = 3.0
"""When throttle rises [s]."""


def setpoint(height):
    return TakeOffSetpoint(epoch=1, sequence=1, ttl=0.3, height=height)


def on_ground(height=1.5, cfg=CFG):
    """An aircraft that stands where its camera sees nothing, and its take-off."""
    aircraft = Hovering((0.0, 0.0, 0.1), cfg=cfg)
    aircraft.sees = False
    return aircraft, aircraft.begin(TakeOffFlight(aircraft.sight, cfg, setpoint(height)))


def attitude(pitch=0.0, roll=0.0):
    fields = {"quaternion": (1.0, 0.0, 0.0, 0.0), "yaw": 0.0, "scale": AngleScale.STICKS, "source": ""}
    return Attitude(stamp=STAMP, pitch=pitch, roll=roll, **fields)


def lift(aircraft, take_off, height):
    """Throttle that lifts it was sent for 0.4 s, and two images show it off the ground; the estimate starts again."""
    for k in range(50, 0, -1):
        gas = 1.2 * HOVER if k <= 20 else IDLE_GAS
        aircraft.sight.sticks_made(StickCounts(0, 0, 0, round(gas - GAS_CENTRE)), OURS, aircraft.now - STEP * k)
    for k in (1, 0):
        seen = view(aircraft.now - 0.04 * k, (*aircraft.place[:2], height))
        lifted = take_off.height_seen(height, seen.at)
    assert lifted is not None
    aircraft.place = (*aircraft.place[:2], height)
    aircraft.sight.view_received("pad", seen, aircraft.now, lifted=lifted, may_change=True)
    aircraft.sees = True
    return lifted


def test_before_the_flight_it_is_idle_and_begins_anew_whenever_a_flight_does():
    aircraft, take_off = on_ground()
    steps = aircraft.fly(take_off, 5.0, is_flying=False)
    assert {(step.sticks, step.stage, step.end, step.stands) for step in steps} == {
        (IDLE, "idle: the pilot raises his throttle", None, False)
    }
    assert take_off.stepped_at == aircraft.now
    flown = aircraft.fly(take_off, CLIMB_FROM - STEP)
    assert {(step.sticks, step.stands) for step in flown} == {(IDLE, True)}, "not a moment of the wait counts"
    assert aircraft.fly(take_off, 0.2)[-1].stage == "throttle rises"
    assert aircraft.fly(take_off, STEP, is_flying=False)[0].stage == "idle: the pilot raises his throttle"
    assert aircraft.fly(take_off, STEP)[0].sticks == IDLE


def test_throttle_rises_level_until_an_image_should_have_shown_something():
    aircraft, take_off = on_ground(cfg=AutopilotConfig(takeoff_ready=1.0))
    steps = aircraft.fly(take_off, 3.0)
    rising = [step.sticks.throttle + 127.0 for step in steps if step.stage == "throttle rises"]
    assert rising[0] == pytest.approx(IDLE_GAS, abs=1.0)
    assert max(rising) == pytest.approx(1.25 * HOVER, abs=1.0)
    assert rising == sorted(rising)
    assert {(step.sticks.pitch, step.sticks.roll, step.sticks.yaw) for step in steps} == {(0.0, 0.0, 0.0)}
    ended = [step for step in steps if step.end is not None]
    assert {(step.end.outcome, step.stage, step.stands) for step in ended} == {(Outcome.NOT_LIFTED, "failed", False)}
    # A second at the lowest, 0.33 s to the throttle that may carry, 1.2 s blind, and one step.
    assert len(steps) - len(ended) == pytest.approx((1.0 + 0.33 + 1.2) / STEP, abs=3)


@pytest.mark.parametrize(("pitch", "roll"), [(0.3, 0.0), (-0.3, 0.0), (0.0, 0.3), (0.0, -0.3)])
def test_foot_that_sticks_cuts_the_throttle_and_ends_it(pitch, roll):
    aircraft, take_off = on_ground(cfg=AutopilotConfig(takeoff_ready=0.0))
    aircraft.sight.attitude_received(attitude(0.2, -0.2))
    assert aircraft.fly(take_off, 0.1)[-1].stage == "throttle rises"
    aircraft.sight.attitude_received(attitude(pitch, roll))
    steps = aircraft.fly(take_off, 1.2)
    assert {(step.sticks, step.stage) for step in steps} == {(IDLE, "failed")}
    ends = [None if step.end is None else step.end.outcome for step in steps]
    assert ends.count(None) == pytest.approx(1.0 / STEP, abs=2)
    assert ends[-1] is Outcome.TIPPED
    assert "it tips over" in steps[-1].end.words


@pytest.mark.parametrize(("pause", "gone"), [(0.1, 0.25), (2.0, 0.25), (0.04, 0.1), (0.001, 0.0125)])
def test_throttle_never_leaps_after_a_pause(pause, gone):
    aircraft, take_off = on_ground(cfg=AutopilotConfig(takeoff_ready=0.0))
    before = aircraft.fly(take_off, 0.1)[-1].sticks.throttle
    step = take_off.step(aircraft.now + pause, is_flying=True)
    assert step.sticks.throttle - before == pytest.approx(gone * HOVER, abs=1.1)
    assert take_off.stepped_at == aircraft.now + pause


def test_off_the_ground_it_climbs_straight_up_first_then_over_the_middle():
    aircraft, take_off = on_ground(height=1.2)
    aircraft.place = (0.3, 0.0, 0.1)
    aircraft.fly(take_off, CLIMB_FROM + 0.3)
    lift(aircraft, take_off, 0.25)
    low = aircraft.fly(take_off, 0.5)
    assert {(step.stage, step.stands, step.is_done) for step in low} == {("climbs", False, False)}
    assert low[-1].error.goal == (0.0, 0.0, 1.2), "what is shown is where it is to be in the end"
    assert low[-1].sticks.throttle > 0.0, "upwards"
    assert abs(low[-1].sticks.pitch) <= 1.0, "straight up"
    aircraft.sight.estimator = None
    aircraft.place = (0.3, 0.0, 0.85)
    aircraft.look()
    assert aircraft.fly(take_off, 0.5)[-1].sticks.pitch < -1.0, "towards the middle"


@pytest.mark.parametrize(("asked", "at"), [(1.2, 1.2), (8.0, 2.0)])
def test_at_the_height_asked_for_or_that_of_the_fence_it_holds(asked, at):
    cfg = AutopilotConfig(takeoff_ready=0.0, fence_height=2.0)
    aircraft, take_off = on_ground(asked, cfg)
    aircraft.fly(take_off, 0.3)
    lift(aircraft, take_off, 0.25)
    aircraft.place = (0.0, 0.0, at)
    aircraft.sight.estimator = None
    aircraft.look()
    steps = aircraft.fly(take_off, 1.5)
    assert steps[0].error.goal == (0.0, 0.0, at)
    assert {(step.stage, step.is_done) for step in steps} == {("climbs", False), ("at height", True)}
    assert sum(step.is_done for step in steps) == pytest.approx(0.5 / STEP, abs=3)
    aircraft.place = (0.0, 0.0, 0.5)
    aircraft.sight.estimator = None
    aircraft.look()
    [after] = aircraft.fly(take_off, STEP)
    assert (after.stage, after.is_done) == ("at height", True), "it has been there"


def test_another_height_is_climbed_to_at_once():
    aircraft, take_off = on_ground(1.0, AutopilotConfig(takeoff_ready=0.0))
    aircraft.fly(take_off, 0.3)
    lift(aircraft, take_off, 0.25)
    assert aircraft.fly(take_off, STEP)[0].error.goal[2] == 1.0
    take_off.follow(setpoint(1.6))
    assert aircraft.fly(take_off, STEP)[0].error.goal[2] == 1.6


def test_far_from_its_middle_it_climbs_all_the_way_before_it_crosses():
    aircraft, take_off = on_ground(cfg=AutopilotConfig(takeoff_ready=0.0))
    aircraft.place = (-4.0, 0.0, 0.1)
    aircraft.fly(take_off, 0.3)
    lift(aircraft, take_off, 0.25)
    leans = []
    for height in (1.0, 1.45):
        aircraft.place = (-4.0, 0.0, height)
        steps = aircraft.fly(take_off, 1.0)
        leans.append(max(math.hypot(step.sticks.pitch, step.sticks.roll) for step in steps))
    assert leans[0] < 3.0 < 10.0 < leans[1]


def test_throttle_found_on_the_way_up_is_what_the_flight_begins_with():
    aircraft, take_off = on_ground(cfg=AutopilotConfig(takeoff_ready=0.0))
    aircraft.fly(take_off, 0.3)
    lifted = lift(aircraft, take_off, 0.25)
    assert aircraft.sight.estimator.hover_gas == lifted.hover_gas


def test_image_before_the_throttle_rises_lifts_nothing():
    _, take_off = on_ground()
    assert take_off.height_seen(0.5, 10.0) is None
    assert take_off.height_seen(0.6, 10.1) is None
    assert take_off.take_off is None


@pytest.mark.parametrize("is_by_target", [True, False])
def test_in_the_air_by_the_target_only_the_climb_is_left(is_by_target):
    aircraft = Hovering((0.0, 0.0, 1.0)).watch(1.0)
    before = Hold(aircraft.sight, CFG) if is_by_target else Level(aircraft.sight)
    aircraft.fly(aircraft.begin(before), 0.5)
    take_off = aircraft.begin(TakeOffFlight(aircraft.sight, CFG, setpoint(2.0)), before)
    [step] = aircraft.fly(take_off, STEP)
    assert step.stage == ("climbs" if is_by_target else "idle: the pilot raises his throttle")
    assert (step.sticks == IDLE) is not is_by_target


def test_an_abort_on_the_ground_ends_it_and_one_in_the_air_holds():
    aircraft, take_off = on_ground(cfg=AutopilotConfig(takeoff_ready=0.0))
    assert isinstance(take_off.abort(aircraft.now), Hold), "nothing has begun"
    aircraft.fly(take_off, 0.3)
    assert take_off.abort(aircraft.now) is take_off
    [step] = aircraft.fly(take_off, STEP)
    assert (step.end.outcome, step.end.words) == (Outcome.TAKE_OFF_ABORTED, "take-off ended: aborted")
    aircraft, take_off = on_ground(cfg=AutopilotConfig(takeoff_ready=0.0))
    aircraft.fly(take_off, 0.3)
    lift(aircraft, take_off, 0.25)
    aircraft.fly(take_off, 0.2)
    assert isinstance(take_off.abort(aircraft.now), Hold)


def test_off_the_ground_it_goes_down_the_ladder_as_every_flight_by_the_target_does():
    cfg = AutopilotConfig(takeoff_ready=0.0)
    aircraft, take_off = on_ground(cfg=cfg)
    aircraft.fly(take_off, 0.3)
    lift(aircraft, take_off, 0.25)
    aircraft.fly(take_off, 0.2)
    aircraft.sees = False
    steps = aircraft.fly(take_off, cfg.exit_after + 0.1)
    assert steps[-1].end.outcome is Outcome.SIGHT_LOST


def test_a_source_that_still_shows_the_ground_outvotes_no_camera():
    take_off, now, risen = TakeOff(TakeOffLimits(), 118.0, 10.0), 10.0, ()
    while take_off.phase is not TakeOffPhase.RAMP:
        now += 0.02
        take_off.gas(now, 0.02, 0.0)
    for later, height, is_placed in ((0.0, 0.1, True), (0.01, 0.4, False), (0.02, 0.1, True), (0.04, 0.45, False)):
        assert risen == ()
        risen = take_off.seen(height, now + later, is_placed=is_placed)
    assert [at for at, _ in risen] == [now + 0.01, now + 0.04]


LIMITS = TakeOffLimits(ready=1.0)
WEIGHT = 120.0


def run(take_off, start, seconds, tilt=0.0):
    """Go on for a time; returns every throttle with its time."""
    steps = round(seconds / STEP)
    return [(start + k * STEP, take_off.gas(start + k * STEP, STEP, tilt)) for k in range(1, steps + 1)]


@pytest.fixture
def take_off():
    return TakeOff(LIMITS, WEIGHT, 0.0)


def test_two_images_of_a_climbing_aircraft_give_it_to_the_autopilot_with_the_heights_of_its_feet(take_off):
    run(take_off, 0.0, 1.6)
    assert take_off.seen(0.20, 1.50) == ()
    assert take_off.is_blind
    assert take_off.seen(0.22, 1.53) == ((1.50, pytest.approx(0.10)), (1.53, pytest.approx(0.12)))
    assert not take_off.is_blind
    assert take_off.seen(0.3, 1.6) == (), "it is known by now"


def test_one_image_of_a_climbing_aircraft_takes_the_throttle_back_to_hover_until_the_next(take_off):
    run(take_off, 0.0, 1.6)
    take_off.seen(0.20, 1.50)
    assert run(take_off, 1.6, STEP)[-1][1] == pytest.approx(WEIGHT)
    take_off.seen(0.11, 1.53)
    assert run(take_off, 1.62, STEP)[-1][1] > WEIGHT


def test_blind_time_counts_from_one_image_in_the_air_if_no_other_follows():
    take_off, _ = ramp(0.1)
    take_off.seen(0.20, LIMITS.ready + 0.05)
    run(take_off, LIMITS.ready + 0.1, LIMITS.blind + 0.1)
    assert take_off.failure is Outcome.NOT_LIFTED


def test_old_images_do_not_hand_a_flying_aircraft_to_the_autopilot_and_just_young_enough_ones_do(take_off):
    for k in range(1, round((LIMITS.ready + LIMITS.blind + 0.6) / STEP)):
        take_off.gas(k * STEP, STEP, 0.0)
        assert take_off.seen(0.2 + 0.01 * k, k * STEP - OLDEST - 0.01) == ()
    assert take_off.is_over
    assert take_off.failure is Outcome.NOT_LIFTED
    assert all(words in WORDS[take_off.failure] for words in ("too old", "gate", "hover_throttle"))
    young, _ = ramp(1.0)
    assert young.seen(0.20, 2.0 - OLDEST + 0.01) == ()
    assert young.seen(0.22, 2.0 - OLDEST + 0.03) != ()


def test_in_the_air_only_the_climb_is_left_and_cannot_fail():
    take_off = TakeOff(LIMITS, WEIGHT, 0.0, is_in_air=True)
    assert not take_off.is_blind
    take_off.fail(Outcome.TAKE_OFF_ABORTED)
    assert take_off.phase is TakeOffPhase.CLIMB
    take_off.arrived()
    take_off.arrived()
    assert take_off.phase is TakeOffPhase.REACHED


def ramp(seconds):
    """A take-off whose throttle has risen for so long, and its throttles."""
    take_off = TakeOff(LIMITS, WEIGHT, 0.0)
    run(take_off, 0.0, LIMITS.ready)
    assert take_off.phase is TakeOffPhase.RAMP
    return take_off, [gas / WEIGHT for _, gas in run(take_off, LIMITS.ready, seconds)]


def test_throttle_rises_by_its_slope_from_idle_to_its_bound():
    _, shares = ramp(0.6)
    assert shares == pytest.approx(
        [min(IDLE_GAS / WEIGHT + LIMITS.rise * STEP * k, LIMITS.most) for k in range(1, len(shares) + 1)]
    )


def test_blind_time_counts_from_the_throttle_that_may_carry():
    until = LIMITS.rises_for(WEIGHT) + LIMITS.blind
    take_off, _ = ramp(until - STEP)
    assert take_off.phase is TakeOffPhase.RAMP
    run(take_off, LIMITS.ready + until - STEP, 3 * STEP)
    assert take_off.phase is TakeOffPhase.FAILED
    assert take_off.failure is Outcome.NOT_LIFTED


@pytest.mark.parametrize(("tilt", "fails"), [(0.255, False), (0.265, True)])
def test_a_foot_that_sticks_ends_it_at_fifteen_degrees(tilt, fails):
    take_off = TakeOff(LIMITS, WEIGHT, 0.0)
    run(take_off, 0.0, 0.5, tilt=0.5)
    assert take_off.phase is TakeOffPhase.IDLE, "before the throttle rises a tilt ends nothing"
    take_off, _ = ramp(0.1)
    run(take_off, LIMITS.ready + 0.1, STEP, tilt=tilt)
    assert take_off.failure is (Outcome.TIPPED if fails else None)


@pytest.mark.parametrize(
    ("images", "flies"),
    [
        ([(0.20, 1.50), (0.22, 1.53)], True),
        ([(0.165, 1.50), (0.165, 1.53)], True),
        ([(0.155, 1.50), (0.22, 1.53)], False),  # the first shows it no higher than 6 cm above where it stands
        ([(0.22, 1.50), (0.155, 1.53)], False),
        ([(0.22, 1.53), (0.22, 1.50)], False),  # in another order than taken
        ([(0.22, 1.50), (0.22, 1.50)], False),
        ([(0.22, 1.50)], False),
    ],
)
def test_two_images_in_a_row_must_show_it_above_the_ground(images, flies):
    take_off, _ = ramp(0.6)
    found = [take_off.seen(height, at) for height, at in images]
    assert (found[-1] != ()) is flies
    assert take_off.is_blind is not flies
