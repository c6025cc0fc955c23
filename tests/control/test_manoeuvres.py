"""Take-off, hold, a place from the aircraft's own, and the abort: the whole core decides, in virtual time."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lab.control.camera import CameraModel
from lab.control.flights import Flight
from mkdaemon.control.actions import PublishError, PublishStatus, ReleaseAircraft
from mkdaemon.telemetry.setpoint import (
    HoldSetpoint,
    PositionSetpoint,
    SetpointFrame,
    StickSetpoint,
    TakeOffSetpoint,
)
from mksim.config import WindClass
from tests.control.coreflights import Plan
from tests.control.events import pilot
from tests.control.flying import Flying

BASE = {"epoch": 1, "sequence": 1, "ttl": 0.3}
GROUND = Flight(seed=4, wind=WindClass.INDOOR, seconds=9.2, start=0.0, place=(0.05, -0.04))
CALM = Flight(seed=4, wind=WindClass.INDOOR, seconds=7.0)


def statuses(rig):
    """What was published, without repetitions."""
    return list(dict.fromkeys((s.manoeuvre, s.stage, s.is_done) for _, s in rig.of(PublishStatus)))


def hold():
    return (0.0, HoldSetpoint, {})


def takeoff(height=1.2):
    return (0.0, TakeOffSetpoint, {"height": height})


def test_it_takes_off_by_late_images_of_a_target_it_hardly_sees_and_holds_over_its_middle():
    late = CameraModel(latency=0.25, jitter=0.04, rate=15.0)
    rig = Plan(replace(GROUND, camera=late, seconds=11.0), takeoff(), motors=True)
    record = rig.fly()
    assert record.lost == ""
    assert max(place[2] for place in record.positions) < 1.5, "it does not pass its height"
    assert record.positions[-1] == pytest.approx([0.0, 0.0, 1.2], abs=0.15)
    stages = [stage for manoeuvre, stage, _ in statuses(rig) if manoeuvre == "takeoff"]
    assert stages == ["idle: the pilot raises his throttle", "throttle rises", "climbs", "at height"]
    assert statuses(rig)[-1] == ("takeoff", "at height", True)
    assert {counts.throttle for counts in rig.counts(end=3.9)} == {-100}


def test_a_take_off_that_no_image_shows_ends_with_a_release_that_says_what_to_look_at():
    rig = Plan(replace(GROUND, camera=CameraModel(missing=1.0), seconds=8.0), takeoff(), motors=True)
    rig.fly()
    released_at, release = rig.first(ReleaseAircraft)
    assert release.reason.startswith("take-off ended: no image shows it off the ground")
    assert released_at < 6.5, "blind throttle is bounded: it was released low"


def test_an_abort_before_the_lift_off_releases():
    rig = Plan(replace(GROUND, seconds=3.0), takeoff(), abort_at=2.0, motors=True)
    rig.fly()
    assert rig.first(ReleaseAircraft)[1].reason == "take-off ended: aborted"


@pytest.mark.parametrize(("throttle", "age", "waits"), [(-3.0, 0.2, True), (-100.0, 0.2, False), (-3.0, 1.2, False)])
def test_a_take_off_waits_while_the_pilots_throttle_may_carry_the_aircraft(throttle, age, waits):
    flying = Flying()
    flying.facts.state_received(pilot(None).model_copy(update={"throttle_in_use": throttle}), 1.0)
    guided = flying.step(TakeOffSetpoint(**BASE, height=2.0), 1.0 + age)
    assert ("the pilot's throttle at its lowest" in guided.obstacle) is waits


def stick(**fields):
    return StickSetpoint, {"pitch": 0.0, "roll": 0.0, "yaw": 0.0, "throttle": -2.0} | fields


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
    assert [manoeuvre for manoeuvre, _, _ in statuses(rig)][-2:] == ["hold", "stick"]
    errors = [action.value for _, action in rig.of(PublishError, 4.6, 6.0)]
    assert len({error.goal for error in errors}) == 1
    assert np.linalg.norm(errors[-1].error_pad) < 0.2
    assert np.linalg.norm(errors[-1].error_body) == pytest.approx(np.linalg.norm(errors[-1].error_pad))


def test_a_hold_after_flying_by_stick_is_where_the_aircraft_is_then(held):
    rig, record = held
    first, second = np.array(rig.goals(4.6, 6.0)[-1]), np.array(rig.goals(7.8, 8.6))
    moved = np.linalg.norm(place(record, 7.7)[:2] - first[:2])
    assert moved > 0.2, "the sticks moved it"
    assert np.abs(second - second[0]).max() < 1e-9
    assert np.linalg.norm(second[0, :2] - first[:2]) > 0.8 * moved, "it does not fly back"
