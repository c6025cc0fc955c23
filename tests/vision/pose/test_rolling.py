"""Rolling shutters: poses are those of the middle row, far prints arrive, and images tell the line time."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from lab.vision.flight import LOOKING_DOWN, VGA, Device, FlightFrame, fly
from lab.vision.stills import error_of, target_named
from mkdaemon.telemetry.vision import Alarm
from mkdaemon.vision.arrays import UnknownsEstimate
from mkdaemon.vision.camera.calibration_file import Intrinsics
from mkdaemon.vision.pose.edgefit import EdgeFit
from mkdaemon.vision.pose.fitting import TargetFitter
from mkdaemon.vision.pose.pose import Pose
from mkdaemon.vision.pose.projection import Projection
from mkdaemon.vision.pose.rolling import HIDDEN, LONGEST, MOTIONS, NOMINAL, Shutter, motion_jacobian
from mkdaemon.vision.tags.tagmap import TagMap
from mkdaemon.vision.track.attitude import AttitudeHistory
from mkdaemon.vision.track.tracker import Tracker
from mksim.scene.light import CLEAN, LightConditions
from mksim.scene.view import view_towards
from tests.vision.views import PlainView, angle_deg, assert_near, shipped, start_at

LINE_TIME = 30e-3 / 480
LENS = Intrinsics(width=640, height=480, fx=600.0, fy=600.0, cx=319.5, cy=239.5, line_time=LINE_TIME)
GLOBAL = LENS.model_copy(update={"line_time": 0.0})
SPEED = np.array([0.3, -0.2, 0.4])
RATE = np.array([0.3, -0.35, 0.25])


NESTED = shipped("nested")


def seen(eye, middle=(0.1, 0.0, 0.0), conditions: LightConditions = CLEAN, seed: int = 4, **motion) -> PlainView:
    """A print seen from a place [m] by a camera that moves while its rows are read."""
    at_rest = view_towards(GLOBAL, np.array(eye), np.array(middle))
    return PlainView(NESTED, replace(at_rest, line_time=LINE_TIME, **motion), conditions, seed)


def beginning(view: PlainView, known: UnknownsEstimate | None = None, nearer: float = 1.002) -> Pose:
    """A start near the truth, with what is known of the motion."""
    return replace(start_at(view, nearer=nearer, sd=1.0, source="corners"), known_motion=known)


@cache
def moving() -> PlainView:
    return seen((0.3, 0.2, 1.4), velocity_enu=SPEED, rate_cam=RATE)


def climb(speed: float) -> UnknownsEstimate:
    """A speed along the optical axis that a track knows, and nothing about turns."""
    return UnknownsEstimate(np.array([0.0, 0.0, 0.0, speed]), np.diag([1.0, 1.0, 1.0, 0.1**2]))


def fit(lens: Intrinsics, known: UnknownsEstimate | None = None) -> Pose:
    return EdgeFit(NESTED, Projection(lens)).fit(moving().pixels, beginning(moving(), known))


def test_cells_that_only_an_impossible_turn_explains_do_not_vouch() -> None:
    """A wrong place in the upper rows, and a turn that puts it there: 9 rad/s, where 1 rad/s was expected at most."""
    cells, found = TargetFitter(NESTED, Projection(LENS)).cells, fit(LENS)
    quiet, swung = (
        cells.evidence(
            moving().pixels, replace(found, known_motion=UnknownsEstimate(found.motion + surprise, np.eye(4)))
        )
        for surprise in (np.zeros(4), np.array([0.0, 9.0, 0.0, 0.0]))
    )
    assert quiet.odds - swung.odds == pytest.approx(9.0**2 / 2)
    assert quiet.together - swung.together == pytest.approx(9.0**2 / 2)
    assert quiet.vouches and not swung.vouches


def test_the_motion_while_the_rows_are_read_is_fitted_with_the_pose() -> None:
    plain, found = fit(GLOBAL), fit(LENS, climb(-float((moving().view.enu_from_cam.T @ SPEED)[2])))
    assert plain.motion is None, "a global shutter asks for none"
    off, off_deg = np.linalg.norm(plain.position - moving().position), angle_deg(plain.rotation, moving().rotation)
    assert_near(found, moving(), m=min(0.001, 0.2 * off), deg=min(0.15, 0.2 * off_deg))
    assert np.sign(found.motion[2]) == np.sign(RATE[2])


def test_the_derivative_by_the_motion_is_that_of_the_projection() -> None:
    projection = Projection(LENS)
    points = np.array([[0.2, 0.3, 1.5], [-0.3, -0.4, 2.0]])
    motion = np.array([0.2, -0.1, 0.3, 0.4])
    moved, times = projection.exposed(points, motion)
    by_point = projection.jacobian(moved)[:, 0]
    found = motion_jacobian(by_point, points, times)
    for k in range(4):
        step = np.zeros(4)
        step[k] = 1e-4
        ahead, _ = projection.exposed(points, motion + step)
        change = (projection.project(ahead)[0] - projection.project(moved)[0])[:, 0] / 1e-4
        np.testing.assert_allclose(found[k], change, rtol=0.02, atol=0.05)


REACH_PX = VGA.height / 2 * VGA.fx
READOUT = 25e-3 / VGA.height
BIAS = np.radians(0.7)


def learned(line_time: float, images: int, rate: float = 0.5, seed: int = 1) -> Shutter:
    """A shutter after images of a camera that turns, seen to 0.05 rad/s and known to 0.1."""
    rng, shutter = np.random.default_rng([seed, 0x5B]), Shutter(None, REACH_PX)
    for _ in range(images):
        motion = rate * rng.standard_normal(MOTIONS)
        seen = motion * line_time / NOMINAL + 0.05 * rng.standard_normal(MOTIONS)
        known = UnknownsEstimate(motion + 0.1 * rng.standard_normal(MOTIONS), 0.1**2 * np.eye(MOTIONS))
        shutter.learn(known, UnknownsEstimate(seen, 0.05**2 * np.eye(MOTIONS)))
    return shutter


@pytest.mark.parametrize("line_time", [15e-6, 30e-6, 60e-6])
def test_images_of_a_turning_camera_tell_the_line_time(line_time: float) -> None:
    found, sd = learned(line_time, 30).estimate
    assert abs(found - line_time) < 2.0 * sd
    assert HIDDEN * found < sd < 1.1 * HIDDEN * found
    assert learned(line_time, 30).is_open


def test_a_global_shutter_is_found_and_asked_no_more() -> None:
    shutter = learned(0.0, 30)
    assert not shutter.rolls
    assert not shutter.is_open


def test_a_camera_at_rest_tells_nothing_and_a_shutter_that_nobody_saw_move_says_so() -> None:
    assert learned(0.0, 200, rate=0.0).estimate == pytest.approx((NOMINAL, LONGEST / np.sqrt(12.0)))
    assert "unknown" in Shutter(None, REACH_PX).words
    assert Shutter(None, REACH_PX).scale == pytest.approx(np.sqrt(4.0 / 3.0))


def test_what_is_not_told_makes_a_motion_less_certain_by_the_variance_of_the_product() -> None:
    mean, spread = np.array([0.4, 0.0, -0.2, 1.0]), np.array([0.1, 0.2, 0.1, 0.1])
    known = UnknownsEstimate(mean, np.diag(spread**2))
    rng = np.random.default_rng(5)
    drawn = rng.uniform(0.0, 2.0, (200_000, 1)) * (mean + spread * rng.standard_normal((200_000, 4)))
    found = Shutter(None, REACH_PX).motion(known)
    np.testing.assert_allclose(found.mean, drawn.mean(axis=0), atol=0.01)
    np.testing.assert_allclose(np.sqrt(np.diag(found.covariance)), drawn.std(axis=0), rtol=0.02)
    told = Shutter(30e-6).motion(known)
    np.testing.assert_allclose(told.mean, known.mean)
    np.testing.assert_allclose(told.covariance, known.covariance)


@pytest.fixture(scope="module")
def shaken() -> list[FlightFrame]:
    """A flight behind a readout of 25 ms, on a frame that vibrates at 85 Hz, the roll reported off by 0.7 degrees."""
    device = Device(line_time=READOUT, vibration=1.0, vibration_hz=85.0, response=0.03)
    frames = list(fly(target_named("nested"), 61013, seconds=0.5, near=0.35, far=4.5, troubled=False, device=device))
    samples = [replace(sample, roll=sample.roll + BIAS) for sample in frames[0].attitude.samples]
    return [replace(frame, attitude=AttitudeHistory(samples)) for frame in frames]


def test_behind_an_untold_rolling_shutter_that_vibrates_no_pose_is_wrong_and_the_attitude_stays(
    shaken: list[FlightFrame],
) -> None:
    """8 of 16 were wrong, to 12 degrees, when it was taken for a global shutter, and the attitude was left out."""
    target = target_named("nested")
    tracker = Tracker(TagMap((target,)), VGA.model_copy(update={"line_time": None}), LOOKING_DOWN)
    posed, squares = 0, []
    for frame in shaken:
        result = tracker.update(frame.image, frame.attitude)
        assert Alarm.LINE_TIME in result.alarms
        assert tracker.contradicted_deg is None
        found = result.pose_of(target.name)
        if found is not None:
            error = error_of(found.pose.rotation, found.pose.position, frame.rotation, frame.position)
            assert error.distance < max(0.05, 0.01 * float(np.linalg.norm(frame.position)))
            assert error.angle_deg < 5.0
            vector = np.array([*error.xyz, *error.rpy])
            squares.append(float(vector @ np.linalg.solve(found.pose.covariance, vector)) / 6)
            posed += 1
    assert posed > 0.6 * len(shaken)
    assert np.median(squares) < 10.0  # 35 to 60 when it was taken for a global shutter
    line_time, sd = tracker.shutter.estimate
    assert abs(line_time - READOUT) < 3.0 * sd
    assert f"{1e6 * line_time:.0f} +- " in tracker.shutter.words
