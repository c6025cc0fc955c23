"""Codes and outlines of tags in highlights and below covers."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace

import cv2
import numpy as np
import numpy.typing as npt
import pytest

from mkdaemon.vision.tags.cellread import CodeReader
from mkdaemon.vision.tags.detector import Detector
from mkdaemon.vision.tags.outline import read_outlines
from mkdaemon.vision.tags.tagfamily import cells
from mkdaemon.vision.tags.tagmap import TagMap, covered_cells
from mksim.scene.light import Cover, LightConditions
from tests.vision.views import View, place, printed, shipped

Grey = npt.NDArray[np.uint8]

TAGS = TagMap((shipped("nested"),))
NESTED = Detector(TAGS.whitelist, covered=covered_cells(TAGS))
READER = CodeReader(TAGS.whitelist, covered_cells(TAGS))


def box(first: float, last: float) -> npt.NDArray[np.float64]:
    """Corners of an upright square, clockwise."""
    return np.array([[first, first], [last, first], [last, last], [first, last]])


CODE = ("tag36h11", 48)
MIDDLE = (slice(3, 5), slice(3, 5))


def flooded(pixels_per_cell: int) -> np.ndarray:
    """The outer tag of the nested target, its four middle cells as white as the inner tag's paper."""
    drawn = cells(*CODE).copy()
    assert not drawn[MIDDLE].any()
    drawn[MIDDLE] = 255
    return printed(drawn, pixels_per_cell)


def test_covered_cells_are_not_read() -> None:
    assert read_outlines(flooded(20), CodeReader(TAGS.whitelist, {})) == []
    [found] = read_outlines(flooded(20), READER)
    assert (found.family, found.tag_id, found.hamming) == (*CODE, 0)


TARGET = shipped("single")
(TAG,) = TARGET.tags
DETECTOR = Detector({TAG.family.name: frozenset({TAG.tag_id})})
HALF = TAG.size / 2


def shoe(reaches: float, reflectance: float, quarters: int) -> Cover:
    """Something longer than a side, with a round and slanting end that reaches so far over the tag, share of it."""
    across = np.linspace(-1.0, 1.0, 15)
    toe = HALF - reaches * TAG.size + 0.2 * TAG.size * (1.0 - np.sqrt(1.0 - across**2)) + 0.03 * TAG.size * across
    outline = np.array([*np.column_stack([0.65 * TAG.size * across, toe]), *(TAG.size * np.array([[1, 2], [-1, 2]]))])
    c, s = np.cos(quarters * np.pi / 2), np.sin(quarters * np.pi / 2)
    turned = outline @ np.array([[c, s], [-s, c]])
    return Cover(tuple((float(x), float(y)) for x, y in turned), reflectance)


@pytest.mark.parametrize(
    ("distance", "reflectance", "quarters"), [(1.7, 0.06, 0), (2.8, 0.35, 1), (4.0, 0.15, 2), (2.8, 0.06, 3)]
)
def test_three_borders_in_view_are_a_start(distance: float, reflectance: float, quarters: int) -> None:
    """Nothing was decoded from 4.3 to 1.7 m: a fourth side was only looked for in highlights."""
    covered = replace(LightConditions(), covers=(shoe(0.15, reflectance, quarters),))
    view = View(TARGET, place(distance, 0.3), covered)
    (found,) = DETECTOR.search(view.pixels, "outline")
    corners = view.corners[TAG.code]
    off = np.linalg.norm(found.corners - corners, axis=1).max() / (found.side_px / TAG.family.black_cells)
    assert off < 0.6  # cells; the fit to edges begins within half of one or so


Array = npt.NDArray[np.float64]

FINE, SHEET = 24, 3
LIT_PAPER, LIT_INK = 230.0, 30.0


BESIDE = ((4.0, -1.0), (4.0, 9.0), (-1.0, 4.0), (9.0, 4.0))
"""Row and column of a mirrored sun over one side of a print each."""


def seen(
    corners: Array, *, at: tuple[float, float] = (0.0, 0.0), gain: float = 0.0, width: float = 3.0, tag_id: int = 48
) -> Grey:
    """A print on a white sheet on dark ground with its black square at four corners, and a mirrored sun at a cell."""
    bitmap = np.pad(cells("tag36h11", tag_id), SHEET, constant_values=255)
    lit = np.where(np.kron(bitmap, np.ones((FINE, FINE))) > 0, LIT_PAPER, LIT_INK)
    y, x = (np.indices(lit.shape) + 0.5) / FINE - SHEET
    lit += gain * np.exp(-((x - at[1]) ** 2 + (y - at[0]) ** 2) / (2 * width**2))
    first, last = SHEET * FINE - 0.5, (SHEET + 8) * FINE - 0.5
    upright, moved = (one.astype(np.float32) for one in (box(first, last), corners * 2 + 0.5))
    image_from_print = cv2.getPerspectiveTransform(upright, moved)
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


@pytest.mark.parametrize(("stretch", "degrees"), [(0.8, 20.0), (1.25, 45.0)])
@pytest.mark.parametrize("at", BESIDE)
def test_a_print_with_one_side_in_a_highlight_is_found(at: tuple[float, float], stretch: float, degrees: float) -> None:
    corners = square(100.0, degrees, stretch)
    [found] = NESTED.search(seen(corners, at=at, gain=450.0, width=2.0), "outline")
    assert found.tag_id == 48
    # what is blown leaves the far corners to the cells: a third of a cell
    assert np.abs(found.corners - corners).max() < 100.0 * max(stretch, 1.0) / 24


def test_another_print_with_one_side_in_a_highlight_is_none() -> None:
    for at, degrees in itertools.product(BESIDE, (0.0, 20.0, 45.0)):
        image = seen(square(100.0, degrees), at=at, gain=450.0, width=2.0, tag_id=100)
        assert NESTED.search(image, "outline") == []
