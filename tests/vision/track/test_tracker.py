"""The tracker on rendered images: what is published is true, and what is refused has a reason."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest

from lab.vision.flight import LOOKING_DOWN, VGA, fly
from mkdaemon.frames import euler_from_rotation, rotation_from_euler
from mkdaemon.telemetry.vision import Alarm, PoseRefusal
from mkdaemon.vision.camera.image import CameraImage
from mkdaemon.vision.pose.fitting import TargetFitter
from mkdaemon.vision.pose.gates import certainty_refusal
from mkdaemon.vision.pose.pose import FLOOR_ANGLE, FLOOR_RANGE
from mkdaemon.vision.tags.tagmap import TagMap
from mkdaemon.vision.track.attitude import AttitudeHistory, AttitudeSample, ImageSight
from mkdaemon.vision.track.tracker import TargetRefusal, Tracker
from mksim.scene.light import LightConditions
from mksim.scene.motion import Platform
from mksim.scene.scene import Scene, SceneTarget, cam_from_target
from tests.vision.views import View, angle_deg, assert_near, place, shipped


@lru_cache(maxsize=1)
def flight(seed: int):
    return tuple(fly(shipped("nested"), seed, seconds=1.3))


def history(rpy, time: float = 0.0) -> AttitudeHistory:
    return AttitudeHistory([AttitudeSample(time, *rpy)])


def attitude_of(view) -> AttitudeHistory:
    return history(euler_from_rotation(view.view.enu_from_cam @ LOOKING_DOWN.flu_from_cam.T))


WRONG = history((0.5, 0.3, 0.0))


def tracker(name="nested", **options) -> Tracker:
    return Tracker(TagMap((shipped(name),)), VGA, LOOKING_DOWN, **options)


@pytest.mark.parametrize("with_attitude", [True, False])
def test_a_troubled_flight_is_followed_without_a_wrong_pose(with_attitude):
    """Nor does a track go on for longer than about a second without reading a tag."""
    follower, frames, found = tracker(), flight(3), []
    for frame in frames:
        result = follower.update(frame.image, frame.attitude if with_attitude else None)
        for pose in result.poses:
            found.append(pose)
            assert_near(pose.pose, frame, deg=5.0, m=0.05)
    assert len(found) > (0.9 if with_attitude else 0.6) * len(frames)
    assert {"search", "predicted"} <= {pose.mode for pose in found}
    assert not with_attitude or 0.5 < max(pose.decode_age for pose in found) < 1.6


@pytest.mark.parametrize(("shaken", "first"), [(0.0, "predicted"), (0.016, "flow")])
def test_a_fit_begins_where_the_image_shows_the_target(monkeypatch, shaken, first):
    """A camera that turned by more than a cell asks for no fit where nothing is."""
    follower, starts, refine, steady = tracker(), [], TargetFitter.refine, place(3.0, 0.2)
    monkeypatch.setattr(TargetFitter, "refine", lambda self, *given: starts.append(given[1]) or refine(self, *given))
    for k in range(4):
        turned = replace(steady, enu_from_cam=steady.enu_from_cam @ rotation_from_euler(0.0, shaken * (k == 3), 0.0))
        view = View(shipped("nested"), turned)
        starts.clear()
        found = follower.update(view.image(k / 30, k), attitude_of(View(shipped("nested"), steady))).pose_of("pad")
    assert (found.mode, len(starts)) == (first, 1)
    assert_near(found.pose, view, m=0.01)


def test_covariance_carries_the_calibration_floor():
    view = View(shipped("nested"), place(2.0, 0.3))
    found = tracker().update(view.image(), attitude_of(view)).pose_of("pad")
    assert np.sqrt(found.covariance[2, 2]) >= 0.9 * FLOOR_RANGE * 2.0
    assert np.sqrt(found.covariance[5, 5]) >= FLOOR_ANGLE
    rotation, centre, covariance = found.camera_in_target()
    assert np.linalg.norm(centre - view.view.position_enu) < 0.02
    assert np.allclose(rotation @ found.pose.rotation, np.eye(3))
    assert np.linalg.eigvalsh(covariance).min() > 0


def test_no_pose_without_calibration():
    view = View(shipped("nested"), place(1.5, 0.3))
    blind = Tracker(TagMap((shipped("nested"),)), None, LOOKING_DOWN)
    result = blind.update(view.image())
    assert result.poses == ()
    assert "uncalibrated" in result.alarms
    assert {found.tag_id for found in result.detections} == {1, 48}


def test_a_contradicting_attitude_stops_the_pose_and_is_ignored_for_walls_and_without_a_mounting():
    nested = shipped("nested")
    view = View(nested, place(2.0, 0.3))
    result = tracker().update(view.image(), WRONG)
    assert result.poses == ()
    assert result.refused == (TargetRefusal("pad", PoseRefusal.ATTITUDE, 0.0),)
    assert result.has_attitude
    assert tracker().update(view.image(), attitude_of(view)).poses
    wall = TagMap((replace(nested, level=False),))
    assert Tracker(wall, VGA, LOOKING_DOWN).update(view.image(), WRONG).poses
    assert Tracker(TagMap((nested,)), VGA, None).update(view.image(), WRONG).poses


SHAPES = [(480, 640), (720, 1280), (480, 640, 3), (640,), (), (0, 640), (1, 1), (2, 640), (480, 3)]


@pytest.mark.parametrize("dtype", ["u1", "?", "i1", "u2", ">u2", "i4", "f2", "f4", "f8", "c8", "O", "S1"])
@pytest.mark.parametrize("calibrated", [True, False])
def test_an_image_of_any_kind_and_size_is_named_and_raises_nothing(dtype, calibrated):
    eyes = tracker() if calibrated else Tracker(TagMap((shipped("nested"),)), None)
    for number, shape in enumerate(SHAPES):
        pixels = np.zeros(shape, dtype)
        result = eyes.update(CameraImage(pixels, 0.1 * number, 0.0, number, "test"))
        assert result.poses == ()
        if dtype != "u1":
            assert result.alarms == (Alarm.WRONG_KIND,)
        elif len(shape) != 2 or 0 in shape or (calibrated and shape != (480, 640)):
            assert result.alarms == (Alarm.WRONG_SIZE,)
        else:
            assert Alarm.DARK in result.alarms


def test_loss_is_honest_and_the_target_is_found_again():
    frames, follower = flight(3), tracker()
    empty = View(shipped("nested"), place(2.0, 0.2), replace(LightConditions(), target_in_view=False)).pixels
    for frame in frames[:6]:
        last = follower.update(frame.image, frame.attitude)
    assert last.poses
    for k, frame in enumerate(frames[6:16]):
        noisy = np.clip(empty.astype(int) + np.random.default_rng(k).integers(-1, 2, empty.shape), 0, 255)
        gone = follower.update(replace(frame.image, pixels=noisy.astype(np.uint8)), frame.attitude)
        assert gone.poses == ()
    assert any(follower.update(frame.image, frame.attitude).poses for frame in frames[16:22])


def test_time_that_stands_still_or_runs_back_ends_the_track():
    frames, follower = flight(3), tracker()
    for frame in (*frames[:4], frames[1]):
        again = follower.update(frame.image, frame.attitude)
    assert all(found.mode == "search" for found in again.poses)


def test_two_targets_each_in_its_frame_one_of_them_moving():
    nested, single = shipped("nested"), shipped("single")
    deck = replace(single, name="deck", frame="deck", moving=True, tags=(replace(single.tags[0], tag_id=9),))
    still = SceneTarget.of(nested, Platform(start_enu=(-0.35, 0.0, 0.0)))
    moving = SceneTarget.of(deck, Platform("straight", (0.35, 0.0, 0.0), speed=0.5))
    scene = Scene([still, moving], ground="tiles", seed=3, fine=False)
    follower, counted = Tracker(TagMap((nested, deck)), VGA, LOOKING_DOWN), 0
    for k in range(8):
        view = replace(place(2.2, 0.1), time=k / 30)
        for found in follower.update(CameraImage(scene.render(view), k / 30, k / 30, k, "test", "driver")).poses:
            rotation, position = cam_from_target(still if found.target == "pad" else moving, view)
            assert found.frame == found.target
            assert np.linalg.norm(found.pose.position - position) < 0.01
            assert angle_deg(found.pose.rotation, rotation) < 1.0
            counted += 1
    assert counted >= 14


def test_with_attitude_inertia_helps_an_uncertain_pose_that_agrees_with_it():
    follower = tracker("single")
    for k in range(14):
        view = View(shipped("single"), place(4.2 + 0.01 * k, 0.3, around=0.3 + 0.004 * k))
        found = follower.update(view.image(k / 30, k), attitude_of(view)).pose_of("pad")
    judge, before = follower.followers[0].judge, follower.followers[0].track.branches
    seen = ImageSight(view.pixels, 13 / 30 + 0.001, view.view.enu_from_cam)
    vague = replace(found.pose, covariance=found.pose.covariance + np.diag([1e-5, 1e-5, 4e-4, 1e-4, 1e-4, 1e-4]))
    assert certainty_refusal(vague, has_attitude=True) is PoseRefusal.POSITION_UNCERTAIN
    helped = judge.judge_with_attitude(seen, vague, before)
    assert helped.refusal is None
    assert np.linalg.norm(helped.pose.position - view.position) < 0.01
    elsewhere = replace(vague, position=vague.position * 1.03)
    refused = judge.judge_with_attitude(seen, elsewhere, before)
    assert refused.pose is elsewhere
    assert refused.refusal is PoseRefusal.POSITION_UNCERTAIN


@pytest.mark.parametrize(("passed", "is_posed"), [(1 / 30, False), (0.3, True), (2.0, True)])
def test_a_target_begins_anew_only_where_it_can_have_moved_to(passed, is_posed):
    """A drop on the lens shows a small second target, whose code is read and whose cells agree: 11 m away at 0.7 m."""
    follower = tracker()
    near, far = View(shipped("nested"), place(1.2, 0.2)), View(shipped("nested"), place(3.2, 0.2, around=np.pi))
    for k in range(3):
        assert follower.update(near.image(k / 30, k)).poses
    result = follower.update(far.image(2 / 30 + passed, 3))
    assert bool(result.poses) is is_posed
    if not is_posed:
        assert result.refused == (TargetRefusal("pad", PoseRefusal.OFF_COURSE, 0.0),)
        assert follower.update(near.image(3 / 30 + passed, 4)).poses, "what is in its place is found again"
