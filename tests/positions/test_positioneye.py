"""From the reports of a source of poses to poses of the vehicle, and what is refused on the way."""

from __future__ import annotations

import math

import numpy as np
import pytest
from pydantic import ValidationError

from lab.control.corerig import stamp
from mkdaemon.config.positions import PositionSource
from mkdaemon.control.sight import checked_view
from mkdaemon.frames import quaternion_from_rotation, rotation_from_euler
from mkdaemon.positions.positioneye import REMEDIES, PositionEye
from mkdaemon.telemetry.position import PositionReport
from mkdaemon.telemetry.vision import EyeState, PoseRefusal, PoseRefused, VisionPose

LEVEL = (1.0, 0.0, 0.0, 0.0)


def report(sequence, position=(0.0, 0.0, 1.0), quaternion=LEVEL, *, epoch=1, age=0.003, **more):
    return PositionReport(epoch=epoch, sequence=sequence, age=age, position=position, quaternion=quaternion, **more)


def eye(**fields):
    return PositionEye(PositionSource(**{"name": "mocap", "target": "map"} | fields))


def take(made, one, now, sent=None):
    return [value for _, value in made.take(one, now if sent is None else sent, now, stamp(now), is_flown=False)]


def refused(made):
    return made.stats(99.0, stamp(99.0)).refused


def test_a_report_is_a_pose_that_the_estimator_takes_at_its_own_time():
    (pose,) = take(eye(), report(7, (0.5, -0.25, 1.5)), 10.0)
    assert isinstance(pose, VisionPose)
    assert (pose.camera, pose.target, pose.sequence, pose.is_placed) == ("mocap", "map", 7, True)
    assert pose.stamp.monotonic == pytest.approx(9.997)
    assert pose.latency == pytest.approx(0.003)
    view = checked_view(pose, 10.0)
    assert view.place == pytest.approx([0.5, -0.25, 1.5])
    assert (view.height, view.aside) == (pytest.approx(1.5), pytest.approx(math.hypot(0.5, 0.25)))


def test_the_frame_of_the_source_and_the_body_are_turned_into_those_of_the_target_and_the_aircraft():
    made = eye(
        position=(1.0, 2.0, 0.0), rpy_deg=(90.0, 0.0, 0.0), body_position=(0.1, 0.0, 0.0), body_rpy_deg=(0, 0, 90)
    )
    target_from_flu = rotation_from_euler(0.05, -0.1, 0.7)
    place = np.array([1.4, 2.3, 0.9])
    source_from_target = rotation_from_euler(math.pi / 2, 0.0, 0.0).T
    tracked = place + target_from_flu @ [0.1, 0.0, 0.0]
    position = source_from_target @ (tracked - [1.0, 2.0, 0.0])
    turned = source_from_target @ target_from_flu @ rotation_from_euler(0.0, 0.0, math.pi / 2)
    (pose,) = take(made, report(1, tuple(position.tolist()), quaternion_from_rotation(turned)), 10.0)
    assert pose.position_target == pytest.approx(place.tolist())
    assert pose.quaternion_target_from_flu == pytest.approx(quaternion_from_rotation(target_from_flu))
    assert pose.position_flu == pytest.approx((-target_from_flu.T @ place).tolist())


def test_places_are_targets_with_their_own_origin_and_axes():
    made = eye(places=({"name": "pad-b", "position": (3.0, 0.0, 0.2), "yaw_deg": 90.0},))
    whole, pad = take(made, report(1, (3.0, 1.0, 1.2)), 10.0)
    assert (whole.target, pad.target) == ("map", "pad-b")
    assert pad.position_target == pytest.approx((1.0, 0.0, 1.0))
    assert checked_view(pad, 10.0).heading == pytest.approx(-math.pi / 2)


def test_a_covariance_counts_as_it_is_reported_with_that_of_the_frame():
    own = np.diag([1e-4, 4e-4, 9e-4, 1e-3, 1e-3, 2e-3])
    (pose,) = take(
        eye(frame_sd=0.02, rpy_deg=(0.0, 0.0, 90.0)), report(1, covariance=tuple(own.ravel().tolist())), 10.0
    )
    found = np.array(pose.covariance).reshape(6, 6)
    assert np.diag(found) == pytest.approx([8e-4, 5e-4, 13e-4, 1e-3, 1e-3, 2e-3])
    assert pose.calibration_sd == (0.02, 0.02, 0.0)
    (pose,) = take(eye(frame_sd=0.0, position_sd=0.003, angle_sd_deg=1.0), report(1), 10.0)
    assert np.sqrt(np.array(pose.covariance).reshape(6, 6).diagonal())[[0, 5]] == pytest.approx(
        [0.003, math.radians(1)]
    )


def test_of_a_hundred_reports_a_second_about_thirty_go_on():
    made = eye()
    poses = [value for k in range(100) for value in take(made, report(k, (0.0, 0.0, 1.0 + 1e-5 * k)), 10.0 + 0.01 * k)]
    assert 30 <= len(poses) <= 34
    found = made.stats(10.99, stamp(10.99))
    assert (found.state, found.fps, found.posed, found.processed) == (EyeState.OK, 100.0, 1.0, 100)
    assert found.trusted_for == ("takeoff", "flight", "landing")


@pytest.mark.parametrize(
    ("second", "now", "sent", "why"),
    [
        (report(1), 10.1, None, PoseRefusal.OUT_OF_ORDER),
        (report(9, epoch=0), 10.1, None, PoseRefusal.OUT_OF_ORDER),
        (report(2, age=0.2), 10.1, None, PoseRefusal.OUT_OF_ORDER),
        (report(2, age=0.2), 10.5, None, PoseRefusal.LATE),
        (report(2), 10.5, 10.3, PoseRefusal.LATE),
        (report(2), 10.1, None, PoseRefusal.REPEATED),
        (report(2, (2.0, 0.0, 1.0)), 10.1, None, PoseRefusal.OFF_COURSE),
    ],
)
def test_what_cannot_be_flown_by_is_refused_by_name_and_counted(second, now, sent, why):
    made = eye()
    take(made, report(1), 10.0)
    (value,) = take(made, second, now, sent)
    assert isinstance(value, PoseRefused)
    assert (value.refusal, value.target) == (why, "map")
    assert refused(made) == {why.value: 1}


def test_a_sender_that_starts_again_counts_from_the_beginning():
    made = eye()
    take(made, report(500), 10.0)
    (pose,) = take(made, report(1, (0.0, 0.0, 1.01), epoch=2), 10.1)
    assert isinstance(pose, VisionPose)


def state_at(made, now):
    found = made.stats(now, stamp(now))
    return found.state, found.reason


def test_the_state_says_what_is_wrong_and_what_to_do():
    made = eye()
    state, reason = state_at(made, 5.0)
    assert (state, reason) == (
        EyeState.MISSING,
        "no report yet: start its sender (mkdaemon gateway mocap), show it the body",
    )
    take(made, report(1), 10.0)
    assert state_at(made, 10.4) == (EyeState.OK, "")
    assert state_at(made, 12.0)[1].startswith("the last report is 2 s old")
    for k in range(80):
        made.refused(PoseRefusal.UNSIGNED, 12.0 + 0.01 * k)
    assert state_at(made, 12.8) == (EyeState.REFUSED, REMEDIES[PoseRefusal.UNSIGNED])
    assert refused(made) == {"unsigned": 80}


def test_one_that_jumps_is_contradicted_at_once():
    made = eye()
    take(made, report(1), 10.0)
    take(made, report(2, (2.0, 0.0, 1.0)), 10.01)
    state, reason = state_at(made, 10.02)
    assert (state, reason) == (EyeState.CONTRADICTED, "they jumped; another body's pose, or another frame")


@pytest.mark.parametrize(
    "fields",
    [
        {"quaternion": (0.0, 0.0, 0.0, 0.0)},
        {"quaternion": (1.0, 1.0, 0.0, 0.0)},
        {"position": (math.nan, 0.0, 0.0)},
        {"position": (1e6, 0.0, 0.0)},
        {"age": -1.0},
        {"covariance": (1.0,) * 35},
        {"sequence": -1},
    ],
)
def test_a_report_that_is_no_pose_is_none(fields):
    whole = {"epoch": 1, "sequence": 1, "age": 0.0, "position": (0.0, 0.0, 0.0), "quaternion": LEVEL}
    with pytest.raises(ValidationError):
        PositionReport(**(whole | fields))
