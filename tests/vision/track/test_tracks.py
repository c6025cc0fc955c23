"""Flights and first images that a tracker has to survive: take-offs, far, grazing and turning views."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from math import radians

import cv2
import numpy as np
import pytest

from lab.vision.flight import LOOKING_DOWN, fly
from lab.vision.real import DEVICES
from lab.vision.stills import Studio, error_of, look_once, target_named
from mkdaemon.config.vision import TrackerSection
from mkdaemon.frames import euler_from_rotation, rotation_from_euler
from mkdaemon.telemetry.vision import PoseRefusal
from mkdaemon.vision.camera.calibration_file import Intrinsics
from mkdaemon.vision.camera.image import CameraImage
from mkdaemon.vision.pose.fitting import TargetFitter
from mkdaemon.vision.pose.gates import fit_refusal
from mkdaemon.vision.pose.pose import Pose, angle_between
from mkdaemon.vision.pose.projection import Projection
from mkdaemon.vision.tags.tagmap import TagMap
from mkdaemon.vision.track.attitude import AttitudeHistory, AttitudeSample, ImageSight
from mkdaemon.vision.track.follower import Track
from mkdaemon.vision.track.judge import Judge
from mkdaemon.vision.track.level import LevelKnowledge
from mkdaemon.vision.track.tracker import Tracker
from mksim.scene.light import Cover, LightConditions
from mksim.scene.motion import Platform
from mksim.scene.scene import Scene, SceneTarget, cam_from_target
from mksim.scene.view import CameraView
from tests.vision.views import VGA, View, angle_deg, asphalt, assert_near, place, shipped

FPS = 15.0
STANDS, LEVELS, ENDS = 0.4, 1.2, 2.8
"""The aircraft stands on the pad until, is level from, and the flight ends [s]."""
LONGEST_HOLE = 0.5
"""Between two poses while the target is in view [s]."""
RISES = 1.0
"""Speed of the climb [m/s]."""


def attitude_at(time: float, pad: np.ndarray) -> np.ndarray:
    """Attitude of the aircraft: that of the pad, then level with a slow sway `(3, 3)`."""
    roll, pitch, yaw = euler_from_rotation(pad @ rotation_from_euler(0.0, 0.0, 0.6))
    share = np.clip((time - STANDS) / (LEVELS - STANDS), 0.0, 1.0)
    sway = radians(2.0) * share * np.array([np.sin(5.0 * time), np.cos(6.0 * time)])
    return rotation_from_euler(roll * (1.0 - share) + sway[0], pitch * (1.0 - share) + sway[1], yaw)


@cache
def takeoff() -> tuple[list, list]:
    """Images with their truth, and the attitudes of the aircraft at 20 Hz."""
    deck = Platform(roll=radians(9.6), pitch=radians(7.2))
    pad = deck.pose_at(0.0).enu_from_body
    placed = SceneTarget.of(shipped("nested"), deck)
    scene = Scene([placed], ground=asphalt(), seed=5, fine=False)
    shots = []
    for time in np.arange(0.0, ENDS, 1.0 / FPS):
        climb = RISES * max(time - STANDS, 0.0)
        place = 0.15 * pad[:, 2] + np.array([0.05 * climb, -0.03 * climb, climb])
        cam = attitude_at(time, pad) @ LOOKING_DOWN.flu_from_cam
        view = CameraView(VGA, cam, place, velocity_enu=np.array([0.0, 0.0, RISES * (time > STANDS)]), time=time)
        shots.append((time, scene.render(view, LightConditions(noise_sd=2.0)), *cam_from_target(placed, view)))
    times = np.arange(0.0, ENDS, 0.05)
    return shots, [AttitudeSample(at, *euler_from_rotation(attitude_at(at, pad))) for at in times]


@pytest.mark.parametrize(
    ("begins", "stops", "returns"),
    [
        (0.0, ENDS, ENDS),
        (ENDS, ENDS, ENDS),
        (0.0, STANDS, ENDS),
        (0.0, 0.9, 2.0),
    ],
    ids=["never", "from the start", "from lift-off on", "for a second"],
)
def test_poses_continue_though_the_attitude_stops(begins, stops, returns):
    """A course of one image, close to a pad, held against every image after it: 89 of 90 were refused."""
    shots, attitudes = takeoff()
    known = [s for s in attitudes if begins <= s.time < stops or s.time >= returns]
    tracker, posed = Tracker(TagMap((shipped("nested"),)), VGA, LOOKING_DOWN), [0.0]
    for number, (time, pixels, rotation, position) in enumerate(shots):
        history = AttitudeHistory(s for s in known if s.time <= time + 1.0 / FPS)
        found = tracker.update(CameraImage(pixels, time, time, number, "down", "driver"), history).pose_of("pad")
        if found is not None:
            assert np.linalg.norm(found.pose.position - position) < 0.05
            assert np.degrees(angle_between(found.pose.rotation, rotation)) < 5.0
            posed.append(time)
    assert max(np.diff([*posed, shots[-1][0]])) <= LONGEST_HOLE
    assert len(posed) > 0.9 * len(shots)


HD = Intrinsics(width=1280, height=720, fx=1200.0, fy=1200.0, cx=639.5, cy=359.5, line_time=0.0)


@pytest.mark.parametrize(
    ("name", "lens", "distance", "tilt"),
    [
        ("single", HD, 8.0, 0.15),  # both readings fitted to edges, told apart by all pixels
        ("single", HD, 9.0, 0.4),
        ("nested", VGA, 8.0, 0.4),
        ("nested", VGA, 8.0, 0.6),
    ],
)
def test_the_first_image_decides(name: str, lens: Intrinsics, distance: float, tilt: float) -> None:
    """A far target, without attitude: the image tells it from its mirror image."""
    view = View(shipped(name), replace(place(distance, tilt), intrinsics=lens))
    found = Tracker(TagMap((shipped(name),)), lens, None).update(view.image()).pose_of("pad")
    assert found.decided_by == "image"
    assert_near(found.pose, view, deg=1.0, m=0.01 * distance)


def test_a_fit_that_ended_between_both_readings_is_asked_for_another() -> None:
    """Nearly head on, on the saddle between a target tilted by a few degrees and its mirror image."""
    view = View(shipped("single"), place(7.0, np.radians(4.0)))
    fitter = TargetFitter(shipped("single"), Projection(VGA))
    axis = np.cross(view.rotation[:, 2], -view.position)
    beyond = cv2.Rodrigues(np.radians(6.4) * axis / np.linalg.norm(axis))[0] @ view.rotation
    saddle = fitter.refine(view.pixels, Pose(beyond, view.position, 1e-6 * np.eye(6), "photometric", 800, 0.05))
    assert np.degrees(saddle.tilt) < 2.5
    assert angle_deg(saddle.rotation, view.rotation) > 4.0
    cfg = TrackerSection()
    judge = Judge(fitter, LevelKnowledge(True, LOOKING_DOWN, cfg), cfg)
    rivals = judge.candidates(ImageSight(view.pixels, 0.0), [saddle])
    best = min(rivals, key=lambda rival: rival.loss)
    assert angle_deg(best.rotation, view.rotation) < 1.0


def test_nothing_wrong_is_published_from_84_degrees() -> None:
    """So flat that cells show neither edges nor grey values: four corners alone are no fit.

    Corners there were off by 6 to 9 cm and claimed 0.3 cm: 5 of 60 images near the border of the image.
    """
    corners = Pose(np.eye(3), np.array([0.0, 0.0, 2.0]), 1e-8 * np.eye(6), "corners", 4, 0.05)
    assert fit_refusal(corners, TrackerSection()) is PoseRefusal.NO_FIT
    target = target_named("single")
    studio, seen = Studio(target, 3_000_300, fine=False, part=84), 0
    for _ in range(5):
        still = studio.shoot(2.0, float(np.radians(84.0)), off=0.3)
        found = look_once(still, target, VGA, with_attitude=True).pose_of(target.name)
        if found is not None:
            seen += 1
            assert found.pose.source != "corners"
            assert error_of(found.pose.rotation, found.pose.position, still.rotation, still.position).distance < 0.05
    assert seen > 1


TARGET = shipped("single")
HALF = TARGET.tags[0].size / 2
BAND = Cover(((-2 * HALF, 0.72 * HALF), (2 * HALF, 0.72 * HALF), (2 * HALF, 2 * HALF), (-2 * HALF, 2 * HALF)), 0.4)
"""Over one border of the tag: it is not decoded."""
STEP = 1.0 / 30.0
IMAGES, NEAR, LIES = 30, 12, 16
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


def test_a_yaw_of_the_wrong_sign_loses_no_image() -> None:
    assert lost(lambda k, s: AttitudeSample(s.time, s.roll, s.pitch, -s.yaw if k >= LIES else s.yaw)) == []


def test_a_roll_that_jumps_loses_two_images() -> None:
    jumped = lost(lambda k, s: AttitudeSample(s.time, s.roll + np.radians(10.0 if k >= LIES else 0.0), s.pitch, s.yaw))
    assert jumped == [LIES, LIES + 1]


PIXELS = np.zeros((4, 4), np.uint8)


@pytest.mark.parametrize(
    ("seed", "seconds", "mounting", "blind"),
    [
        # the speed along the optical axis is unknown, and so is the tilt; 0 of 9 were posed when it was forgotten
        (1300, 0.3, None, 5),
        # its own range and that of the first tell the second image the climb
        (3003203, 0.1, LOOKING_DOWN, 1),
    ],
    ids=["without attitude", "with attitude"],
)
def test_images_of_an_unknown_climb_are_followed_until_they_tell_it(seed, seconds, mounting, blind) -> None:
    device, target = DEVICES["rolling"], shipped("nested")
    tracker = Tracker(TagMap((target,)), VGA.model_copy(update={"line_time": device.line_time}), mounting)
    posed = []
    for frame in fly(target, seed, seconds=seconds, near=0.35, far=8.0, troubled=False, device=device):
        found = tracker.update(frame.image, None if mounting is None else frame.attitude).pose_of(target.name)
        posed.append(found is not None)
        if found is not None:
            assert_near(found.pose, frame, m=0.01, deg=2.0)
    assert not posed[0]
    assert all(posed[blind:])


@pytest.mark.parametrize("known", [False, True])
@pytest.mark.parametrize("rate", [0.4, 1.5])
def test_a_camera_that_turns_without_an_attitude_does_not_climb(rate: float, known: bool) -> None:
    """Nor where the images before had one: the turn is in the step all the same."""
    track, place = Track(TrackerSection().coast), np.array([0.6, 0.4, 3.0])
    for k in range(2):
        turned = np.asarray(cv2.Rodrigues(k / 30 * rate * np.array([1.0, -1.0, 0.0]))[0], dtype=np.float64)
        pose = Pose(turned, turned @ place, 1e-6 * np.eye(6), "edges", 300, 0.05)
        track.accept(ImageSight(PIXELS, k / 30, np.eye(3) if known else None), pose)
    motion = track.predict(ImageSight(PIXELS, 2 / 30)).known_motion
    assert abs(motion.mean[3]) < 0.05  # 0.4 m/s and more where the turn was taken for a climb
