"""Corners in the right place and order, nothing reported that is no tag, and the whole image at a bounded cost."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest

from lab.vision.stills import search_in_turn
from mkdaemon.vision.limits import LIMITS
from mkdaemon.vision.tags.detector import FINE, FIRST, Detector, Look, looks_of, shrinking
from mkdaemon.vision.tags.tagfamily import cells, find_family
from mksim.scene.light import LightConditions
from mksim.scene.processing import Processing
from tests.vision.views import View, place, printed, shipped

PX, MARGIN = 20, 3
LOW, HIGH = PX * MARGIN - 0.5, PX * (MARGIN + 8) - 0.5
LOOKS = (*FIRST, *looks_of(640, 480))
"""All searches of a small image."""
UPRIGHT = np.array([[LOW, LOW], [HIGH, LOW], [HIGH, HIGH], [LOW, HIGH]])


ONLY_17 = Detector({"tag36h11": frozenset({17})})
PRINT_17 = printed(cells("tag36h11", 17), PX, MARGIN)


@pytest.mark.parametrize("look", LOOKS)
def test_official_print_has_its_corners_in_order_with_pixel_centres_at_integers(look):
    # The black square covers pixels 60..219, so its edges lie at 59.5 and 219.5.
    (found,) = ONLY_17.search(PRINT_17, *look)
    assert np.abs(found.corners - UPRIGHT).max() < 0.15


@pytest.mark.parametrize("shape", [(1, 640), (4, 4), (480, 1)])
@pytest.mark.parametrize("look", LOOKS)
def test_an_image_of_a_few_rows_holds_no_tag(look, shape):
    pixels = np.random.default_rng(1).integers(0, 255, shape, dtype=np.uint8)
    assert ONLY_17.search_all(pixels, *look) == ONLY_17.search(pixels, *look) == []


@pytest.mark.parametrize("family", ["tag36h11", "tag25h9", "tag16h5"])
def test_corners_are_those_of_the_black_square_of_every_classic_family(family):
    n = find_family(family).black_cells
    image = printed(cells(family, 5), PX, MARGIN)
    high = PX * (MARGIN + n) - 0.5
    expected = np.array([[LOW, LOW], [high, LOW], [high, high], [LOW, high]])
    found = search_in_turn(Detector({family: frozenset({5})}), image)
    assert np.abs(found[0].corners - expected).max() < 0.15


@pytest.mark.parametrize("distance", [0.8, 4.0, 8.0])
def test_rendered_corners_are_where_projection_puts_them(distance):
    view = View(shipped("single"), place(distance, 0.4, roll=0.7))
    found = search_in_turn(Detector({"tag36h11": frozenset({0})}), view.pixels)
    assert np.abs(found[0].corners - view.corners["tag36h11", 0]).max() < (0.1 if distance < 5 else 0.4)


def test_whitelist_and_hamming():
    assert search_in_turn(Detector({"tag36h11": frozenset({18})}), PRINT_17) == []
    wrong = cells("tag36h11", 17).copy()
    for k in range(3):
        assert bool(search_in_turn(ONLY_17, printed(wrong, PX, MARGIN))) == (k <= 2)
        if k == 1:
            # With every id allowed a corrected bit is no evidence any more.
            many = Detector({"tag36h11": frozenset(range(587))})
            assert search_in_turn(many, printed(wrong, PX, MARGIN)) == []
        wrong[2, 2 + k] ^= 255


@pytest.mark.parametrize("look", LOOKS)
@pytest.mark.parametrize("beside", [2, -4])
def test_the_edge_of_the_image_is_no_side_of_a_tag(beside, look):
    """A tag beside it is found where it is, one that it cuts is not found; white pixels between both, or cut ones."""
    found = ONLY_17.search(np.ascontiguousarray(PRINT_17[:, PX * MARGIN - beside :]), *look)
    assert found == [] or beside >= 0
    assert all(np.abs(tag.corners - UPRIGHT + [PX * MARGIN - beside, 0]).max() < 0.3 for tag in found)


def test_a_far_nested_tag_behind_a_tone_curve_is_found_in_light():
    streaked = replace(LightConditions(), psf_px=0.9, processing=Processing(gamma=2.2))
    view = View(shipped("nested"), place(6.0, 0.2), streaked)
    detector = Detector({"tag36h11": frozenset({48})})
    assert detector.search(view.pixels, "grey", decimate=2) == []
    (found,) = detector.search(view.pixels, "light", decimate=2)
    assert np.linalg.norm(found.corners - view.corners["tag36h11", 48], axis=1).max() < 1.0


def test_no_tag_in_a_tag_free_scene():
    view = View(shipped("single"), place(2.0, 0.2), LightConditions(target_in_view=False))
    detector = Detector({"tag36h11": frozenset(range(8))})
    assert [found for look in LOOKS for found in detector.search(view.pixels, *look)] == []


SIZES = [(640, 480), (1280, 720), (1920, 1080), (3840, 2160), (5000, 300), (64, 48)]


@pytest.mark.parametrize("size", SIZES)
def test_no_search_sees_more_pixels_than_allowed(size: tuple[int, int]) -> None:
    for look in looks_of(*size):
        x0, y0, x1, y1 = look.part or (0, 0, *size)
        scale = shrinking(x1 - x0, y1 - y0)
        assert (x1 - x0) * (y1 - y0) / scale**2 <= LIMITS.search.max_pixels


@pytest.mark.parametrize("size", SIZES[1:4])
@pytest.mark.parametrize("view", FINE)
def test_tiles_cover_every_pixel_unshrunk(size: tuple[int, int], view: str) -> None:
    seen = np.zeros(size[::-1], bool)
    for look in looks_of(*size):
        if look.view == view and look.part is not None:
            x0, y0, x1, y1 = look.part
            assert shrinking(x1 - x0, y1 - y0) == 1
            seen[y0:y1, x0:x1] = True
    assert seen.all()


@pytest.mark.parametrize("look", [*FIRST, Look("grey"), Look("log"), Look("outline")])
def test_corners_of_a_shrunk_search_lie_where_those_of_the_whole_one_do(look: Look) -> None:
    tag = cv2.resize(printed(cells("tag36h11", 17), 40, 3), None, fx=0.9, fy=0.9, interpolation=cv2.INTER_AREA)
    image = np.full((1081, 1923), 200, np.uint8)
    image[331 : 331 + tag.shape[0], 777 : 777 + tag.shape[1]] = tag
    detector = Detector({"tag36h11": frozenset({17})})
    (whole,) = detector.search_all(image, look.view)
    (shrunk,) = detector.search(image, *look)
    is_fine = look.view != "outline"
    assert (whole.shrunk, shrunk.shrunk) == (1, 1 if is_fine else 3)
    np.testing.assert_allclose(shrunk.corners, whole.corners, atol=0.02 if is_fine else 1.0)


def test_a_small_tag_in_a_large_image_is_found_in_its_turn() -> None:
    tag = cv2.resize(printed(cells("tag36h11", 17), 20, 2), (42, 42), interpolation=cv2.INTER_AREA)
    image = np.full((1080, 1920), 180, np.uint8)
    image[700:742, 1333:1375] = tag
    detector = Detector({"tag36h11": frozenset({17})})
    assert detector.search(image, *FIRST[0]) == []
    (found,) = search_in_turn(detector, image)
    assert np.abs(found.corners.mean(axis=0) - [1353.5, 720.5]).max() < 0.5
