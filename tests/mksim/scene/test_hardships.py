"""What sun, leaves, gloss, grass, dirt, a bent print and a camera's own processing do to an image."""

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
from mksim.config import LightConfig
from mksim.scene.autoexposure import AutoExposure, AutoSettings
from mksim.scene.curl import Curl, bend
from mksim.scene.gloss import Gloss
from mksim.scene.hardships import blades, fair_conditions, shadow_of_vehicle
from mksim.scene.hindrances import Fog
from mksim.scene.kinds import CAMERA_KINDS
from mksim.scene.lensfaults import Dirt, add_dirt, add_fringe, grey_scale
from mksim.scene.light import CLEAN, LightConditions
from mksim.scene.motion import Platform
from mksim.scene.processing import NO_PROCESSING, Processing
from mksim.scene.scene import Scene, SceneTarget
from mksim.scene.shadows import LeafShadow, VehicleShadow, leaf_pattern
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


def test_a_bent_print_bends_in_the_image() -> None:
    changed = np.abs(picture(replace(CLEAN, curl=Curl(1.0, 0.3, 1.4 * SIDE))) - picture(CLEAN)) > 30
    assert 0.001 < changed.mean() < 0.1


def test_leaves_let_half_of_the_sun_through_and_the_sky_everywhere() -> None:
    share = picture(replace(CLEAN, leaves=LeafShadow(5, ratio=6.0))) / np.maximum(picture(CLEAN), 1.0)
    assert share.min() >= 1 / 6 - 0.1
    assert share.max() <= 1.1
    assert 0.2 < float(leaf_pattern(5, 3.0).mean()) < 0.8


def test_shadows_are_softer_from_higher_leaves() -> None:
    low, high = (np.abs(np.diff(leaf_pattern(5, height), axis=1)).max() for height in (1.0, 10.0))
    assert low > 2 * high


def test_the_shadow_of_the_vehicle_is_dark_where_it_falls() -> None:
    shaded = picture(replace(CLEAN, vehicle=VehicleShadow(0.8, (0.16, 0.16)))) / picture(CLEAN)
    u, v = np.rint(project(ABOVE.camera_points(np.array([[0.16, 0.16, 0.0]])), LENS)[0]).astype(int)
    assert shaded[v, u] == pytest.approx(1 / 6, abs=0.05)
    assert shaded[-1, 0] == pytest.approx(1.0, abs=0.05)


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


def test_grass_hides_parts_of_the_rim_and_equal_seeds_give_equal_blades() -> None:
    covers = blades(np.random.default_rng(4), SIDE, 60)
    assert covers == blades(np.random.default_rng(4), SIDE, 60)
    changed = np.abs(picture(replace(CLEAN, covers=covers)) - picture(CLEAN)) > 20
    assert 0.01 < changed.mean() < 0.2


def test_red_and_blue_part_in_the_corners_alone() -> None:
    light = np.tile((np.arange(320) // 20 % 2).astype(np.float32), (240, 1))
    fringed = add_fringe(light, 3.0)
    assert np.abs(fringed[120, 150:170] - light[120, 150:170]).max() < 0.05
    assert np.abs(fringed[5, :12] - light[5, :12]).max() < 0.05
    assert 0.2 < np.abs(fringed[5, 15:25] - light[5, 15:25]).max() < 0.5


def test_a_fringe_moves_grey_edges_as_a_longer_lens_does():
    """The middle of an upright edge 20 pixels beside the left border, by its centre of gravity."""
    column = np.arange(640.0)
    light = np.tile(1.0 / (1.0 + np.exp(-(column - 20.0))), (480, 1)).astype(np.float32)
    slope = np.diff(add_fringe(light, 4.0)[240, :60].astype(np.float64))
    found = float((slope * (column[:59] + 0.5)).sum() / slope.sum())
    scale = grey_scale(4.0, 640, 480)
    assert scale > 1.0
    assert abs(found - (319.5 + scale * (20.0 - 319.5))) < 0.02


def test_dirt_scatters_light_and_takes_none_away() -> None:
    light = np.zeros((240, 320), dtype=np.float32)
    light[60:180, 80:240] = 1.0
    dirty = add_dirt(light, Dirt(3))
    assert float(dirty.mean()) == pytest.approx(float(light.mean()), rel=0.05)
    assert float(dirty.min()) > 0.005


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


def test_an_ideal_camera_in_fair_light_has_a_good_day() -> None:
    assert fair_conditions(LightConfig(), CAMERA_KINDS["ideal"].conditions, SIDE, 1) == LightConditions()


def test_configured_light_and_print_come_on_top_of_the_camera() -> None:
    light = LightConfig(
        leaves_height=3.0,
        gloss=0.1,
        curl=0.01,
        grass=5,
        dirt=0.3,
        visibility=9.0,
        drops=5,
        propellers=True,
        flicker=200.0,
    )
    found = fair_conditions(light, CAMERA_KINDS["c270"].conditions, SIDE, 1)
    assert found.processing == CAMERA_KINDS["c270"].conditions.processing
    assert found.curl.height(np.array([0.0, 0.5 * SIDE])) @ [1, -1] == pytest.approx(0.01 * SIDE, rel=0.02)
    assert (found.leaves is not None, found.gloss is not None, found.dirt is not None) == (True, True, True)
    assert (found.fog, found.drops.count, found.flicker.rate) == (Fog(9.0), 5, 200.0)
    assert found.propellers is not None
    clear = fair_conditions(LightConfig(), LightConditions(), 0.3, 1)
    assert (clear.fog, clear.drops, clear.propellers, clear.flicker) == (None, None, None, None)
    assert len(found.covers) == 5


def test_the_vehicle_throws_its_shadow_away_from_the_sun() -> None:
    found = shadow_of_vehicle(ABOVE, PAD.motion.pose_at(0.0))
    assert found.height == pytest.approx(0.8)
    assert found.place == pytest.approx((0.03 - 0.17 * 0.8, -0.02 - 0.05 * 0.8))


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
