"""From a tracker's result to the values on the bus."""

from __future__ import annotations

import numpy as np
import pytest

from mkdaemon.control.sight import view_of
from mkdaemon.frames import rotation_from_euler
from mkdaemon.stamp import Stamp
from mkdaemon.vision.camera.image import CameraImage
from mkdaemon.vision.pipeline import pose_of
from mkdaemon.vision.pose.pose import FLOOR_ANGLE, FLOOR_LATERAL, FLOOR_RANGE, Pose
from mkdaemon.vision.track.attitude import Mounting
from mkdaemon.vision.track.follower import TargetPose

DOWN = np.array([[0.0, -1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
"""Body from camera: it looks down, its top to the front."""


def test_what_all_images_have_in_common_is_told_apart_and_leaves_what_was_measured():
    """Off the middle and leaning: what the image itself does not know of the target's place, in body axes."""
    measured = np.diag([1e-4, 2e-4, 5e-4]) ** 2
    covariance = np.zeros((6, 6))
    covariance[:3, :3], covariance[3:, 3:] = measured, 1e-3**2 * np.eye(3)
    rotation = rotation_from_euler(0.2, -0.1, 0.7) @ np.diag([1.0, -1.0, -1.0])
    found = Pose(rotation, np.array([0.3, -0.2, 2.0]), covariance, "edges", 100, 0.1, 1.0)
    target = TargetPose("pad", "pad", found, 9.0, "image", "predicted", 0.0)
    image = CameraImage(np.zeros((4, 4), np.uint8), 1.0, 1.02, 7, "down", "header")
    pose = pose_of(target, image, Stamp(monotonic=1.0, wall=1.0), Mounting(DOWN, np.zeros(3)), 1.05)
    assert pose.calibration_sd == pytest.approx(
        (FLOOR_RANGE * found.range_m, FLOOR_LATERAL * found.range_m, FLOOR_ANGLE)
    )
    view = view_of(pose)
    left = view.sight_covariance - view.calibration_covariance
    assert left == pytest.approx(DOWN @ measured @ DOWN.T, abs=1e-9)
