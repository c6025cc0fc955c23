"""A landing from its beginning to the release: stages, loss of sight, abort, and what it leaves behind."""

from __future__ import annotations

import math

import numpy as np
import pytest

from mkdaemon.config.autopilot import AutopilotConfig
from mkdaemon.control.estimator.model import LARGEST_CUSHION, P, V
from mkdaemon.control.estimator.values import Estimate
from mkdaemon.control.limiter import Sticks
from mkdaemon.control.manoeuvres.by_target import SEARCHES
from mkdaemon.control.manoeuvres.hold import Hold
from mkdaemon.control.manoeuvres.land import Fall, Land, Landing, LandingLimits, LandingPhase
from mkdaemon.telemetry.control import Outcome
from mkdaemon.telemetry.setpoint import LandSetpoint
from tests.control.manoeuvres.hovering import CFG, STEP, Hovering

OFF = Sticks(0.0, 0.0, 0.0, -127.0)
"""Level, the lowest throttle."""
SECOND = round(1.0 / STEP)


def landing_of(place=(0.0, 0.0, 1.0), *, yaw=None, cfg=CFG, heading=0.0):
    """An aircraft over its target, and a landing that begins."""
    aircraft = Hovering(place, yaw=heading, cfg=cfg).watch(1.0)
    return aircraft, aircraft.begin(Land(aircraft.sight, cfg, yaw))


def sink(aircraft, land, until, *, seconds=6.0, sees_below=0.0):
    """Follow the wanted height down to a stage; returns every step; no image arrives below a height [m]."""
    steps = []
    for _ in range(round(seconds / STEP)):
        [step] = aircraft.fly(land, STEP)
        steps.append(step)
        if step.stage == until.value:
            return steps
        east, north, up = aircraft.place
        aircraft.place = (east, north, max(CFG.stand_height, min(up, step.error.goal[2])))
        aircraft.sees = aircraft.place[2] > sees_below
    pytest.fail(f"it is not at {until.value}: {steps[-1]}")


@pytest.fixture(scope="module")
def landed():
    """A whole landing: the aircraft, the manoeuvre, its steps until the feet stand, and those until its end."""
    aircraft, land = landing_of()
    down = sink(aircraft, land, LandingPhase.DOWN)
    return aircraft, land, down, aircraft.fly(land, CFG.stand_time + 2 * STEP)


def test_it_sinks_commits_and_stands(landed):
    _, _, down, _ = landed
    assert list(dict.fromkeys(step.stage for step in down)) == ["descend", "commit", "down"]
    seconds = len(down) * STEP
    assert 0.9 / 0.4 < seconds < 0.9 / 0.28 + 1.0, "no faster than it may sink"
    assert not any(step.is_done or step.stands or step.end for step in down[:-1])
    assert all(step.error.manoeuvre == step.manoeuvre == "land" for step in down[:-1])


def test_once_the_feet_stand_throttle_is_at_its_lowest_until_it_is_released(landed):
    _, _, down, after = landed
    stood = [down[-1], *after]
    assert {(step.sticks, step.stage, step.is_done, step.stands) for step in stood} == {(OFF, "down", True, True)}
    ends = [None if step.end is None else step.end.outcome for step in stood]
    assert ends[:SECOND] == [None] * SECOND
    assert ends[SECOND:] == [Outcome.LANDED] * 3
    assert after[-1].end.words == "landed on pad"
    assert not after[-1].end.is_failure


def test_standing_needs_no_estimate(landed):
    aircraft, land, _, _ = landed
    aircraft.sight.stand(is_standing=True)
    assert aircraft.sight.estimator is None
    [step] = aircraft.fly(land, STEP)
    assert (step.sticks, step.end.outcome) == (OFF, Outcome.LANDED)
    assert (step.stage, step.is_done, step.stands, step.may_touch) == ("down", True, True, True)
    assert land.stepped_at == aircraft.now


def test_throttle_that_carried_the_aircraft_is_remembered_for_the_next_flight():
    aircraft, land = landing_of()
    aircraft.sight.estimator.hover_gas = 140.0
    aircraft.fly(land, STEP)
    assert aircraft.sight.hover_gas == pytest.approx(140.0, abs=0.5)


def test_who_comes_down_beside_the_target_says_so():
    aircraft, land = landing_of()
    sink(aircraft, land, LandingPhase.COMMIT)
    aircraft.place = (0.45, 0.0, CFG.stand_height)
    aircraft.sight.estimator = None
    aircraft.look()
    steps = aircraft.fly(land, 2.0)
    assert steps[-1].stage == "down"
    assert steps[-1].end.outcome is Outcome.LANDED_ASIDE
    assert steps[-1].end.words == "came down, but nothing shows that it stands on pad"


def test_before_the_flight_it_keeps_its_place_and_is_at_no_stage():
    aircraft, land = landing_of()
    steps = aircraft.fly(land, 0.5, is_flying=False)
    assert {(step.stage, step.error, step.end, step.is_done, step.stands) for step in steps} == {
        ("", None, None, False, False)
    }
    assert steps[-1].sticks.throttle == pytest.approx(-2.0, abs=2.0), "it carries the aircraft"
    assert land.landing is None
    assert isinstance(land.abort(aircraft.now), Hold)


@pytest.mark.parametrize(
    ("heading", "wanted", "turns"), [(0.5, 0.0, -1), (-0.5, 0.0, 1), (0.5, None, 0), (0.5, 0.5, 0)]
)
def test_it_turns_to_its_heading_before_and_during_the_landing(heading, wanted, turns):
    aircraft, land = landing_of(yaw=wanted, heading=heading)
    for is_flying in (False, True):
        [step] = aircraft.fly(land, STEP, is_flying=is_flying)
        assert math.copysign(1.0, step.sticks.yaw) * bool(step.sticks.yaw) == turns
    assert step.error.error_yaw == (None if wanted is None else pytest.approx(heading - wanted, abs=0.01))
    land.follow(LandSetpoint(epoch=1, sequence=2, ttl=0.3, yaw=2.0))
    [step] = aircraft.fly(land, STEP)
    assert math.copysign(1.0, step.sticks.yaw) * bool(step.sticks.yaw) == turns, "the heading it began with"


@pytest.mark.parametrize(
    ("stage", "goes_on"),
    [(LandingPhase.DESCEND, False), (LandingPhase.COMMIT, True), (LandingPhase.DOWN, True)],
)
def test_an_abort_holds_before_the_last_decision_and_changes_nothing_after_it(stage, goes_on):
    aircraft, land = landing_of((0.0, 0.0, 0.5))
    sink(aircraft, land, stage)
    after = land.abort(aircraft.now)
    assert (after is land) is goes_on
    assert goes_on or isinstance(after, Hold)


def test_a_target_that_a_search_has_found_is_approached_again_from_there():
    aircraft, land = landing_of()
    aircraft.fly(land, 0.2)
    aircraft.sees = False
    assert aircraft.fly(land, CFG.search_after + 0.1)[-1].stage == SEARCHES
    aircraft.sees = True
    steps = aircraft.fly(land, 1.5)
    assert {step.end for step in steps} == {None}
    assert {step.stage for step in steps} <= {"approach", "descend"}
    assert steps[0].error.goal[2] == pytest.approx(aircraft.place[2], abs=0.15), "not where it was before the search"


def test_one_that_was_never_flown_does_not_go_down_blind():
    aircraft, land = landing_of()
    aircraft.sees = False
    aircraft.watch(CFG.search_after + 0.1)
    [step] = aircraft.fly(land, STEP)
    assert step.obstacle == "waiting for a target in sight"
    assert land.landing is None


def test_heights_of_a_landing_are_those_over_the_configured_feet():
    """With its feet 0.4 m below the camera it is 0.1 m above the target; with 0.1 m it would still go down."""
    aircraft, land = landing_of((0.0, 0.0, 0.5), cfg=AutopilotConfig(stand_height=0.4))
    assert aircraft.fly(land, 0.4)[-1].stage == "commit"


LIMITS = LandingLimits()


def estimate(at, height, *, climb=-0.28, age=0.1, sd=0.01, thrust=0.81, east=0.0):
    """The aircraft with its feet at a height [m] over the target."""
    axes = np.zeros((2, 9))
    axes[0, P] = east
    return Estimate(
        at=at,
        yaw=0.0,
        hover_gas=125.0,
        axes=axes,
        vertical=np.array([height + LIMITS.stand_height, climb, thrust - 1.0, 0.0]),
        position_sd=np.array([0.01, 0.01, sd]),
        age=age,
    )


def land(heights, **fields):
    """Feed heights, one a step; returns the landing and when it was over [s]."""
    landing = Landing(LIMITS, estimate(0.0, heights[0]))
    for k, height in enumerate(heights):
        landing.goal(estimate(k * STEP, height, **fields), None, STEP)
    return landing


@pytest.mark.parametrize("thrust", [0.75, 0.81, 0.9])
def test_a_predicted_height_below_the_ground_is_no_evidence(thrust):
    # The model knows no ground: 0.12 s after the commit it believes to be far below.
    landing = land([0.12] * 2 + [-0.3] * 6, age=0.4, thrust=thrust)
    assert landing.phase is LandingPhase.COMMIT


def test_a_blind_fall_ends_when_it_cannot_have_been_longer():
    steps = 60
    landing = Landing(LIMITS, estimate(0.0, 0.12))
    down = None
    for k in range(steps):
        landing.goal(estimate(k * STEP, 0.12, age=0.4 if k else 0.1, thrust=0.7), None, STEP)
        down = k * STEP if down is None and landing.phase is LandingPhase.DOWN else down
    assert down is not None
    # From 0.15 m at 0.13 m/s with less than a fifth of its weight missing: about 0.4 s, and the settling.
    assert 0.3 < down < 0.8


def test_with_thrust_that_carries_no_fall_is_ever_over():
    fall = Fall(0.12, -0.28, 0.01)
    assert not any(fall.has_ended(1.0, STEP) for _ in range(500))


def test_the_cushion_is_bounded_where_the_rotors_are_as_low_as_they_get():
    fall = Fall(-0.2, -0.28, 0.0)
    before = fall.climb
    fall.has_ended(1.0 / (LARGEST_CUSHION * 1.08), STEP)
    assert fall.climb == pytest.approx(before)


def phase_after(height, *, east=0.0, speed=0.0, age=0.1, sd=0.01):
    """Where a landing stands after one look at the aircraft."""
    seen = estimate(0.0, height, climb=0.0, age=age, sd=sd, east=east)
    seen.axes[0, V] = speed
    landing = Landing(LIMITS, seen)
    landing.goal(seen, None, STEP)
    return landing.phase


WAITS, SINKS, FINAL = LandingPhase.APPROACH, LandingPhase.DESCEND, LandingPhase.COMMIT


@pytest.mark.parametrize(
    ("fields", "phase"),
    [
        # The cone: 7 cm at the ground and 12 cm wider a metre, on both sides of its wall.
        ({"height": 1.0, "east": 0.185}, SINKS),
        ({"height": 1.0, "east": 0.195}, WAITS),
        ({"height": 1.0, "east": -0.195}, WAITS),
        ({"height": 2.0, "east": 0.305}, SINKS),
        ({"height": 2.0, "east": 0.315}, WAITS),
        ({"height": 0.3, "east": 0.1}, SINKS),
        ({"height": 0.3, "east": 0.112}, WAITS),
        ({"height": -0.2, "east": 0.068, "sd": 0.06}, SINKS),
        # Its speed, and the oldest image.
        ({"height": 1.0, "speed": 0.34}, SINKS),
        ({"height": 1.0, "speed": 0.36}, WAITS),
        ({"height": 1.0, "speed": -0.36}, WAITS),
        ({"height": 1.0, "age": 0.24}, SINKS),
        ({"height": 1.0, "age": 0.26}, WAITS),
        # Close to the ground the decision is final, over the target only.
        ({"height": 0.12}, FINAL),
        ({"height": 0.14}, SINKS),
        ({"height": 0.12, "east": 0.12, "speed": 1.0}, FINAL),
        ({"height": 0.12, "east": 0.14}, WAITS),
        ({"height": 0.12, "age": 0.59}, FINAL),
        ({"height": 0.12, "age": 0.61}, WAITS),
        ({"height": 0.12, "sd": 0.049}, FINAL),
        ({"height": 0.12, "sd": 0.051}, SINKS),
    ],
)
def test_it_goes_down_inside_the_cone_slowly_and_by_a_fresh_image_and_commits_close_to_the_ground(fields, phase):
    assert phase_after(**fields) is phase


@pytest.mark.parametrize(("height", "sink"), [(1.0, 0.40), (0.51, 0.40), (0.49, 0.28), (0.2, 0.28)])
def test_it_sinks_more_slowly_close_to_the_ground(height, sink):
    landing = Landing(LIMITS, estimate(0.0, height))
    goal = landing.goal(estimate(0.0, height), None, STEP)
    assert goal.climb == -sink
    assert goal.position[2] == pytest.approx(height + 0.10 - sink * STEP)
    for _ in range(100):  # an aircraft that does not follow is not left far behind
        goal = landing.goal(estimate(0.0, height), None, STEP)
    assert goal.position[2] == pytest.approx(height + 0.10 - 0.10)


@pytest.mark.parametrize(
    ("height", "age", "climb"), [(1.0, 0.41, 0.3), (1.0, 0.39, 0.0), (1.49, 0.41, 0.3), (1.51, 0.41, 0.0)]
)
def test_a_target_out_of_sight_is_looked_for_from_above_up_to_a_height(height, age, climb):
    landing = Landing(LIMITS, estimate(0.0, height, age=age))
    goals = [landing.goal(estimate(0.0, height, age=age), None, STEP) for _ in range(200)]
    assert goals[0].climb == climb
    assert goals[0].position[2] == pytest.approx(height + 0.10 + (0.5 * STEP if climb else 0.0))
    assert goals[-1].position[2] == pytest.approx(height + 0.10 + (0.3 if climb else 0.0))


@pytest.mark.parametrize(("height", "wanted"), [(0.10, 0.35), (0.24, 0.35), (0.26, 0.36)])
def test_beside_the_target_it_waits_above_its_last_decision(height, wanted):
    landing = Landing(LIMITS, estimate(0.0, height, east=0.5))
    assert landing.goal(estimate(0.0, height, east=0.5), None, STEP).position[2] == pytest.approx(wanted)


def test_throttle_of_the_commit_goes_down_further_after_a_while_and_ends_when_it_stands():
    landing = Landing(LIMITS, estimate(0.0, 0.12))
    shares = {at: landing.goal(estimate(at, 0.12, thrust=1.0), None, STEP).gas_share for at in (0.0, 0.3, 0.4, 0.9)}
    assert shares == pytest.approx({0.0: 0.9, 0.3: 0.9, 0.4: 0.8, 0.9: 0.6})
    assert landing.goal(estimate(0.92, 0.029, thrust=1.0), None, STEP).gas_share == pytest.approx(0.6)
    assert landing.goal(estimate(1.02, 0.029, thrust=1.0), None, STEP).gas_share is None, "the manoeuvre stands"
    assert landing.down_since == 1.02


@pytest.mark.parametrize(
    ("fields", "stands", "is_on_target"),
    [
        ({"height": 0.029, "age": 0.14}, True, True),
        ({"height": 0.031, "age": 0.14}, False, False),
        ({"height": 0.029, "age": 0.16}, False, False),
        # It is on the target where two standard deviations are on it too.
        ({"height": 0.0, "east": 0.31}, True, True),
        ({"height": 0.0, "east": 0.33}, True, False),
    ],
)
def test_only_a_fresh_image_of_feet_at_the_ground_shows_that_they_stand_and_where(fields, stands, is_on_target):
    landing = land([0.12] * 2)
    for k in range(2, 9):
        landing.goal(estimate(k * STEP, **fields, thrust=1.0), None, STEP)
    assert (landing.phase is LandingPhase.DOWN, landing.is_on_target) == (stands, is_on_target)


def test_a_fall_begins_where_the_aircraft_may_be_highest_and_slowest():
    fall = Fall(0.12, -0.28, 0.01)
    assert (fall.height, fall.climb) == pytest.approx((0.15, -0.13))


@pytest.mark.parametrize(("height", "gain"), [(0.0, 1.25), (0.1, 1.0 / (1.0 - 0.0625)), (10.0, 1.0)])
def test_near_the_ground_thrust_carries_more(height, gain):
    """I. Cheeseman and W. Bennett: 1 / (1 - (R / 4z)^2), rotors of 0.2 m at 0.1 m above the feet."""
    fall = Fall(height, -0.15, 0.0)  # slowest: it does not sink at all
    fall.has_ended(1.0 / 1.08, STEP)
    expected = {0.0: 1.0 / (1.0 - 0.25)}.get(height, gain)
    assert fall.climb == pytest.approx(9.81 * (min(expected, 1.25) - 1.0) * STEP, rel=1e-3, abs=1e-5)


def come_down(seconds, *, from_height=1.5, **fields):
    """An aircraft that follows the wanted height exactly; returns the landing and when it was decided [s]."""
    landing, height = Landing(LIMITS, estimate(0.0, from_height)), from_height
    for k in range(round(seconds / STEP)):
        goal = landing.goal(estimate(k * STEP, height, **fields), None, STEP)
        if landing.phase in (LandingPhase.COMMIT, LandingPhase.DOWN):
            return landing, k * STEP
        height = max(height + min(max(float(goal.position[2]) - 0.1 - height, -0.4 * STEP), 0.3 * STEP), 0.0)
    return landing, math.inf


@pytest.mark.parametrize(
    "trouble",
    [
        {"age": 0.45},  # images that come late
        {"age": 1.2},  # or seldom
        {"sd": 0.08},  # a height that stays uncertain: it stood on the ground in `descend`
        {"east": 0.6},  # wind that keeps it outside the cone
        {"east": 0.6, "age": 0.9, "sd": 0.2},
    ],
    ids=str,
)
def test_a_landing_comes_to_its_end_whatever_it_waits_for(trouble):
    """The question that was not asked: what ends each stage, and what comes then?

    A landing climbed to 1.6 m and hung there for ever, for a low battery too.
    """
    assert come_down(60.0, **trouble)[1] < LIMITS.patience + 8 * LIMITS.yielding
    assert come_down(10.0)[1] < 8.0, "without trouble nothing is waited for"


def test_a_landing_that_waits_asks_for_all_its_conditions_until_its_patience_is_over():
    assert come_down(LIMITS.patience - 0.1, from_height=0.12, east=0.2)[1] == math.inf


def test_an_aircraft_that_is_suddenly_believed_to_be_low_is_not_committed():
    """The question that was not asked: which decisions are final, on how much evidence, and what undoes them?

    Five wrong images (0.17 s) at 1.4 m were enough, and the ground was met at 3.6 m/s.
    """
    landing = Landing(LIMITS, estimate(0.0, 1.4))
    for k in range(25):
        landing.goal(estimate(k * STEP, 0.1), None, STEP)
    assert landing.phase in (LandingPhase.APPROACH, LandingPhase.DESCEND)


@pytest.mark.parametrize(
    ("height", "age", "sd", "is_taken_back"),
    [(1.2, 0.1, 0.02, True), (0.35, 0.15, 0.02, True), (1.2, 0.2, 0.02, False), (0.3, 0.1, 0.02, False),
     (1.2, 0.1, 0.4, False), (0.2, 0.1, 0.01, False)],
)  # fmt: skip
def test_a_fresh_image_of_an_aircraft_that_is_high_takes_a_commit_back(height, age, sd, is_taken_back):
    landing = land([0.12] * 4)
    assert landing.phase is LandingPhase.COMMIT
    goal = landing.goal(estimate(4 * STEP, height, age=age, sd=sd), None, STEP)
    assert (landing.phase is LandingPhase.APPROACH) is is_taken_back
    if is_taken_back:
        assert goal.gas_share is None, "the regulator of the height has the throttle again"
        assert goal.position[2] == pytest.approx(height + LIMITS.stand_height), "and holds it where it is"
