"""The fit to grey values where a print leaves the image."""

from __future__ import annotations

import numpy as np
import pytest

from mkdaemon.vision.camera.calibration_file import load_camera
from mkdaemon.vision.pose.photofit import PhotoFit
from mkdaemon.vision.pose.pose import Pose
from mkdaemon.vision.pose.projection import Projection
from mkdaemon.vision.tags.tagmap import load
from tests.places import CONFIGS

CAMERA = load_camera(CONFIGS / "cameras" / "sim.toml")
TARGET = load([CONFIGS / "targets" / "landing.toml"]).targets[0]
HALF = np.sqrt(0.5)
DIAMOND = np.diag([1.0, -1.0, -1.0]) @ np.array([[HALF, -HALF, 0.0], [HALF, HALF, 0.0], [0.0, 0.0, 1.0]])
"""Turned by 45 degrees: the frame around the print overlaps the image before the print does."""


def pose_at(pixel: np.ndarray, distance: float) -> Pose:
    """A target seen from straight above, its origin at a pixel."""
    k = CAMERA.intrinsics
    ray = np.array([(pixel[0] - k.cx) / k.fx, (pixel[1] - k.cy) / k.fy, 1.0])
    return Pose(DIAMOND, ray * distance, np.eye(6) * 1e-4, "edges", 40, 0.2, 1.0)


@pytest.mark.parametrize("right", [False, True])
@pytest.mark.parametrize("low", [False, True])
@pytest.mark.parametrize("distance", [6.0, 7.5, 9.0])
def test_a_far_print_that_leaves_by_a_corner_gives_no_pose(distance: float, low: bool, right: bool) -> None:
    pixels = np.random.default_rng(1).integers(0, 255, (480, 640), dtype=np.uint8)
    corner = np.array([639.0 if right else 0.0, 479.0 if low else 0.0])
    inwards = np.array([-1.0 if right else 1.0, -1.0 if low else 1.0])
    fit = PhotoFit(TARGET, Projection(CAMERA.intrinsics))
    for outside in np.linspace(-40.0, 0.0, 41):
        pose = fit.fit(pixels, pose_at(corner + inwards * outside, distance), iterations=1)
        assert pose is None or np.isfinite(pose.position).all()
