"""What real cameras do to the image: a rolling shutter, and the processing after the sensor."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lab.vision.flight import LOOKING_DOWN
from lab.vision.stills import target_named
from mkdaemon.vision.camera.calibration_file import Intrinsics
from mkdaemon.vision.tags.detector import Detector
from mkdaemon.vision.tags.tagmap import TagMap
from mksim.scene.light import CLEAN
from mksim.scene.motion import Platform
from mksim.scene.processing import NO_PROCESSING, Processing
from mksim.scene.scene import Scene, SceneTarget
from mksim.scene.view import CameraView, project

LENS = Intrinsics(width=640, height=480, fx=600.0, fy=600.0, cx=319.5, cy=239.5)
PAD = SceneTarget.of(target_named("single"), Platform())
STILL = CameraView(LENS, LOOKING_DOWN.flu_from_cam, np.array([0.05, 0.02, 1.2]), line_time=30e-3 / 480)
STEP = np.tile(np.linspace(0.0, 255.0, 40, dtype=np.float32), (20, 1))


def corners_by_row(view: CameraView) -> np.ndarray:
    """Where each corner is when its own row is exposed."""
    found = []
    for corner in PAD.motion.pose_at(0.0).points(PAD.target.tags[0].corners):
        time = 0.0
        for _ in range(8):
            pixel = project(view.moved(time).camera_points(corner[None]), LENS)[0]
            time = (pixel[1] - (LENS.height - 1) / 2) * view.line_time
        found.append(pixel)
    return np.array(found)


@pytest.mark.parametrize(
    "motion",
    [
        {"velocity_enu": np.array([0.5, 0.3, 0.0])},
        {"velocity_enu": np.array([0.0, 0.0, 2.0])},
        {"rate_cam": np.array([0.4, -0.3, 0.0])},
        {"rate_cam": np.array([0.0, 0.0, 0.4])},
    ],
    ids=["across", "up", "tilting", "turning"],
)
def test_each_row_of_a_rolling_shutter_is_exposed_at_its_own_time(motion: dict[str, np.ndarray]) -> None:
    view = replace(STILL, **motion)
    scene = Scene([PAD], ground=None, seed=3, fine=False)
    (found,) = Detector(TagMap((PAD.target,)).whitelist).search(scene.render(view, CLEAN), "grey")
    # turning bends the sides of the tag: the lines through them miss its corners by 0.1 px
    np.testing.assert_allclose(found.corners, corners_by_row(view), atol=0.16)
    at_rest = project(view.camera_points(PAD.motion.pose_at(0.0).points(PAD.target.tags[0].corners)), LENS)
    assert np.abs(corners_by_row(view) - at_rest).max() > 0.2


def test_a_fast_vibration_turns_no_row_farther_than_its_amplitude() -> None:
    view = replace(STILL, vibration_cam=np.array([0.1, 0.0, 0.0]), vibration_hz=120.0)
    turns = [view.turned(time)[0] for time in np.linspace(-0.015, 0.015, 200)]
    assert max(turns) == pytest.approx(0.1 / (2 * np.pi * 120.0), rel=1e-2)
    assert view.turned(0.0)[0] == 0.0


def test_without_processing_light_is_grey() -> None:
    np.testing.assert_array_equal(NO_PROCESSING.apply(STEP), STEP)


def test_a_tone_curve_keeps_black_and_white_and_lifts_what_is_between() -> None:
    grey = Processing(gamma=2.2).apply(STEP)
    np.testing.assert_allclose(grey[:, [0, -1]], STEP[:, [0, -1]], atol=1e-3)
    assert grey[0, 20] == pytest.approx(255.0 * (STEP[0, 20] / 255.0) ** (1 / 2.2), rel=1e-5)


def test_sharpening_overshoots_on_both_sides_of_an_edge() -> None:
    edge = np.where(np.arange(40) < 20, 50.0, 200.0).astype(np.float32) * np.ones((20, 1), np.float32)
    grey = Processing(sharpening=0.8).apply(edge)
    assert grey.min() < 45.0
    assert grey.max() > 205.0


def test_a_filled_mosaic_keeps_an_even_grey_and_spreads_a_single_pixel() -> None:
    even = np.full((20, 20), 90.0, np.float32)
    np.testing.assert_allclose(Processing(mosaic=True).apply(even), even, atol=0.02)
    even[10, 10] += 100.0
    assert (np.abs(Processing(mosaic=True).apply(even) - 90.0) > 1.0).sum() >= 4


def test_denoising_keeps_edges() -> None:
    rng = np.random.default_rng(1)
    edge = np.where(np.arange(40) < 20, 50.0, 200.0).astype(np.float32) + np.float32(3.0) * rng.standard_normal(
        (20, 40)
    ).astype(np.float32)
    smooth = Processing(denoise=15.0).apply(edge)
    assert smooth[:, 5:15].std() < 0.5 * edge[:, 5:15].std()
    assert smooth[:, 20].mean() - smooth[:, 19].mean() > 130.0
