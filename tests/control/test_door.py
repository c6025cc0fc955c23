"""What comes through the core's door is checked there: poses, who is refused, what is known when nobody says so."""

from __future__ import annotations

import math

import pytest

from mkdaemon.control.actions import PublishStatus, Warn
from mkdaemon.control.estimator.values import FUTURE, OLDEST
from mkdaemon.control.events import PoseSeen, StateValue
from mkdaemon.telemetry.control import Phase
from tests.control.events import PERIOD, Driver, flight, pose

WRONG = [
    {"position_flu": (math.nan, 0.0, -2.0)},
    {"covariance": tuple(-1e-4 * (k % 7 == 0) for k in range(36))},
    {"quaternion_target_from_flu": (math.inf, 0.0, 0.0, 0.0)},
    {"quaternion_target_from_flu": (0.0, 0.0, 0.0, 0.0)},
]


@pytest.fixture
def drive():
    return Driver()


def status(drive):
    drive.run(1.1)
    return drive.of(PublishStatus)[-1]


@pytest.mark.parametrize("wrong", WRONG, ids=lambda wrong: next(iter(wrong)))
def test_a_pose_with_impossible_numbers_is_named_counted_and_used_by_nothing(drive, wrong):
    drive.run(1.0)
    drive.tell(PoseSeen(pose(drive.now).model_copy(update=wrong)))
    assert drive.core._sight.estimator is None
    assert status(drive).pose_age is None
    assert status(drive).poses_refused == 1
    [warning] = drive.of(Warn)
    assert warning.text.startswith("pose of down against pad not used: ")


@pytest.mark.parametrize("age", [-FUTURE - 0.01, OLDEST + 0.01])
def test_a_pose_from_the_future_or_long_ago_does_not_keep_a_lost_target_in_sight(drive, age):
    drive.run(1.0)
    drive.tell(PoseSeen(pose(drive.now)))
    seen_at = drive.now
    drive.run(0.2)
    drive.tell(PoseSeen(pose(drive.now - age)))
    shown = status(drive)
    assert shown.pose_age == pytest.approx(drive.done[-1][0] - seen_at, abs=1e-9)
    assert shown.poses_refused == 1


def test_a_pose_of_another_target_does_not_hide_that_the_flown_one_is_out_of_sight(drive):
    drive.run(1.0)
    drive.tell(PoseSeen(pose(drive.now)))
    for _ in range(10):
        drive.run(0.1)
        drive.tell(PoseSeen(pose(drive.now).model_copy(update={"target": "other"})))
    assert status(drive).pose_age == pytest.approx(drive.done[-1][0] - 1.0)


def test_a_stale_setpoint_is_neutral_at_the_throttle_that_is_estimated_to_carry(drive):
    drive.run(1.0)
    drive.tell(PoseSeen(pose(drive.now)))
    drive.fly()
    drive.tell(StateValue(flight(is_flying=True)))
    for _ in range(20):
        drive.put()
        drive.tell(PoseSeen(pose(drive.now)))
        drive.run(PERIOD)
    sight = drive.core._sight
    sight.estimator.hover_gas += 20.0
    for _ in range(6):  # the client is silent, the target stays in sight
        drive.run(0.06)
        drive.tell(PoseSeen(pose(drive.now)))
    assert drive.core.phase is Phase.STALE
    assert drive.sticks[-1].counts.throttle == round(sight.hover_throttle(drive.now))
    assert drive.sticks[-1].counts.throttle > drive.core._cfg.limiter.hover_throttle + 10
