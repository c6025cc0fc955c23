"""A first pose under a rolling shutter: a climb nobody knows yet looks like a tilt."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest

from lab.vision.flight import LOOKING_DOWN, VGA, fly
from lab.vision.real import DEVICES
from lab.vision.stills import error_of, target_named
from mkdaemon.config.vision import TrackerSection
from mkdaemon.vision.pose.pose import Pose
from mkdaemon.vision.tags.tagmap import TagMap
from mkdaemon.vision.track.attitude import ImageSight
from mkdaemon.vision.track.follower import Track
from mkdaemon.vision.track.tracker import Tracker

PIXELS = np.zeros((4, 4), np.uint8)


def test_images_of_an_unknown_climb_are_followed_until_they_tell_it() -> None:
    device, target = DEVICES["rolling"], target_named("nested")
    tracker = Tracker(TagMap((target,)), VGA.model_copy(update={"line_time": device.line_time}))
    posed = []
    for frame in fly(target, 1300, seconds=0.3, near=0.35, far=8.0, troubled=False, device=device):
        found = tracker.update(frame.image).pose_of(target.name)
        posed.append(found is not None)
        if found is not None:
            error = error_of(found.pose.rotation, found.pose.position, frame.rotation, frame.position)
            assert error.distance < 0.01
            assert error.angle_deg < 2.0
    assert not posed[0]  # the speed along the optical axis is unknown, and so is the tilt
    assert all(posed[5:])  # 0 of 9 were posed when such an image was forgotten


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


def test_the_second_image_knows_the_climb_from_both_ranges() -> None:
    """Its own range and that of the first tell the speed along the optical axis."""
    device, target = DEVICES["rolling"], target_named("nested")
    tracker = Tracker(TagMap((target,)), VGA.model_copy(update={"line_time": device.line_time}), LOOKING_DOWN)
    posed = []
    for frame in fly(target, 3003203, seconds=0.1, near=0.35, far=8.0, troubled=False, device=device):
        found = tracker.update(frame.image, frame.attitude).pose_of(target.name)
        posed.append(found is not None)
        if found is not None:
            error = error_of(found.pose.rotation, found.pose.position, frame.rotation, frame.position)
            assert error.distance < 0.01
            assert error.angle_deg < 2.0
    assert posed == [False, True, True]


@pytest.mark.parametrize(("inliers", "knows"), [(1.0, True), (0.46, False)])
def test_a_range_that_few_edges_agree_with_tells_no_climb(inliers: float, knows: bool) -> None:
    """Such a fit, 10 cm too far, made a climb of 3.2 m/s of nothing: 3 degrees off at 1 m, NEES 39."""
    track = Track(TrackerSection().coast)
    first = Pose(np.diag([1.0, -1.0, -1.0]), np.array([0.0, 0.0, 1.0]), 1e-6 * np.eye(6), "edges", 300, 0.05)
    track.accept(ImageSight(PIXELS, 0.0, np.eye(3)), first)
    found = replace(first, position=1.1 * first.position, inliers=inliers)
    lens = VGA.model_copy(update={"line_time": DEVICES["rolling"].line_time})
    follower = Tracker(TagMap((target_named("nested"),)), lens, LOOKING_DOWN).followers[0]
    follower.track = track
    follower._fitter.refine = lambda *_: found  # type: ignore[method-assign]
    start = follower._with_climb(ImageSight(PIXELS, 1 / 30, np.eye(3)), first)
    assert (start.known_motion is not None) is knows
