"""Lens models against OpenCV and by differences; poses through a fisheye as exact as through a pinhole."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
from pydantic import ValidationError

from mkdaemon.vision.camera.calibration_file import Intrinsics
from mkdaemon.vision.pose.projection import Projection
from mkdaemon.vision.tags.tagmap import TagMap
from mkdaemon.vision.track.tracker import Tracker
from mksim.scene.view import project
from tests.vision.views import VGA, View, assert_near, place, shipped

COEFFICIENTS = {"k1": -0.02, "k2": 0.005, "k3": -0.002, "k4": 3e-4}
FISHEYE = VGA.model_copy(update={"fx": 285.0, "fy": 285.0, "model": "fisheye", **COEFFICIENTS})
"""128 degrees wide."""
BARREL = Intrinsics(width=640, height=480, fx=500.0, fy=505.0, cx=320.0, cy=240.0, k1=-0.2, k2=0.05, p1=1e-3, p2=-5e-4)


def points(reach: float) -> np.ndarray:
    rng = np.random.default_rng(3)
    xy = rng.uniform(-reach, reach, (60, 2))
    xy[0] = 0.0
    z = rng.uniform(0.5, 4.0, 60)
    return np.column_stack([xy * z[:, None], z])


@pytest.mark.parametrize(("k", "reach"), [(FISHEYE, 1.4), (BARREL, 0.6)], ids=["fisheye", "pinhole"])
def test_projection_derivatives_and_inverse_agree(k: Intrinsics, reach: float) -> None:
    projection, seen = Projection(k), points(reach)
    pixels, visible = projection.project(seen)
    assert visible.all()
    np.testing.assert_allclose(pixels, project(seen, k), atol=1e-6)
    np.testing.assert_allclose(projection.undistort(pixels), seen[:, :2] / seen[:, 2:], atol=1e-6)
    jacobian = projection.jacobian(seen)
    for axis in range(3):
        step = np.zeros(3)
        step[axis] = 1e-6
        differences = (projection.project(seen + step)[0] - projection.project(seen - step)[0]) / 2e-6
        np.testing.assert_allclose(jacobian[:, :, axis], differences, rtol=1e-4, atol=1e-3)
    more = Projection(k.model_copy(update={"k1": k.k1 + 1e-6}))
    np.testing.assert_allclose(projection.k1_jacobian(seen), (more.project(seen)[0] - pixels) / 1e-6, atol=1e-2)


def test_a_fisheye_that_folds_back_shows_nothing_beyond() -> None:
    folding = FISHEYE.model_copy(update={"k1": -0.3, "k2": 0.0, "k3": 0.0, "k4": 0.0})
    _, visible = Projection(folding).project(np.array([[0.5, 0.0, 1.0], [4.0, 0.0, 1.0]]))
    assert visible.tolist() == [True, False]


def test_pixels_outside_the_field_of_a_fisheye_get_its_rim() -> None:
    far = Projection(FISHEYE).undistort(np.array([[5000.0, 239.5]]))
    assert np.isfinite(far).all()
    assert far[0, 0] == pytest.approx(np.tan(1.5))


def test_coefficients_of_the_other_model_are_refused() -> None:
    for change in ({"model": "fisheye", "p1": 0.1}, {"k4": 0.1}):
        with pytest.raises(ValidationError, match="has no place in the model"):
            Intrinsics(width=640, height=480, fx=300.0, fy=300.0, cx=320.0, cy=240.0, **change)


@pytest.mark.parametrize("distance", [0.6, 1.5])
def test_a_pose_through_a_fisheye_is_true_near_the_rim(distance: float) -> None:
    straight, aside = place(distance, 0.3), cv2.Rodrigues(np.array([0.0, 0.6, 0.0]))[0]
    view = View(shipped("nested"), replace(straight, intrinsics=FISHEYE, enu_from_cam=straight.enu_from_cam @ aside))
    assert abs(view.position[0] / view.position[2]) > 0.6
    (found,) = Tracker(TagMap((shipped("nested"),)), FISHEYE).update(view.image()).poses
    assert_near(found.pose, view, m=0.003 * distance, deg=0.4)
