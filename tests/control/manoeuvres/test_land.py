"""A landing from its beginning to the release: stages, loss of sight, abort, and what it leaves behind."""

from __future__ import annotations

import math

import pytest

from mkdaemon.config.autopilot import AutopilotConfig
from mkdaemon.control.limiter import Sticks
from mkdaemon.control.manoeuvres.by_target import SEARCHES
from mkdaemon.control.manoeuvres.hold import Hold
from mkdaemon.control.manoeuvres.land import Land, LandingPhase
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


def test_committed_it_goes_on_without_any_image():
    cfg = AutopilotConfig(freeze_after=0.1, level_after=0.2, exit_after=0.4)
    aircraft, land = landing_of((0.0, 0.0, 0.5), cfg=cfg)
    sink(aircraft, land, LandingPhase.COMMIT)
    aircraft.sees = False
    steps = aircraft.fly(land, 0.8)
    assert {(step.stage, step.end) for step in steps} == {("commit", None)}
    assert steps[-1].sticks.throttle < -40.0, "throttle goes down further, and carries less than half of the weight"


def test_heights_of_a_landing_are_those_over_the_configured_feet():
    """With its feet 0.4 m below the camera it is 0.1 m above the target; with 0.1 m it would still go down."""
    aircraft, land = landing_of((0.0, 0.0, 0.5), cfg=AutopilotConfig(stand_height=0.4))
    assert aircraft.fly(land, 0.4)[-1].stage == "commit"
