"""The fit to grey values where it ends, where a print leaves the image, and what residuals say of the noise."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from mkdaemon.vision.camera.calibration_file import load_camera
from mkdaemon.vision.pose import photofit
from mkdaemon.vision.pose.edgefit import EdgeFit
from mkdaemon.vision.pose.photofit import STREAK_PX, PhotoFit, clarity, on_slopes, shared_by, streak_doubt
from mkdaemon.vision.pose.pose import Pose, turn
from mkdaemon.vision.pose.projection import Projection
from mkdaemon.vision.tags.targetfile import load
from mksim.scene.light import LightConditions
from tests.places import CONFIGS
from tests.vision.views import VGA, View, assert_near, nees, place, shipped, start_at

CAMERA = load_camera(CONFIGS / "cameras" / "sim.toml")
TARGET = load([CONFIGS / "targets" / "landing.toml"]).targets[0]
NESTED, SINGLE, PROJECTION = shipped("nested"), shipped("single"), Projection(VGA)
HALF = np.sqrt(0.5)
DIAMOND = np.diag([1.0, -1.0, -1.0]) @ np.array([[HALF, -HALF, 0.0], [HALF, HALF, 0.0], [0.0, 0.0, 1.0]])
"""Turned by 45 degrees: the frame around the print overlaps the image before the print does."""


def pose_at(pixel: np.ndarray, distance: float) -> Pose:
    """A target seen from straight above, its origin at a pixel."""
    k = CAMERA.intrinsics
    ray = np.array([(pixel[0] - k.cx) / k.fx, (pixel[1] - k.cy) / k.fy, 1.0])
    return Pose(DIAMOND, ray * distance, np.eye(6) * 1e-4, "edges", 40, 0.2, 1.0)


@pytest.mark.parametrize(("distance", "low", "right"), [(6.0, False, True), (9.0, True, False)])
def test_a_far_print_that_leaves_by_a_corner_gives_no_pose(
    distance: float, low: bool, right: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    pixels = np.random.default_rng(1).integers(0, 255, (480, 640), dtype=np.uint8)
    corner = np.array([639.0 if right else 0.0, 479.0 if low else 0.0])
    inwards = np.array([-1.0 if right else 1.0, -1.0 if low else 1.0])
    monkeypatch.setattr(photofit, "STEPS", 1)
    fit = PhotoFit(TARGET, Projection(CAMERA.intrinsics))
    for outside in np.linspace(-40.0, 0.0, 21):
        pose = fit.fit(pixels, pose_at(corner + inwards * outside, distance))
        assert pose is None or np.isfinite(pose.position).all()


def test_a_fit_that_has_not_arrived_says_how_far_it_would_go_on(monkeypatch: pytest.MonkeyPatch) -> None:
    view, fit = View(NESTED, place(6.5, 0.3, 0.7, 0.4), LightConditions()), PhotoFit(NESTED, PROJECTION)
    start = Pose(turn(view.rotation, np.radians([6.0, -3.0, 0.0])), view.position * 0.98, np.eye(6), "edges", 9, 0.1)
    arrived = fit.fit(view.pixels, start)
    monkeypatch.setattr(photofit, "STEPS", 1)
    broken_off = fit.fit(view.pixels, start)
    assert 6.0 * nees(broken_off, arrived) > 100.0
    assert 6.0 * nees(arrived, broken_off) < 6.0


@pytest.mark.parametrize("line_time", [0.0, 30e-6])
def test_under_a_rolling_shutter_pixels_know_a_first_pose_no_better_than_its_edges(line_time: float) -> None:
    view = View(SINGLE, place(2.8, 0.3, 0.7, 0.4), LightConditions())
    projection = Projection(VGA.model_copy(update={"line_time": line_time}))
    edges = EdgeFit(SINGLE, projection).fit(view.pixels, start_at(view, nearer=1.002))
    assert (PhotoFit(SINGLE, projection).polish(view.pixels, edges) is edges) is (line_time > 0.0)


def test_a_print_of_which_only_even_paper_is_in_view_is_no_fault() -> None:
    """No pixel then knows anything of the pose, and light and its slope are one."""
    rotation = cv2.Rodrigues(np.array([1.646, 2.02, -1.366]))[0]
    start = Pose(rotation, np.array([0.413, -0.227, 0.429]), np.eye(6), "corners", 4, 0.1)
    pixels = np.random.default_rng(3).normal(20.0, 5.0, (480, 640)).clip(0, 255).astype(np.uint8)
    found = PhotoFit(NESTED, PROJECTION).fit(pixels, start)
    assert found is None or found.covariance[0, 0] > 1.0


def test_a_halved_camera_sees_the_mean_of_four_pixels_and_rows_twice_as_long():
    whole = Projection(VGA.model_copy(update={"line_time": 30e-6, "k1": -0.1}))
    points = np.array([[0.3, -0.2, 1.5], [-0.4, 0.3, 2.0]])
    half = whole.halved()
    assert half.project(points)[0] == pytest.approx((whole.project(points)[0] - 0.5) / 2)
    assert half.line_time == pytest.approx(2 * whole.line_time)


def test_large_cells_are_fitted_in_an_image_of_half_the_size():
    view, fit = View(SINGLE, place(1.8, 0.4)), PhotoFit(SINGLE, PROJECTION)
    start = Pose(turn(view.rotation, np.full(3, 0.005)), 1.003 * view.position, np.eye(6), "corners", 4, 0.1)
    half, whole = (one(view.pixels, start) for one in (fit.fit, fit.fit_whole))
    assert_near(half, view, claims=3.0)
    assert half.points < whole.points / 3
    assert half.blur_px == pytest.approx(whole.blur_px, rel=0.3)


def test_a_print_with_hardly_any_black_counts_evenly() -> None:
    value = np.concatenate([np.zeros(5), np.ones(200)])
    assert (clarity(np.random.default_rng(5).standard_normal(205), value) == 1.0).all()


ROUGH = np.random.default_rng(5).standard_normal((61, 61))


@pytest.mark.parametrize(
    ("noise", "factor", "common"),
    [
        pytest.param(ROUGH[1:, 1:], (0.9, 1.1), (0.0, 0.05), id="independent"),
        # a correlation of one half each way
        pytest.param(
            ROUGH[1:, 1:] + ROUGH[:-1, 1:] + ROUGH[1:, :-1] + ROUGH[:-1, :-1],
            (0.85 * 1.5**2 / 0.5, 1.15 * 1.5**2 / 0.5),
            (0.9 * 0.5 / 0.7, 1.1 * 0.5 / 0.7),
            id="shared by neighbours",
        ),
    ],
)
def test_noise_that_neighbours_share_counts_more(noise, factor, common) -> None:
    found, share = shared_by(noise.ravel(), [np.ones((60, 60), bool)])
    assert factor[0] < found < factor[1]
    assert common[0] <= share < common[1]


@pytest.mark.parametrize("larger", [1.0, 3.0])
def test_what_a_model_lacks_on_slopes_is_not_lost_among_even_paper(larger: float) -> None:
    """Nine tenths of the pixels are even, and hold the noise of the sensor alone."""
    used = np.ones((100, 100), bool)
    slopes = np.random.default_rng(4).random(used.size) < 0.1
    residual = np.random.default_rng(5).standard_normal(used.size) * np.where(slopes, larger, 1.0)
    weighed, told = on_slopes(residual, slopes.astype(np.float64))
    assert not weighed[~slopes].any()
    assert told * shared_by(weighed, [used])[0] == pytest.approx(larger**2 / np.mean(residual**2), rel=0.1)


@pytest.mark.parametrize(("length", "factor"), [(0.0, 1.0), (6.0, 1.0256), (STREAK_PX, 2.0), (2 * STREAK_PX, 17.0)])
def test_a_long_streak_is_believed_less_whichever_way_it_runs(length: float, factor: float) -> None:
    along = np.array([0.6, 0.8])
    spread = 1.5 * np.eye(2) + length**2 / 12.0 * np.outer(along, along)
    assert streak_doubt(spread) == pytest.approx(factor, rel=1e-3)
