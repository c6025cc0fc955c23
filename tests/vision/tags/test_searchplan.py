"""The whole image is searched at a bounded cost, and nothing is left out."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from lab.vision.stills import search_in_turn
from mkdaemon.vision.limits import LIMITS
from mkdaemon.vision.tags.detector import FINE, FIRST, Detector, Look, looks_of, shrinking
from mkdaemon.vision.tags.outline import has_highlights
from mkdaemon.vision.tags.tagfamily import cells
from tests.vision.tags.test_detector import printed

SIZES = [(640, 480), (1280, 720), (1920, 1080), (3840, 2160), (5000, 300), (64, 48)]


def test_a_small_image_is_searched_as_it_is_in_every_way_but_the_first_ones() -> None:
    assert shrinking(640, 480) == 1
    assert looks_of(640, 480) == (Look("log"), Look("grey"), Look("outline"))


def test_blown_pixels_bring_the_search_for_outlines_first() -> None:
    ground = np.full((480, 640), 100, np.uint8)
    blown = ground.copy()
    blown[:40, :40] = 255
    assert [has_highlights(image) for image in (ground, blown)] == [False, True]
    assert looks_of(640, 480, outline_first=True) == (Look("outline"), Look("log"), Look("grey"))


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
