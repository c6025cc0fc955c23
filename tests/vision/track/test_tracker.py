"""The tracker on rendered images: what is published is true, what is refused has a reason, images of no use a name."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache, lru_cache, partial

import cv2
import numpy as np
import pytest

from lab.vision.flight import LOOKING_DOWN, fly
from mkdaemon.config.vision import TrackerSection
from mkdaemon.frames import euler_from_rotation, rotation_from_euler
from mkdaemon.telemetry.vision import Alarm, PoseRefusal
from mkdaemon.vision.camera.image import CameraImage
from mkdaemon.vision.limits import LIMITS
from mkdaemon.vision.pose.fitting import TargetFitter
from mkdaemon.vision.pose.pose import Pose
from mkdaemon.vision.tags.tagmap import TagMap
from mkdaemon.vision.track.attitude import AttitudeHistory, AttitudeSample, ImageSight
from mkdaemon.vision.track.follower import Track
from mkdaemon.vision.track.tracker import ImageHealth, TargetRefusal, Tracker
from mksim.scene.light import Cover, LightConditions
from mksim.scene.motion import Platform
from mksim.scene.scene import Scene, SceneTarget, cam_from_target
from tests.vision.views import VGA, View, angle_deg, assert_near, place, shipped


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


TARGET = shipped("single")
HALF = TARGET.tags[0].size / 2
BAND = Cover(((-2 * HALF, 0.72 * HALF), (2 * HALF, 0.72 * HALF), (2 * HALF, 2 * HALF), (-2 * HALF, 2 * HALF)), 0.4)
"""Over one border of the tag: it is not decoded."""
STEP = 1.0 / 30.0
IMAGES, NEAR, LIES = 22, 12, 15
"""Of a flight, from which the tag is larger than the image and covered, and from which the attitude is wrong."""


@cache
def views() -> tuple[View, ...]:
    """What the camera sees of a descent that turns by 4 degrees an image."""
    seen = [place(max(0.38, 0.7 - 0.32 * k / NEAR), 0.12, roll=0.07 * k) for k in range(IMAGES)]
    band = LightConditions(covers=(BAND,))
    return tuple(View(TARGET, view, band if k >= NEAR else None) for k, view in enumerate(seen))


def lost(report: Callable[[int, AttitudeSample], AttitudeSample]) -> list[int]:
    """Images without a pose of that descent; every pose that is published is right."""
    tracker = Tracker(TagMap((TARGET,)), VGA, LOOKING_DOWN)
    without, samples = [], []
    for k, view in enumerate(views()):
        rpy = euler_from_rotation(view.view.enu_from_cam @ LOOKING_DOWN.flu_from_cam.T)
        samples.append(report(k, AttitudeSample(k * STEP, *rpy)))
        found = tracker.update(view.image(k * STEP, k), AttitudeHistory(samples)).pose_of(TARGET.name)
        if found is None:
            without.append(k)
        else:
            assert_near(found.pose, view, deg=0.5, m=0.005)
    return without


def test_a_yaw_of_the_wrong_sign_loses_no_image_and_a_roll_that_jumps_two() -> None:
    assert lost(lambda k, s: AttitudeSample(s.time, s.roll, s.pitch, -s.yaw if k >= LIES else s.yaw)) == []
    jumped = lost(lambda k, s: AttitudeSample(s.time, s.roll + np.radians(10.0 if k >= LIES else 0.0), s.pitch, s.yaw))
    assert jumped == [LIES, LIES + 1]


@pytest.mark.parametrize(("rate", "known"), [(0.4, False), (1.5, True)])
def test_a_camera_that_turns_without_an_attitude_does_not_climb(rate: float, known: bool) -> None:
    """Nor where the images before had one: the turn is in the step all the same."""
    track, place = Track(TrackerSection().coast), np.array([0.6, 0.4, 3.0])
    for k in range(2):
        turned = np.asarray(cv2.Rodrigues(k / 30 * rate * np.array([1.0, -1.0, 0.0]))[0], dtype=np.float64)
        pose = Pose(turned, turned @ place, 1e-6 * np.eye(6), "edges", 300, 0.05)
        track.accept(ImageSight(np.zeros((4, 4), np.uint8), k / 30, np.eye(3) if known else None), pose)
    motion = track.predict(ImageSight(np.zeros((4, 4), np.uint8), 2 / 30)).known_motion
    assert abs(motion.mean[3]) < 0.05  # 0.4 m/s and more where the turn was taken for a climb


def shot(**change: float) -> np.ndarray:
    return View(shipped("nested"), place(1.2, 0.2), replace(LightConditions(), **change)).pixels


@pytest.mark.parametrize(
    ("image", "alarms"),
    [
        (shot, []),
        (partial(shot, exposure=0.06), ["dark"]),
        (partial(shot, noise_sd=40.0), []),
        (partial(np.zeros, (480, 640), np.uint8), ["dark"]),
        (partial(np.full, (480, 640), 255, np.uint8), ["blown"]),
        (partial(shot, exposure=30.0), ["blown"]),
        (partial(np.full, (720, 1280), 128, np.uint8), ["wrong_size"]),
        (partial(np.zeros, (0, 0), np.uint8), ["wrong_size"]),
    ],
)
def test_one_image(image: Callable[[], np.ndarray], alarms: list[str]) -> None:
    assert ImageHealth(VGA).check(image()) == alarms


def test_equal_images_are_a_frozen_camera() -> None:
    image, fresh = shot(), shot()
    health = ImageHealth(VGA)
    frozen = ["frozen" in health.check(image) for _ in range(LIMITS.health.frozen_images + 2)]
    assert frozen == [False] * LIMITS.health.frozen_images + [True] * 2
    assert "frozen" not in health.check(fresh)


def test_a_covered_lens_is_dark_and_not_frozen() -> None:
    health = ImageHealth(VGA)
    for _ in range(LIMITS.health.frozen_images + 3):
        assert health.check(np.zeros((480, 640), np.uint8)) == ["dark"]


@pytest.mark.parametrize(
    ("source", "blur_px", "side_px", "alarms"),
    [
        ("edges", 5.5, 80.0, ["blurred"]),
        ("edges", 4.0, 80.0, []),
        # Edges that melted are measured by grey values, which know the deviation of the point spread.
        ("photometric", 2.5, 80.0, ["blurred"]),
        ("photometric", 1.5, 80.0, []),
        ("photometric", 2.5, 40.0, []),
    ],
)
def test_images_without_focus_are_told_however_they_were_measured(source, blur_px, side_px, alarms) -> None:
    health = ImageHealth(VGA)
    pose = Pose(np.eye(3), np.array([0.0, 0.0, 2.0]), np.eye(6), source, 200, 0.05, blur_px=blur_px)
    for _ in range(30):
        health.note(pose, side_px)
    assert health.check(shot()) == alarms
