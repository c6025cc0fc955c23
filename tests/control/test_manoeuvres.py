"""Take-off, hold, a place from the aircraft's own, and the abort: the whole core decides, in virtual time."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from lab.control.camera import CameraModel
from lab.control.corerig import CoreRig, stamp
from lab.control.flights import Flight
from mkdaemon.control.actions import PublishError, PublishStatus, ReleaseAircraft, SendSticks
from mkdaemon.control.events import AbortAsked, MotorsReported
from mkdaemon.telemetry.command import AbortRequest
from mkdaemon.telemetry.control import Phase
from mkdaemon.telemetry.setpoint import (
    HoldSetpoint,
    LandSetpoint,
    PositionSetpoint,
    SetpointFrame,
    StickSetpoint,
    TakeOffSetpoint,
)
from mkdaemon.telemetry.state import Pilot
from mksim.config import WindClass
from tests.control.flying import Flying

BASE = {"epoch": 1, "sequence": 1, "ttl": 0.3}
GROUND = Flight(seed=4, wind=WindClass.INDOOR, seconds=9.2, start=0.0, place=(0.05, -0.04))
CALM = Flight(seed=4, wind=WindClass.INDOOR, seconds=7.0)


class Plan(CoreRig):
    """Streams what a plan says: times [s] and setpoints, and asks for an abort at a time [s]."""

    def __init__(self, flight, *plan, abort_at=math.inf, motors=True):
        super().__init__(flight)
        self.plan, self.abort_at, self.motors = plan, abort_at, motors

    def _control(self, at):
        self.core.feed(MotorsReported(self.motors), at)
        if at >= self.abort_at:
            self.abort_at = math.inf
            self.core.feed(AbortAsked(AbortRequest(reason="the operator saw something")), 0.0)
        super()._control(at)

    def _setpoint(self, goal, at):
        kind, fields = next((k, f) for start, k, f in reversed(self.plan) if at >= start)
        return kind(epoch=self._epoch, sequence=self._sequence, ttl=0.3, **fields)

    def statuses(self):
        """What was published, without repetitions."""
        shown = [action for _, action in self.actions if isinstance(action, PublishStatus)]
        return list(dict.fromkeys((s.manoeuvre, s.stage, s.is_done) for s in shown))

    def release_reason(self):
        return next(action.reason for _, action in self.actions if isinstance(action, ReleaseAircraft))


def hold():
    return (0.0, HoldSetpoint, {})


def takeoff(height=1.2):
    return (0.0, TakeOffSetpoint, {"height": height})


def test_it_takes_off_from_a_target_it_hardly_sees_and_holds_over_its_middle():
    rig = Plan(GROUND, takeoff())
    record = rig.fly()
    assert record.lost == ""
    assert record.positions[-1] == pytest.approx([0.0, 0.0, 1.2], abs=0.15)
    assert [stage for manoeuvre, stage, _ in rig.statuses() if manoeuvre == "takeoff"] == [
        "idle: the pilot raises his throttle",
        "throttle rises",
        "climbs",
        "at height",
    ]
    assert rig.statuses()[-1] == ("takeoff", "at height", True)
    before = [a.counts.throttle for at, a in rig.actions if isinstance(a, SendSticks) and at < 3.9]
    assert set(before) == {-100}


def test_a_take_off_that_no_image_shows_ends_with_a_release_that_says_what_to_look_at():
    rig = Plan(replace(GROUND, camera=CameraModel(missing=1.0), seconds=8.0), takeoff())
    rig.fly()
    assert rig.release_reason().startswith("take-off ended: no image shows it off the ground")
    # Blind throttle is bounded: it was released low.
    released = next(at for at, action in rig.actions if isinstance(action, ReleaseAircraft))
    assert released < 6.5


def test_an_abort_before_the_lift_off_releases():
    rig = Plan(replace(GROUND, seconds=3.0), takeoff(), abort_at=2.0)
    rig.fly()
    assert rig.release_reason() == "take-off ended: aborted"


@pytest.mark.parametrize(("throttle", "age", "waits"), [(-3.0, 0.2, True), (-100.0, 0.2, False), (-3.0, 1.2, False)])
def test_a_take_off_waits_while_the_pilots_throttle_may_carry_the_aircraft(throttle, age, waits):
    flying = Flying()
    flown = Pilot(
        stamp=stamp(1.0),
        source="fc/debug",
        rc_quality=1.0,
        has_signal=True,
        throttle=None,
        sticks=None,
        throttle_in_use=throttle,
    )
    flying.facts.state_received(flown, 1.0)
    guided = flying.step(TakeOffSetpoint(**BASE, height=2.0), 1.0 + age)
    assert ("the pilot's throttle at its lowest" in guided.obstacle) is waits


def stick(**fields):
    return StickSetpoint, {"pitch": 0.0, "roll": 0.0, "yaw": 0.0, "throttle": -2.0} | fields


def goals(rig, start, end):
    """Where the aircraft was to be between two times."""
    return [np.array(a.value.goal) for at, a in rig.actions if isinstance(a, PublishError) and start < at < end]


def place(record, at):
    return record.positions[next(k for k, time in enumerate(record.times) if time >= at)]


@pytest.fixture(scope="module")
def held():
    """A flight that holds on the way to a place, then after some time by stick, and its record; nobody changes it."""
    away = (0.0, PositionSetpoint, {"position": (-0.4, 0.0, 2.0), "frame": SetpointFrame.PAD})
    sticks = (6.0, *stick(pitch=16.0)), (6.8, *stick(pitch=-15.0))
    rig = Plan(replace(CALM, seconds=8.6), away, (4.5, *hold()[1:]), *sticks, (7.6, *hold()[1:]))
    record = rig.fly()
    assert record.lost == ""
    return rig, record


def test_hold_stays_where_the_aircraft_is_and_says_so(held):
    rig, _ = held
    assert [manoeuvre for manoeuvre, _, _ in rig.statuses()][-2:] == ["hold", "stick"]
    errors = [a.value for at, a in rig.actions if isinstance(a, PublishError) and 4.6 < at < 6.0]
    assert len({error.goal for error in errors}) == 1
    assert np.linalg.norm(errors[-1].error_pad) < 0.2
    assert np.linalg.norm(errors[-1].error_body) == pytest.approx(np.linalg.norm(errors[-1].error_pad))


def test_a_hold_after_flying_by_stick_is_where_the_aircraft_is_then(held):
    rig, record = held
    first, second = goals(rig, 4.6, 6.0)[-1], goals(rig, 7.8, 8.6)
    moved = np.linalg.norm(place(record, 7.7)[:2] - first[:2])
    assert moved > 0.2, "the sticks moved it"
    assert max(np.linalg.norm(goal - second[0]) for goal in second) < 1e-9
    assert np.linalg.norm(second[0][:2] - first[:2]) > 0.8 * moved, "it does not fly back"


def test_an_aborted_landing_holds_where_the_aircraft_is_then():
    over = (0.0, PositionSetpoint, {"position": (0.5, 0.3, 2.0), "frame": SetpointFrame.PAD})
    rig = Plan(replace(CALM, seconds=9.0), over, (4.0, *hold()[1:]), (4.5, LandSetpoint, {}), abort_at=7.5)
    record = rig.fly()
    assert record.lost == ""
    assert rig.core.phase is Phase.ABORTED
    held, before = goals(rig, 4.2, 4.5)[-1], place(record, 7.5)
    after = goals(rig, 7.7, 9.0)
    assert np.linalg.norm(before - held) > 0.4, "it had come nearer to the target"
    assert max(np.linalg.norm(goal - before) for goal in after) < 0.35


def test_a_landing_below_its_last_decision_is_not_aborted():
    rig = Plan(replace(CALM, seconds=14.0, land_at=2.5), hold(), (2.5, LandSetpoint, {}))

    def is_committed():
        landing = getattr(rig.core._flown.current, "landing", None)
        return landing is not None and landing.phase.value == "commit"

    flown = rig._control

    def control(at):
        if is_committed() and rig.core.phase is Phase.FLYING:
            rig.core.feed(AbortAsked(AbortRequest()), 0.0)
        flown(at)

    rig._control = control
    rig._is_over = lambda at: any(isinstance(action, ReleaseAircraft) for _, action in rig.actions[-9:])
    record = rig.fly()
    assert rig.release_reason() == "landed on pad"
    assert record.touch_error < 0.2


ABORTED, RESUMED = 3.4, 5.8
"""A flight to a place is aborted, and its client goes on; then it is aborted again [s]."""


@pytest.fixture(scope="module")
def aborted():
    """Setpoints that name no abort, one that never was, the abort, and still that one after another; nobody changes it.

    With it comes its record.
    """
    over, away = ({"position": at, "frame": SetpointFrame.PAD} for at in ((0.0, 0.0, 2.0), (-0.6, 0.4, 2.0)))
    named = ((0.0, over), (3.0, away), (5.4, away | {"after_abort": 2}), (RESUMED, away | {"after_abort": 1}))
    rig = Plan(replace(CALM, seconds=7.0), *((at, PositionSetpoint, fields) for at, fields in named), abort_at=ABORTED)
    rig._at(6.2, lambda at: rig.core.feed(AbortAsked(AbortRequest(reason="again")), at))
    record = rig.fly()
    assert record.lost == ""
    return rig, record


def test_an_abort_holds_the_place_and_keeps_the_lease(aborted):
    rig, record = aborted
    assert math.hypot(*place(record, RESUMED)[:2]) < 0.4
    shown = [action for at, action in rig.actions if isinstance(action, PublishStatus) and at < RESUMED]
    assert (shown[-1].phase, shown[-1].reason) == (Phase.ABORTED, "aborted: the operator saw something")


def test_an_abort_is_ended_by_setpoints_that_name_it_and_by_no_others(aborted):
    rig, _ = aborted
    shown = [(at, action) for at, action in rig.actions if isinstance(action, PublishStatus)]
    first = next(at for at, action in shown if action.phase is Phase.ABORTED)
    resumed = next(at for at, action in shown if action.phase is Phase.FLYING and at > first)
    assert (first, resumed) == pytest.approx((ABORTED, RESUMED), abs=0.03)
    assert {action.manoeuvre for at, action in shown if first < at < resumed} == {"hold"}
    assert {(action.manoeuvre, action.aborts) for at, action in shown if at == resumed} == {("position", 1)}


def test_a_second_abort_is_not_ended_by_the_number_of_the_first(aborted):
    rig, _ = aborted
    phases = [action.phase for _, action in rig.actions if isinstance(action, PublishStatus)]
    changes = [phase for phase, before in zip(phases[1:], phases, strict=False) if phase is not before]
    assert changes[-3:] == [Phase.ABORTED, Phase.FLYING, Phase.ABORTED]
