"""What the model of a print looks like."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest

from mkdaemon.vision.camera.calibration_file import load_camera
from mkdaemon.vision.pose.fitting import TargetFitter
from mkdaemon.vision.pose.pose import Pose, turn
from mkdaemon.vision.pose.prints import MOST_PLACES, Footprint, Prints
from mkdaemon.vision.pose.projection import Projection
from mkdaemon.vision.tags.tagmap import Target
from mkdaemon.vision.tags.targetfile import load
from tests.places import CONFIGS

CAMERA = load_camera(CONFIGS / "cameras" / "sim.toml")
ABOVE = np.diag([1.0, -1.0, -1.0])
STRAIGHT = CAMERA.intrinsics.model_copy(update={"k1": 0.0, "k2": 0.0})
BLUR_PX = 0.6
PARTS = 24
"""Sub-samples of a pixel, each way, of a drawing that is taken for exact."""
ALONG_ROWS = [(10.6, 0.0), (10.6, 0.6), (8.3, 0.3), (6.1, 0.5)]
"""Distance [m] and tilt about the rows of the image [rad]: edges lie along rows, and all of each is drawn alike."""


def white_of(target: Target, distance: float) -> float:
    """White in the image of a print, seen from above [m^2]."""
    projection = Projection(CAMERA.intrinsics)
    model = Prints(target, projection).all[0]
    pixels = np.zeros((480, 640), dtype=np.uint8)
    seen = model.samples(pixels, ABOVE, np.array([0.01, 0.02, distance]), 0.2 * np.eye(2))
    return float(seen.value.sum() * (distance / projection.focal[0]) ** 2)


@pytest.mark.parametrize("distance", [5.0, 6.0, 7.0, 8.0])
def test_an_inner_tag_has_as_much_white_from_afar_as_its_cells(distance: float) -> None:
    target = load([CONFIGS / "targets" / "nested.toml"]).targets[0]
    outer, inner = target.tags
    cells = np.pad(inner.bitmap, 1, constant_values=255) / 255
    # The inner tag lies on black cells.
    added = white_of(target, distance) - white_of(replace(target, tags=(outer,)), distance)
    assert added == pytest.approx(inner.module**2 * cells.sum(), rel=0.02)


def drawn(target: Target, rotation: np.ndarray, position: np.ndarray) -> np.ndarray:
    """White of the single tag in every pixel of the image `(480, 640)`, the lens's blur before the pixels see it."""
    tag, lens = target.tags[0], STRAIGHT
    cells = np.pad((tag.bitmap > 0).astype(np.float32), 2, constant_values=1.0)
    middle = position[:2] / position[2] * lens.fx + (lens.cx, lens.cy)
    left, top = (int(v) - 24 for v in middle)
    at = (np.arange(48 * PARTS) + 0.5) / PARTS - 0.5
    ray_x, ray_y = (at + left - lens.cx) / lens.fx, (at + top - lens.cy)[:, None] / lens.fy
    to_plane = np.linalg.inv(np.column_stack([rotation[:, 0], rotation[:, 1], position]))
    x, y, w = (row[0] * ray_x + row[1] * ray_y + row[2] for row in to_plane)
    n = len(cells)
    column = np.clip(np.floor(x / w / tag.module + n / 2).astype(int), 0, n - 1)
    row = np.clip(np.floor(n / 2 - y / w / tag.module).astype(int), 0, n - 1)
    sharp = cells[row, column]
    soft = cv2.GaussianBlur(sharp, (0, 0), BLUR_PX * PARTS)
    image = np.ones((lens.height, lens.width))
    image[top : top + 48, left : left + 48] = soft.reshape(48, PARTS, 48, PARTS).mean(axis=(1, 3))
    return image


@pytest.mark.parametrize(("distance", "tilt"), ALONG_ROWS)
def test_an_edge_along_a_row_of_pixels_is_drawn_in_its_place(distance: float, tilt: float) -> None:
    target = load([CONFIGS / "targets" / "single.toml"]).targets[0]
    rotation, position = turn(ABOVE, np.array([tilt, 0.0, 0.0])), np.array([0.013, 0.021, distance])
    model = Prints(target, Projection(STRAIGHT)).all[0]
    seen = model.samples(np.zeros((480, 640), dtype=np.uint8), rotation, position, BLUR_PX**2 * np.eye(2))
    height, width = seen.used.shape
    exact = drawn(target, rotation, position)[seen.top : seen.top + height, seen.left : seen.left + width]
    assert float(np.abs(seen.value - exact[seen.used]).max()) < 0.016


@pytest.mark.parametrize(("distance", "tilt"), ALONG_ROWS)
def test_the_range_of_such_a_tag_is_right(distance: float, tilt: float) -> None:
    target = load([CONFIGS / "targets" / "single.toml"]).targets[0]
    rotation, position = turn(ABOVE, np.array([tilt, 0.0, 0.0])), np.array([0.013, 0.021, distance])
    image = np.rint(10.0 + 160.0 * drawn(target, rotation, position)).astype(np.uint8)
    start = Pose(rotation, position, np.eye(6), "corners", 4, 0.0)
    found = TargetFitter(target, Projection(STRAIGHT)).refine(image, start)
    assert found.source == "photometric"
    assert abs(found.range_m - float(np.linalg.norm(position))) < 0.001 * distance


@pytest.mark.parametrize("slant", [1.5, 1.56, 1.5707, 1.57079])
@pytest.mark.parametrize("spread", [np.diag([0.4, 0.4]), np.diag([100.0, 0.3]), np.array([[40.0, 39.0], [39.0, 40.0]])])
def test_a_print_seen_from_its_edge_is_looked_up_at_few_places(slant: float, spread: np.ndarray) -> None:
    for distance in (0.8, 2.0, 5.0):
        rotation, position = turn(ABOVE, np.array([slant, 0.0, 0.0])), np.array([0.0, 0.3, distance])
        plane = np.array([[1.0, 0.0], [0.0, 1.0 / np.cos(slant)]]) * distance / STRAIGHT.fx
        assert Footprint.of(spread, plane).places.shape[1] <= MOST_PLACES
        model = Prints(load([CONFIGS / "targets" / "nested.toml"]).targets[0], Projection(STRAIGHT)).all[0]
        seen = model.samples(np.zeros((480, 640), dtype=np.uint8), rotation, position, spread)
        assert seen is None or np.isfinite(seen.value).all()


@pytest.mark.parametrize("streak_px", [0.0, 3.0, 10.0])
@pytest.mark.parametrize("way", [0.3, 1.2])
def test_what_a_growing_point_spread_changes(streak_px: float, way: float) -> None:
    """A streak grows by its ends: taken for a Gaussian its derivative has half the size and nothing of the form."""
    model = Prints(load([CONFIGS / "targets" / "single.toml"]).targets[0], Projection(STRAIGHT)).all[0]
    rotation, position = turn(ABOVE, np.array([0.2, 0.1, 0.0])), np.array([0.013, 0.021, 4.5])
    along = np.array([np.cos(way), np.sin(way)])
    spread = 0.36 * np.eye(2) + streak_px**2 / 12.0 * np.outer(along, along)
    black = np.zeros((480, 640), dtype=np.uint8)
    here = model.samples(black, rotation, position, spread)
    ways = np.array([[[1.0, 0.0], [0.0, 0.0]], [[0.0, 1.0], [1.0, 0.0]], [[0.0, 0.0], [0.0, 1.0]]])
    for more, slope in zip(0.1 * ways, here.by_spread, strict=True):
        wider, narrower = (model.samples(black, rotation, position, spread + sign * more) for sign in (1.0, -1.0))
        found = (wider.value - narrower.value) / 0.2
        assert np.std(found - slope) < 0.25 * np.std(found)


def test_a_print_whose_plane_goes_through_the_camera_is_not_seen() -> None:
    target = load([CONFIGS / "targets" / "single.toml"]).targets[0]
    model = Prints(target, Projection(STRAIGHT)).all[0]
    rotation = turn(np.array([[0.0, 0.0, -1.0], [1.0, 0.0, 0.0], [0.0, -1.0, 0.0]]), np.array([0.0, 0.0, 0.6]))
    for axes in (rotation, rotation @ turn(np.eye(3), np.array([0.0, 0.0, 0.4]))):
        position = 3.0 * axes[:, 0] + 3.0 * axes[:, 1]
        position *= np.sign(position[2]) or 1.0
        assert model.samples(np.zeros((480, 640), dtype=np.uint8), axes, position, 0.4 * np.eye(2)) is None
