"""A place that was measured in the target frame: it counts as it is, whatever the tilt and the attitude say."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from mkdaemon.control.estimator.estimator import Estimator
from mkdaemon.control.estimator.model import AircraftModel
from mkdaemon.control.estimator.values import TargetView
from mkdaemon.control.sight import velocity_between, view_of
from mkdaemon.frames import quaternion_from_rotation, rotation_from_euler
from tests.control import events

SD = 0.002


def view(at, place, *, tilt=0.0, camera="mocap", is_placed=True, shared=0.0, sd=SD):
    rotation = rotation_from_euler(0.0, tilt, 0.3)
    covariance = np.diag([sd**2 + shared**2] * 3 + [0.01**2] * 3)
    seen = -rotation.T @ np.array(place)
    return TargetView(at, seen, rotation, covariance, camera, (shared, shared, 0.0), is_placed)


def follow(place, *, seconds=2.0, tilt=0.0, camera="mocap", **more):
    """An estimate that stands, with level boards, after views of one place."""
    estimator = Estimator(AircraftModel(), view(0.0, place, tilt=tilt, camera=camera, **more), 118.0, compass=0.3)
    for k in range(1, round(seconds / 0.03)):
        estimator.attitude_received(0.03 * k - 0.01, 0.0, 0.0, 0.3)
        estimator.target_seen(view(0.03 * k, place, tilt=tilt, camera=camera, **more), 0.03 * k)
    return estimator


def test_a_crooked_body_moves_no_place():
    place = (4.0, -3.0, 1.5)
    found = follow(place, tilt=math.radians(2.0)).estimate(2.0)
    assert found.position == pytest.approx(place, abs=0.005)


def test_the_first_view_places_the_estimate_exactly():
    estimator = Estimator(AircraftModel(), view(0.0, (4.0, -3.0, 1.5), tilt=0.1), 118.0)
    assert estimator.estimate(0.0).position == pytest.approx((4.0, -3.0, 1.5), abs=1e-6)


def test_height_and_distance_are_those_of_the_place():
    found = view(0.0, (4.0, -3.0, 1.5), tilt=0.2)
    assert (found.height, found.aside) == (pytest.approx(1.5), pytest.approx(5.0))
    seen = view(0.0, (4.0, -3.0, 1.5), tilt=0.2, is_placed=False)
    assert seen.height == -float(seen.position_flu[2])


def of_map(place, tilt, *, is_of_map=True, at=0.0):
    """A pose on a map, by a camera that is mounted crooked, as the estimator takes it."""
    rotation = rotation_from_euler(0.0, tilt, 0.3)
    pose = events.pose(at).model_copy(
        update={
            "position_target": place,
            "position_flu": tuple(-rotation.T @ np.array(place)),
            "quaternion_target_from_flu": quaternion_from_rotation(rotation),
            "is_of_map": is_of_map,
        }
    )
    return view_of(pose)


def test_six_metres_from_the_origin_of_a_map_a_crooked_camera_moves_it_by_its_height_alone():
    place, crooked = (-6.0, 0.5, 0.4), math.radians(2.0)
    first = of_map(place, crooked)
    estimator = Estimator(AircraftModel(), first, 118.0, compass=0.3)
    for k in range(1, 60):
        estimator.attitude_received(0.03 * k - 0.01, 0.0, 0.0, 0.3)
        estimator.target_seen(replace(first, at=0.03 * k), 0.03 * k)
    off = math.dist(estimator.estimate(1.77).position, place)
    assert (first.height, first.aside) == (pytest.approx(0.4, abs=0.001), pytest.approx(math.hypot(6.0, 0.5)))
    assert first.place == pytest.approx(place)
    assert off < 0.4 * math.sin(crooked) + 0.002
    # Of its origin it would be 6 m times the tilt.
    assert abs(of_map(place, crooked, is_of_map=False).height - 0.4) > 0.19
    later = of_map((-5.9, 0.5, 0.4), crooked, at=0.1)
    assert velocity_between(first, later) == pytest.approx((1.0, 0.0, 0.0), abs=1e-9)


def test_a_velocity_is_the_difference_of_two_places():
    before, after = view(0.0, (4.0, -3.0, 1.5), tilt=0.1), view(0.1, (4.05, -3.0, 1.5), tilt=-0.1)
    assert velocity_between(before, after) == pytest.approx((0.5, 0.0, 0.0), abs=1e-9)


def test_what_its_reports_have_in_common_stays_in_the_deviation():
    sure, vague = (follow((0.0, 0.0, 1.5), shared=shared).estimate(2.0).position_sd for shared in (0.0, 0.05))
    assert sure.max() < 0.01
    assert vague.min() == pytest.approx(0.05, abs=0.005)


def test_a_calibration_less_certain_than_the_pose_is_a_fault():
    wrong = TargetView(0.0, np.zeros(3), np.eye(3), np.eye(6) * 1e-6, "mocap", (0.1, 0.1, 0.0), is_placed=True)
    assert wrong.fault is not None


def test_of_two_sources_the_one_that_is_off_is_named_and_not_used():
    place, off = (0.0, 0.0, 1.5), (0.3, 0.0, 1.5)
    estimator = Estimator(AircraftModel(), view(0.0, place, shared=0.01), 118.0, compass=0.3)
    for k in range(1, 80):
        t = 0.03 * k
        estimator.attitude_received(t - 0.02, 0.0, 0.0, 0.3)
        estimator.target_seen(view(t - 0.015, off, camera="uwb", shared=0.01), t - 0.015)
        estimator.target_seen(view(t, place, shared=0.01), t)
    assert estimator.contradicting == ("uwb",)
    assert estimator.estimate(2.4).position == pytest.approx(place, abs=0.02)
    assert not estimator.stands_on("mocap")


def test_two_that_agree_within_their_frames_are_both_used():
    place, near = (0.0, 0.0, 1.5), (0.015, 0.0, 1.5)
    estimator = Estimator(AircraftModel(), view(0.0, place, shared=0.01), 118.0, compass=0.3)
    for k in range(1, 80):
        t = 0.03 * k
        estimator.attitude_received(t - 0.02, 0.0, 0.0, 0.3)
        estimator.target_seen(view(t - 0.015, near, camera="uwb", shared=0.01), t - 0.015)
        estimator.target_seen(view(t, place, shared=0.01), t)
    assert estimator.contradicting == ()


def test_an_estimate_stands_on_one_source_when_others_are_silent():
    estimator = follow((0.0, 0.0, 1.5))
    assert estimator.stands_on("mocap")
    assert not estimator.stands_on("down")


def moved(*, mirrored_from, seconds=3.0, with_camera=True):
    """An aircraft that leaves the middle at 0.3 m/s, by a source whose x is mirrored from a time on, and a camera."""
    estimator = Estimator(AircraftModel(), view(0.0, (0.0, 0.0, 1.5), shared=0.01), 118.0, compass=0.3)
    named = []
    for k in range(1, round(seconds / 0.03)):
        t = 0.03 * k
        x = 0.3 * max(0.0, t - 1.0)
        seen = (-x if t >= mirrored_from else x, 0.0, 1.5)
        estimator.attitude_received(t - 0.02, 0.0, 0.0, 0.3)
        estimator.target_seen(view(t, seen, shared=0.01), t)
        if with_camera:
            seen = view(t - 0.01, (0.3 * max(0.0, t - 1.01), 0.0, 1.5), camera="down", is_placed=False, shared=0.01)
            estimator.target_seen(seen, t)
        named.append(estimator.contradicting)
    return estimator, named


def test_a_source_never_outvotes_a_camera():
    estimator, named = moved(mirrored_from=0.9)
    assert ("down",) not in named[-30:]
    assert named[-1] == ("mocap",)
    assert estimator.estimate(3.0).position[0] == pytest.approx(0.6, abs=0.05)


def test_a_source_that_is_right_again_is_used_after_a_second():
    estimator, named = moved(mirrored_from=0.9)
    assert named[-1] == ("mocap",)
    agree = 0
    for k in range(100, 140):
        t = 0.03 * k
        estimator.attitude_received(t - 0.02, 0.0, 0.0, 0.3)
        place = (0.3 * (t - 1.0), 0.0, 1.5)
        estimator.target_seen(view(t, place, shared=0.01), t)
        estimator.target_seen(view(t, place, camera="down", is_placed=False, shared=0.01), t)
        agree += bool(estimator.contradicting)
    assert not estimator.contradicting
    assert 28 <= agree <= 34
