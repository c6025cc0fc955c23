"""Quads of a black square in a highlight, whole or with one side gone."""

from __future__ import annotations

import math

import cv2
import numpy as np
import numpy.typing as npt
import pytest

from mkdaemon.vision.tags.cellread import CodeReader
from mkdaemon.vision.tags.detector import Detector
from mkdaemon.vision.tags.outline import read_outlines
from mkdaemon.vision.tags.tagfamily import cells
from mkdaemon.vision.tags.tagmap import TagMap, covered_cells
from tests.vision.views import shipped

Array = npt.NDArray[np.float64]
Grey = npt.NDArray[np.uint8]

TAGS = TagMap((shipped("nested"),))
FINE, ROOM = 24, 3
PAPER, INK = 230.0, 30.0


def seen(
    corners: Array, *, at: tuple[float, float] = (0.0, 0.0), gain: float = 0.0, width: float = 3.0, tag_id: int = 48
) -> Grey:
    """A print on a white sheet on dark ground with its black square at four corners, and a mirrored sun at a cell."""
    bitmap = np.pad(cells("tag36h11", tag_id), ROOM, constant_values=255)
    lit = np.where(np.kron(bitmap, np.ones((FINE, FINE))) > 0, PAPER, INK)
    y, x = (np.indices(lit.shape) + 0.5) / FINE - ROOM
    lit += gain * np.exp(-((x - at[1]) ** 2 + (y - at[0]) ** 2) / (2 * width**2))
    first, last = ROOM * FINE - 0.5, (ROOM + 8) * FINE - 0.5
    square = np.array([[first, first], [last, first], [last, last], [first, last]], dtype=np.float32)
    image_from_print = cv2.getPerspectiveTransform(square, (corners * 2 + 0.5).astype(np.float32))
    large = cv2.warpPerspective(lit, image_from_print, (640, 480), flags=cv2.INTER_AREA, borderValue=(70.0,))
    image = cv2.GaussianBlur(cv2.resize(large, (320, 240), interpolation=cv2.INTER_AREA), (0, 0), 0.7)
    noise = np.random.default_rng(5).normal(0.0, 1.5, image.shape)
    return np.ascontiguousarray((image + noise).clip(0, 255).round().astype(np.uint8))


def square(side: float, degrees: float, stretch: float = 1.0) -> Array:
    """Corners of a turned square around the image's middle, one way longer by `stretch`, `(4, 2)` [px]."""
    half = side / 2 * np.array([[-1.0, -stretch], [1.0, -stretch], [1.0, stretch], [-1.0, stretch]])
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    corners: Array = half @ np.array([[c, s], [-s, c]]) + np.array([160.0, 120.0])
    return corners


@pytest.mark.parametrize("degrees", [0.0, 30.0, 45.0])
def test_an_outline_is_as_long_along_diagonals_as_along_rows(degrees: float) -> None:
    """However a small square is turned: the points of a diagonal are farther apart."""
    corners = square(41.0, degrees)
    [found] = read_outlines(seen(corners), CodeReader(TAGS.whitelist, covered_cells(TAGS)))
    assert found.tag_id == 48
    assert np.abs(found.corners - corners).max() < 1.5


@pytest.mark.parametrize("degrees", [0.0, 20.0, 45.0])
@pytest.mark.parametrize("stretch", [0.8, 1.0, 1.25])
@pytest.mark.parametrize("at", [(4.0, -1.0), (4.0, 9.0), (-1.0, 4.0), (9.0, 4.0)])
def test_a_print_with_one_side_in_a_highlight_is_found(at: tuple[float, float], stretch: float, degrees: float) -> None:
    corners = square(100.0, degrees, stretch)
    image = seen(corners, at=at, gain=450.0, width=2.0)
    detector = Detector(TAGS.whitelist, covered=covered_cells(TAGS))
    [found] = detector.search(image, "outline")
    assert found.tag_id == 48
    # what is blown leaves the far corners to the cells: a third of a cell
    assert np.abs(found.corners - corners).max() < 100.0 * max(stretch, 1.0) / 24


@pytest.mark.parametrize("tag_id", [0, 100])
def test_another_print_with_one_side_in_a_highlight_is_none(tag_id: int) -> None:
    detector = Detector(TAGS.whitelist, covered=covered_cells(TAGS))
    for at in ((4.0, -1.0), (4.0, 9.0), (-1.0, 4.0), (9.0, 4.0)):
        for degrees in (0.0, 20.0, 45.0):
            image = seen(square(100.0, degrees), at=at, gain=450.0, width=2.0, tag_id=tag_id)
            assert detector.search(image, "outline") == []


def test_a_sheet_without_a_print_has_no_open_quads() -> None:
    detector = Detector(TAGS.whitelist, covered=covered_cells(TAGS))
    image = np.full((240, 320), 70, np.uint8)
    cv2.fillPoly(image, [square(120.0, 20.0).astype(np.int32)], (255,))
    assert detector.search(image, "outline") == []
