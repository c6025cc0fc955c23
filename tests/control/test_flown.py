"""What is flown: begun once, changed by another kind of setpoint, and what it waits for."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from mkdaemon.control.answers import AnswerWatch
from mkdaemon.control.limiter import Sticks
from mkdaemon.control.manoeuvres.by_target import ByTarget
from mkdaemon.control.manoeuvres.hold import Hold
from mkdaemon.control.manoeuvres.land import Land
from mkdaemon.control.manoeuvres.level import Level
from mkdaemon.control.manoeuvres.manoeuvre import Step, level_at
from mkdaemon.control.manoeuvres.stick import Stick
from mkdaemon.control.manoeuvres.take_off import TakeOffFlight, TakeOffPhase
from mkdaemon.telemetry.control import Outcome, Phase
from mkdaemon.telemetry.setpoint import HoldSetpoint, LandSetpoint, StickSetpoint, TakeOffSetpoint
from tests.control.events import pose
from tests.control.flying import Flying

BASE = {"epoch": 1, "sequence": 1, "ttl": 0.3}
STICKS = {"pitch": 1.0, "roll": 2.0, "yaw": 3.0, "throttle": 4.0}
STICK = StickSetpoint(**BASE, **STICKS)
HOLD = HoldSetpoint(**BASE)
LAND = LandSetpoint(**BASE)
TAKE_OFF = TakeOffSetpoint(**BASE, height=2.0)


@pytest.fixture
def entered(monkeypatch):
    """Which manoeuvre was begun after which."""
    noted = []
    for kind in (ByTarget, Level):
        monkeypatch.setattr(kind, "enter", lambda new, before, now: noted.append((type(new), type(before))) or "")
    return noted


def fly(*phases_and_setpoints):
    """Begin with the first setpoint over the target, then fly each in its phase."""
    flying = Flying()
    flying.see(pose(0.0), 0.0)
    flying.step(phases_and_setpoints[0][1], 0.0)
    for k, (phase, each) in enumerate(phases_and_setpoints):
        flying.step(each, 0.02 * (k + 1), is_flying=True, phase=phase)
    return flying


@pytest.mark.parametrize(("setpoint", "shown"), [(HOLD, ("hold", True, True)), (STICK, ("attitude", False, False))])
def test_what_is_flown_is_shown_from_the_first_setpoint_to_the_end(setpoint, shown):
    flown = fly((Phase.FLYING, setpoint)).flown
    assert (flown.concern.value, flown.keeps_place, flown.is_by_target) == shown
    for nothing in (Flying().flown, flown):
        nothing.end()
        assert (nothing.concern, nothing.keeps_place, nothing.is_by_target) == (None, False, False)


def test_before_the_flight_every_setpoint_is_begun_anew(entered):
    flying = Flying()
    flying.step(HOLD, 0.0)
    first = flying.flown.current
    flying.step(HOLD, 0.1)
    assert flying.flown.current is not first
    assert entered == [(Hold, type(None))] * 2


@pytest.mark.parametrize("setpoint", [HOLD, LAND])
def test_a_low_battery_lands_once_whatever_is_streamed(entered, setpoint):
    flying = fly((Phase.FLYING, setpoint), (Phase.LANDING, setpoint))
    landing = flying.flown.current
    assert type(landing) is Land
    flying.step(setpoint, 1.0, is_flying=True, phase=Phase.LANDING)
    assert flying.flown.current is landing
    assert entered.count((Land, Hold)) == (setpoint is HOLD)


@pytest.mark.parametrize("setpoint", [LAND, HOLD])
def test_an_abort_holds_once(entered, setpoint):
    flying = fly((Phase.FLYING, setpoint))
    before = flying.flown.current
    flying.step(setpoint, 0.1, is_flying=True, phase=Phase.ABORTED)
    holding = flying.flown.current
    assert type(holding) is Hold
    if setpoint is LAND:
        assert entered[-1] == (Hold, Land)
    else:
        assert holding is before, "it holds already"
    flying.step(setpoint, 0.12, is_flying=True, phase=Phase.ABORTED)
    assert flying.flown.current is holding


@pytest.mark.parametrize(
    ("phase", "asked"),
    [
        (Phase.LEASED, ("land", None)),
        (Phase.FREE, ("land", None)),
        (Phase.FLYING, ("land", "hold")),
        (Phase.STALE, ("land", "hold")),
        (Phase.ABORTED, ("land", "land")),
        (Phase.LANDING, ("land", "land")),
    ],
)
def test_admission_hears_what_is_flown_in_flight_only(phase, asked):
    wanted, before = fly((Phase.FLYING, HOLD)).flown.change(LAND, phase)
    assert (wanted.concern.value, None if before is None else before.value) == asked


def test_what_waits_shows_its_stage_and_what_it_waits_for():
    flying = Flying()
    flying.see(pose(0.0), 0.0)
    step = flying.step(TAKE_OFF, 0.0)
    assert "an aircraft on the ground: its feet are 1.9 m above" in step.obstacle
    assert (step.stage, step.manoeuvre) == (TakeOffPhase.IDLE.value, "takeoff")
    assert Flying().step(TAKE_OFF, 0.0).obstacle == ""


def test_error_shown_is_that_of_the_last_step_and_none_where_there_is_no_goal():
    flying = Flying()
    flying.see(pose(1.0), 1.0)
    flying.step(HOLD, 1.0, is_flying=False)
    flying.step(HOLD, 1.02, is_flying=True)
    assert flying.flown.error.goal == pytest.approx((0.0, 0.0, 2.0), abs=0.05)
    flying.step(STICK, 1.04, is_flying=True)
    assert flying.flown.error is None


@pytest.mark.parametrize(("setpoint", "is_bounded"), [(HOLD, True), (STICK, False)])
def test_an_aircraft_that_may_not_answer_is_asked_for_twelve_degrees_at_most(setpoint, is_bounded, monkeypatch):
    """A shut gate that no board reports leaves no more than this when it is opened: 41 to 49 counts before."""
    flying = Flying()
    flying.see(pose(1.0), 1.0)
    flying.step(setpoint, 1.0)
    monkeypatch.setattr(Hold, "step", lambda hold, now, *, is_flying: Step(Sticks(-30.0, 40.0, 5.0, 6.0), "hold"))
    monkeypatch.setattr(Stick, "step", lambda stick, now, *, is_flying: Step(Sticks(-30.0, 40.0, 5.0, 6.0), "stick"))
    assert flying.step(setpoint, 1.02, is_flying=True).sticks == Sticks(-30.0, 40.0, 5.0, 6.0)
    monkeypatch.setattr(AnswerWatch, "is_doubted", True)
    found = flying.step(setpoint, 1.04, is_flying=True).sticks
    most = math.radians(12.0) / flying.sight.model.rad_per_count
    wanted = Sticks(-0.6 * most, 0.8 * most, 5.0, 6.0) if is_bounded else Sticks(-30.0, 40.0, 5.0, 6.0)
    assert found == pytest.approx(wanted)


def test_a_stage_that_lasts_longer_than_it_may_is_late_until_another_begins_or_it_is_done(monkeypatch):
    flying = Flying()
    flying.see(pose(1.0), 1.0)
    flying.step(HOLD, 1.0)
    wanted = Step(Sticks(0.0, 0.0, 0.0, 6.0), "hold", stage="waits", longest=2.0)
    monkeypatch.setattr(Hold, "step", lambda hold, now, *, is_flying: wanted)

    def late_at(*times):
        found = [(flying.flown.late_stage(at), flying.step(HOLD, at, is_flying=True)) for at in times]
        return [late for late, _ in found]

    late = late_at(1.1, 3.0, 3.2)
    wanted = replace(wanted, stage="waits longer")
    late += late_at(3.3, 5.2, 5.4)
    wanted = replace(wanted, is_done=True)
    late += late_at(5.41, 5.5)[1:]
    wanted = replace(wanted, stage="", is_done=False)
    assert [*late, *late_at(98.0, 99.0)[1:]] == ["", "", "waits", "waits", "", "waits longer", "", ""]


def test_a_stage_of_another_manoeuvre_has_its_own_time_though_its_name_is_the_same(monkeypatch):
    flying = Flying()
    flying.see(pose(1.0), 1.0)
    flying.step(HOLD, 1.0)
    for kind, longest in ((Hold, 5.0), (TakeOffFlight, 1.0)):
        step = Step(Sticks(0.0, 0.0, 0.0, 6.0), kind.kind, stage="searches", longest=longest)
        monkeypatch.setattr(kind, "step", lambda flight, now, *, is_flying, step=step: step)
    for at in (1.1, 2.0, 3.0):
        flying.step(HOLD, at, is_flying=True)
    flying.step(TAKE_OFF, 3.1, is_flying=True)
    assert [flying.flown.late_stage(at) for at in (3.2, 4.0, 4.2)] == ["", "", "searches"]


def unanswered(*, seen_at=0.0, setpoint=HOLD):
    """A flight by its target, whose last image is of `seen_at`; None for none."""
    flying = Flying()
    if seen_at is not None:
        flying.see(pose(seen_at), seen_at)
    flying.step(setpoint, 0.0)
    flying.step(setpoint, 0.02, is_flying=True)
    return flying


def test_without_an_answer_a_flight_by_its_target_ends_when_no_image_came_for_long():
    flying = unanswered()
    limit = flying.cfg.autopilot.exit_after
    assert flying.step(HOLD, limit, is_flying=True, phase=Phase.UNANSWERED).end is None
    end = flying.step(HOLD, limit + 0.1, is_flying=True, phase=Phase.UNANSWERED).end
    assert (end.outcome, end.words) == (Outcome.SIGHT_LOST, f"no image of pad for {limit + 0.1:.1f} s")
    never = unanswered(seen_at=None).step(HOLD, 0.1, is_flying=True, phase=Phase.UNANSWERED)
    assert never.end.outcome is Outcome.SIGHT_LOST
    by_hand = unanswered(setpoint=STICK).step(STICK, limit + 9.0, is_flying=True, phase=Phase.UNANSWERED)
    assert by_hand.end is None


@pytest.mark.parametrize("setpoint", [HOLD, LAND, TAKE_OFF, STICK])
def test_without_an_answer_sticks_are_level_at_the_throttle_that_carries_it(setpoint):
    flying = unanswered(setpoint=setpoint)
    step = flying.step(setpoint, 0.1, is_flying=True, phase=Phase.UNANSWERED)
    assert step.sticks == level_at(flying.sight.hover_gas)
    assert (step.is_unanswered, step.is_done, step.stands) == (True, False, False)


@pytest.mark.parametrize(
    ("phase", "setpoint", "becomes"),
    [
        (Phase.UNANSWERED, LAND, Land),
        (Phase.UNANSWERED, HOLD, Hold),
        (Phase.LANDING, HOLD, Land),
        (Phase.ABORTED, LAND, Hold),
    ],
)
def test_what_is_flown_when_it_answers_again_is_what_phase_and_setpoint_ask_for(phase, setpoint, becomes):
    flying = unanswered(setpoint=setpoint)
    flying.sight.answer.gate_reported(0.1, is_open=False)
    flying.step(setpoint, 0.12, is_flying=True, phase=phase)
    flying.sight.answer.gate_reported(0.14, is_open=True)
    flying.step(setpoint, 0.14, is_flying=True, phase=phase if phase is not Phase.UNANSWERED else Phase.FLYING)
    assert type(flying.flown.current) is becomes
