"""What sun, gloss, a bent print, a lens and a rolling shutter do to an image."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest

from lab.vision.flight import LOOKING_DOWN
from lab.vision.stills import target_named
from mkdaemon.vision.camera.calibration_file import Intrinsics
from mkdaemon.vision.tags.detector import Detector
from mkdaemon.vision.tags.tagmap import TagMap
from mksim.scene.autoexposure import AutoExposure, AutoSettings
from mksim.scene.curl import Curl, bend
from mksim.scene.gloss import Gloss
from mksim.scene.lensfaults import add_fringe, grey_scale
from mksim.scene.light import CLEAN, LightConditions
from mksim.scene.motion import Platform
from mksim.scene.scene import Scene, SceneTarget
from mksim.scene.view import CameraView, RayGrid, project, rotation_from_vector

LENS = Intrinsics(width=320, height=240, fx=300.0, fy=300.0, cx=159.5, cy=119.5)
PAD = SceneTarget.of(target_named("single"), Platform())
SIDE = PAD.target.tags[0].size
ABOVE = CameraView(LENS, LOOKING_DOWN.flu_from_cam, np.array([0.03, -0.02, 0.8]))


def picture(conditions: LightConditions, view: CameraView = ABOVE) -> np.ndarray:
    return Scene([PAD], ground=None, seed=3, fine=False).render(view, conditions).astype(float)


@pytest.mark.parametrize("radius", [2.0, -2.0])
@pytest.mark.parametrize("axis", [0.0, 1.1])
def test_a_bent_print_is_seen_where_a_cylinder_has_it(radius: float, axis: float) -> None:
    view = replace(ABOVE, enu_from_cam=rotation_from_vector(np.array([0.3, 0.2, 0.0])) @ ABOVE.enu_from_cam)
    view = replace(view, position_enu=np.array([0.15, -0.25, 0.8]))
    flat = PAD.target.tags[0].corners
    along = np.array([np.cos(axis), np.sin(axis), 0.0])
    across = np.array([-np.sin(axis), np.cos(axis), 0.0])
    # the way of a corner along the paper is an angle of the cylinder; the mean height over the sheet is zero
    angle = flat @ across / radius
    bent = np.outer(flat @ along, along) + np.outer(radius * np.sin(angle), across)
    bent[:, 2] = radius * (np.cos(angle) - 1.0) + (1.4 * SIDE) ** 2 / 24 / radius
    pixels = project(view.camera_points(bent), LENS).astype(np.float32)
    rays = bend(RayGrid(LENS), view, PAD.motion.pose_at(0.0), Curl(radius, axis, 1.4 * SIDE))
    x, y = (cv2.remap(part, pixels[:, :1], pixels[:, 1:], cv2.INTER_LINEAR).ravel() for part in (rays.x, rays.y))
    looks = np.column_stack([x, y, np.ones(4)]) @ view.enu_from_cam.T
    seen = view.position_enu - looks * (view.position_enu[2] / looks[:, 2])[:, None]
    np.testing.assert_allclose(seen, flat, atol=3e-4)
    assert np.abs(pixels - project(view.camera_points(flat), LENS)).max() > 0.2


def test_a_glossy_print_shows_the_sun_where_a_mirror_would() -> None:
    to_sun = np.array([0.12, -0.05, 1.0])
    dim = replace(CLEAN, exposure=0.03)
    added = picture(replace(dim, gloss=Gloss(0.03, (0.12, -0.05, 1.0)))) - picture(dim)
    mirror = np.zeros(3)
    mirror[:2] = ABOVE.position_enu[:2] + to_sun[:2] * ABOVE.position_enu[2]
    u, v = project(ABOVE.camera_points(np.array([[mirror[0], mirror[1], 0.0]])), LENS)[0]
    bright = np.argwhere(added > 0.8 * added.max()).mean(axis=0)
    assert np.hypot(bright[1] - u, bright[0] - v) < 4.0
    matte = picture(replace(CLEAN, gloss=Gloss(0.5, (0.12, -0.05, 1.0)))) - picture(CLEAN)
    assert 0.0 < matte.max() < 15.0


def test_a_fringe_moves_grey_edges_as_a_longer_lens_does():
    """The middle of an upright edge 20 pixels beside the left border, by its centre of gravity."""
    column = np.arange(640.0)
    light = np.tile(1.0 / (1.0 + np.exp(-(column - 20.0))), (480, 1)).astype(np.float32)
    slope = np.diff(add_fringe(light, 4.0)[240, :60].astype(np.float64))
    found = float((slope * (column[:59] + 0.5)).sum() / slope.sum())
    scale = grey_scale(4.0, 640, 480)
    assert scale > 1.0
    assert abs(found - (319.5 + scale * (20.0 - 319.5))) < 0.02


def test_automatic_exposure_reaches_its_grey_value_after_its_delay() -> None:
    auto = AutoExposure(AutoSettings(wanted=100.0))
    seen = []
    for _ in range(40):
        grey = min(20.0 * auto.brightness, 255.0)
        seen.append(grey)
        auto.image_seen(np.full((64, 64), round(grey), np.uint8))
    assert seen[0] == seen[1] == seen[2]
    assert seen[3] > seen[0]
    assert seen[-1] == pytest.approx(100.0, rel=0.05)
    assert max(seen) < 125.0


VGA_LENS = Intrinsics(width=640, height=480, fx=600.0, fy=600.0, cx=319.5, cy=239.5)
STILL = CameraView(VGA_LENS, LOOKING_DOWN.flu_from_cam, np.array([0.05, 0.02, 1.2]), line_time=30e-3 / 480)
STEP = np.tile(np.linspace(0.0, 255.0, 40, dtype=np.float32), (20, 1))


def corners_by_row(view: CameraView) -> np.ndarray:
    """Where each corner is when its own row is exposed."""
    found = []
    for corner in PAD.motion.pose_at(0.0).points(PAD.target.tags[0].corners):
        time = 0.0
        for _ in range(8):
            pixel = project(view.moved(time).camera_points(corner[None]), VGA_LENS)[0]
            time = (pixel[1] - (VGA_LENS.height - 1) / 2) * view.line_time
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
    at_rest = project(view.camera_points(PAD.motion.pose_at(0.0).points(PAD.target.tags[0].corners)), VGA_LENS)
    assert np.abs(corners_by_row(view) - at_rest).max() > 0.2
