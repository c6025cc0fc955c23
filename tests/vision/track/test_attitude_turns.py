"""An attitude that turns otherwise than the camera does not lose a target that is near."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np

from lab.vision.flight import LOOKING_DOWN
from mkdaemon.frames import euler_from_rotation
from mkdaemon.vision.camera.image import CameraImage
from mkdaemon.vision.tags.tagmap import TagMap
from mkdaemon.vision.track.attitude import AttitudeHistory, AttitudeSample
from mkdaemon.vision.track.tracker import Tracker
from mksim.scene.light import Cover, LightConditions
from tests.vision.views import VGA, View, angle_deg, place, shipped

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
    return tuple(
        View(
            TARGET,
            place(max(0.38, 0.7 - 0.32 * k / NEAR), 0.12, roll=0.07 * k),
            LightConditions(covers=(BAND,)) if k >= NEAR else None,
        )
        for k in range(IMAGES)
    )


@cache
def pixels_of(number: int) -> np.ndarray:
    """One of its images, rendered once."""
    return views()[number].pixels


def lost(report: Callable[[int, AttitudeSample], AttitudeSample]) -> list[int]:
    """Images without a pose of that descent; every pose that is published is right."""
    tracker = Tracker(TagMap((TARGET,)), VGA, LOOKING_DOWN)
    without, samples = [], []
    for k, view in enumerate(views()):
        rpy = euler_from_rotation(view.view.enu_from_cam @ LOOKING_DOWN.flu_from_cam.T)
        samples.append(report(k, AttitudeSample(k * STEP, *rpy)))
        image = CameraImage(pixels_of(k), k * STEP, k * STEP, k, "down")
        found = tracker.update(image, AttitudeHistory(samples)).pose_of(TARGET.name)
        if found is None:
            without.append(k)
        else:
            assert angle_deg(found.pose.rotation, view.rotation) < 0.5
            assert float(np.linalg.norm(found.pose.position - view.position)) < 0.005
    return without


def test_a_yaw_of_the_wrong_sign_loses_no_image() -> None:
    assert lost(lambda k, s: AttitudeSample(s.time, s.roll, s.pitch, -s.yaw if k >= LIES else s.yaw)) == []


def test_a_roll_that_jumps_loses_two_images() -> None:
    jumped = lost(lambda k, s: AttitudeSample(s.time, s.roll + np.radians(10.0 if k >= LIES else 0.0), s.pitch, s.yaw))
    assert jumped == [LIES, LIES + 1]
