"""The renderer against the exact projection, against brute force, and against detectors it does not know."""

from __future__ import annotations

import math
from dataclasses import replace

import cv2
import numpy as np
import pyapriltags
import pytest

from mkdaemon.config.vision import TagPlacement, TargetSection
from mkdaemon.vision.camera.calibration_file import Intrinsics
from mkdaemon.vision.tags.tagmap import build, single
from mksim.scene.layers import INK, PAPER
from mksim.scene.light import CLEAN, FULL_LIGHT, Cover, Glare, LightConditions, Shadow
from mksim.scene.motion import Platform
from mksim.scene.scene import Scene, SceneTarget, true_corners
from mksim.scene.view import CameraView, project, view_towards

from .edges import corner_errors

PINHOLE = Intrinsics(width=640, height=480, fx=600, fy=600, cx=319.5, cy=239.5)
LENS = Intrinsics(
    width=640, height=480, fx=598, fy=603, cx=327, cy=233, k1=-0.25, k2=0.08, p1=0.001, p2=-0.002, k3=0.01
)
NESTED = build(
    [TargetSection(name="pad", tags=(TagPlacement(id=48, size=0.3048), TagPlacement(id=1, size=0.055)))], origin="test"
).targets[0]
SINGLE = SceneTarget.of(single(0.3048, 7), Platform(heading=0.3))
FAR_INNER = SceneTarget.of(NESTED, Platform())


def detect(image: np.ndarray, decimate: float = 1.0) -> dict[int, np.ndarray]:
    """Corners by id, TL, TR, BR, BL of official prints, pixel centres at integers."""
    detector = pyapriltags.Detector(families="tag36h11", quad_decimate=decimate)
    return {tag.tag_id: tag.corners[[3, 2, 1, 0]] - 0.5 for tag in detector.detect(image)}


def oblique(distance: float, tilt_deg: float, azimuth: float, intrinsics: Intrinsics, turn: float = 0.0) -> CameraView:
    tilt = math.radians(tilt_deg)
    direction = np.array([math.sin(tilt) * math.cos(azimuth), math.sin(tilt) * math.sin(azimuth), math.cos(tilt)])
    return view_towards(intrinsics, distance * direction, np.array([0.01, -0.02, 0.0]), turn=turn)


@pytest.mark.parametrize("fine", [True, False])
@pytest.mark.parametrize("intrinsics", [PINHOLE, LENS], ids=["pinhole", "distorted"])
def test_rendered_corners_agree_with_the_exact_projection(intrinsics: Intrinsics, fine: bool) -> None:
    scene = Scene([SINGLE], seed=3, fine=fine)
    for distance, tilt, azimuth, turn in (
        (0.6, 10, 1.0, 0.2),
        (0.8, 35, 4.0, 1.1),
        (2.0, 50, 2.0, -2.0),
        (4.0, 20, 5.5, 3.0),
    ):
        view = oblique(distance, tilt, azimuth, intrinsics, turn)
        errors = corner_errors(scene.render(view, CLEAN), SINGLE.target.tags[0], SINGLE.motion.pose_at(0.0), view)
        assert errors.max() < 0.05, (distance, tilt, errors)


def test_a_detector_sees_the_official_print_where_it_should_be() -> None:
    target = SceneTarget.of(NESTED, Platform(heading=-1.2))
    view = oblique(1.0, 30, 0.7, PINHOLE, 0.5)
    found = detect(Scene([target], seed=3).render(view, CLEAN))
    expected = true_corners(target, view)
    assert found.keys() == {48, 1}
    for (_, tag_id), corners in expected.items():
        assert np.abs(found[tag_id] - corners).max() < 0.1


@pytest.mark.parametrize(
    ("target", "distance", "tilt", "most"),
    [
        (SINGLE, 7.6, 0.0, 12.0),
        (SINGLE, 2.0, 76.0, 12.0),
        (FAR_INNER, 9.0, 0.0, 16.0),
    ],
)
def test_small_and_grazing_tags_equal_brute_force(
    target: SceneTarget, distance: float, tilt: float, most: float
) -> None:
    """3 px a module, a view of 76 deg, half a pixel a module of an inner tag: each pixel against 24 x 24 rays."""
    view = oblique(distance, tilt, 0.9, PINHOLE, 0.4)
    unlit = replace(CLEAN, psf_px=0.0)
    image = Scene([target], ground=None, seed=1).render(view, unlit).astype(float)
    corners = np.concatenate(list(true_corners(target, view).values()))
    left, top = np.floor(corners.min(axis=0)).astype(int) + 1
    right, bottom = np.ceil(corners.max(axis=0)).astype(int) - 1
    reference = FULL_LIGHT * _traced(target, view, slice(top, bottom), slice(left, right), 24)
    difference = image[top:bottom, left:right] - reference
    soft = np.abs(cv2.GaussianBlur(difference, (0, 0), 0.6))  # what a lens of 0.6 px leaves of it
    assert np.abs(difference.mean()) < 0.4
    assert soft.mean() < 2.0
    assert soft.max() < most  # of a step of 188: less than a tenth of a pixel of one edge


def _traced(target: SceneTarget, view: CameraView, rows: slice, columns: slice, fine: int) -> np.ndarray:
    """Mean reflectance of sheet, tags and grey ground over each pixel."""
    step = (np.arange(fine) + 0.5) / fine - 0.5
    v = (np.arange(rows.start, rows.stop)[:, None] + step).ravel()
    u = (np.arange(columns.start, columns.stop)[:, None] + step).ravel()
    k = view.intrinsics
    looks = np.stack(np.broadcast_arrays((u[None] - k.cx) / k.fx, (v[:, None] - k.cy) / k.fy, 1.0), axis=-1)
    world = looks @ view.enu_from_cam.T
    pose = target.motion.pose_at(0.0)
    reach = -(view.position_enu[2] - pose.position_enu[2]) / world[..., 2]
    local = (view.position_enu + reach[..., None] * world - pose.position_enu) @ pose.enu_from_body
    outer = target.target.tags[0]
    sheet = np.abs(local[..., :2]).max(axis=-1) < outer.size / 2 + 2 * outer.module
    seen = np.where(sheet, PAPER, 0.45)
    for tag in target.target.tags:
        bitmap = np.pad(tag.bitmap, 1, constant_values=255)
        column = np.floor((local[..., 0] + tag.size / 2) / tag.module).astype(int) + 1
        row = np.floor((tag.size / 2 - local[..., 1]) / tag.module).astype(int) + 1
        inside = (row >= 0) & (row < len(bitmap)) & (column >= 0) & (column < len(bitmap))
        seen[inside] = np.where(bitmap[row[inside], column[inside]] > 0, PAPER, INK)
    return np.asarray(seen.reshape(rows.stop - rows.start, fine, columns.stop - columns.start, fine).mean(axis=(1, 3)))


def test_equal_seeds_give_equal_bytes() -> None:
    view = oblique(2.0, 30, 1.0, PINHOLE)
    conditions = LightConditions(jpeg_quality=60, glare=(Glare((0.1, 0.0), 0.03),), shadow=Shadow(4.0))
    first, again, other = (Scene([SINGLE], seed=seed).render(view, conditions) for seed in (3, 3, 4))
    np.testing.assert_array_equal(first, again)
    assert np.abs(first.astype(int) - other).mean() > 5


def test_motion_during_the_exposure_blurs_evenly_about_its_middle() -> None:
    still = oblique(1.5, 0, 0.0, PINHOLE)
    moving = replace(still, rate_cam=np.array([0.0, 0.9, 0.0]), exposure_time=0.01)  # 5.4 px
    sharp, blurred = (Scene([SINGLE], seed=3).render(view, CLEAN).astype(float) for view in (still, moving))
    edges = [float(np.abs(np.diff(image, axis=1)).max()) for image in (sharp, blurred)]
    assert edges[1] < 0.5 * edges[0]
    errors = corner_errors(blurred.astype(np.uint8), SINGLE.target.tags[0], SINGLE.motion.pose_at(0.0), still)
    assert errors.max() < 0.15


@pytest.mark.parametrize(
    ("blurred", "rate"), [({"psf_px": 1.0}, 0.0), ({"defocus_px": 5.0}, 0.0), ({"psf_px": 0.0}, 2.0)]
)
def test_light_from_outside_is_smeared_into_the_image(blurred: dict[str, float], rate: float) -> None:
    view = replace(oblique(0.5, 30, 1.0, PINHOLE), rate_cam=np.array([0.0, rate, 0.0]), exposure_time=0.008)
    conditions, scene = replace(CLEAN, **blurred), Scene([SINGLE], seed=3)
    more = scene.render(view.wider(40), conditions)[40:-40, 40:-40]
    assert np.ptp(more[:, 0]) > 100, "edges of the print are at the border"
    assert np.abs(scene.render(view, conditions).astype(int) - more).max() <= 2


def test_conditions_do_what_they_say() -> None:
    view = oblique(1.0, 0, 0.0, PINHOLE)
    scene = Scene([SINGLE], ground=None, seed=1)

    def white(conditions: LightConditions, place: tuple[float, float] = (-0.175, 0.0)) -> float:
        """Mean grey of the white margin around a place on the target."""
        pose = SINGLE.motion.pose_at(0.0)
        seen = project(view.camera_points(pose.points(np.array([[*place, 0.0]]))), PINHOLE)[0].round().astype(int)
        return float(scene.render(view, conditions)[seen[1] - 3 : seen[1] + 4, seen[0] - 3 : seen[0] + 4].mean())

    full = white(CLEAN)
    assert full == pytest.approx(FULL_LIGHT * PAPER, abs=1)
    assert white(replace(CLEAN, exposure=0.06)) == pytest.approx(0.06 * full, abs=1)
    assert white(replace(CLEAN, exposure=2.0)) == 255
    dark_left = replace(CLEAN, shadow=Shadow(4.0, direction=math.pi / 2))
    assert white(dark_left) == pytest.approx(full / 4, abs=1)
    assert white(dark_left, (0.175, 0.0)) == pytest.approx(full, abs=1)
    covered = replace(CLEAN, covers=(Cover(((-0.2, -0.1), (-0.15, -0.1), (-0.15, 0.1), (-0.2, 0.1)), 0.3),))
    assert white(covered) == pytest.approx(FULL_LIGHT * 0.3, abs=1)
    assert white(replace(CLEAN, glare=(Glare((-0.175, 0.0), 0.03, 1.0),))) == 255
    slanted = scene.render(view, replace(CLEAN, gradient=32.0, exposure=0.3, target_in_view=False)).astype(float)
    assert slanted[:, -1].mean() / slanted[:, 0].mean() == pytest.approx(32, rel=0.15)
    noisy = scene.render(view, replace(CLEAN, noise_sd=10.0, target_in_view=False)).astype(float)
    assert noisy.std() == pytest.approx(10.0, rel=0.03)
    assert white(replace(CLEAN, target_in_view=False)) == pytest.approx(FULL_LIGHT * 0.45, abs=1)
    sharp = np.abs(np.diff(scene.render(view, CLEAN).astype(float))).max()
    assert np.abs(np.diff(scene.render(view, replace(CLEAN, defocus_px=8.0)).astype(float))).max() < 0.35 * sharp


def test_a_print_seen_from_behind_is_not_there() -> None:
    wall = SceneTarget.of(single(0.3, 7), Platform(start_enu=(0.0, 0.0, 1.0), pitch=math.pi / 2))  # faces east
    for side, seen in ((1.0, True), (-1.0, False)):
        view = view_towards(PINHOLE, np.array([1.5 * side, 0.0, 1.0]), np.array([0.0, 0.0, 1.0]))
        assert (7 in detect(Scene([wall], seed=3).render(view, CLEAN))) is seen
        assert bool(true_corners(wall, view)) is seen
