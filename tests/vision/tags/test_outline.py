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
from mkdaemon.vision.tags.detector import FIRST, Detector, looks_of
from mkdaemon.vision.tags.outline import read_outlines
from mkdaemon.vision.tags.tagfamily import cells
from mkdaemon.vision.tags.tagmap import TagMap, covered_cells
from mksim.scene.light import Cover, LightConditions
from tests.vision.views import View, place, printed, shipped

Grey = npt.NDArray[np.uint8]

TAGS = TagMap((shipped("nested"),))
NESTED = Detector(TAGS.whitelist, covered=covered_cells(TAGS))
READER = CodeReader(TAGS.whitelist, covered_cells(TAGS))
CELL = 16
PAPER, INK = 200.0, 30.0
ROOM = 3
"""White cells around the drawn ones."""


def glossy(bitmap: Grey, *, row: float, column: float, gain: float = 300.0, width: float = 2.0) -> Grey:
    """A print on dark ground whose coat mirrors a round sun, brightest at a cell: blown there, with soft sides."""
    lit = np.where(printed(bitmap, CELL, ROOM) > 0, PAPER, INK)
    y, x = (np.indices(lit.shape) + 0.5) / CELL - ROOM
    lit += gain * np.exp(-((x - column) ** 2 + (y - row) ** 2) / (2 * width**2))
    noise = np.random.default_rng(7).normal(0.0, 1.5, lit.shape)
    shown = np.pad((lit + noise).clip(0, 255).round().astype(np.uint8), 40, constant_values=60)
    return np.ascontiguousarray(shown)


def box(first: float, last: float) -> npt.NDArray[np.float64]:
    """Corners of an upright square, clockwise."""
    return np.array([[first, first], [last, first], [last, last], [first, last]])


BLACK = box(40 + ROOM * CELL - 0.5, 40 + (ROOM + 8) * CELL - 0.5)
"""Corners of the black square in such an image."""


@pytest.mark.parametrize("turns", [0, 1, 2, 3])
@pytest.mark.parametrize("place", [(4.0, 4.0), (5.0, 3.0)])
def test_a_print_with_a_highlight_over_its_middle_is_found(turns: int, place: tuple[float, float]) -> None:
    shown = np.ascontiguousarray(np.rot90(glossy(cells("tag36h11", 48), row=place[0], column=place[1]), turns))
    whole = [look for look in (*FIRST, *looks_of(*shown.shape[::-1])) if look.view != "outline"]
    assert all(NESTED.search(shown, *look) == [] for look in whole)
    [found] = NESTED.search(shown, "outline")
    assert found.tag_id == 48
    corners = BLACK
    for _ in range(turns):
        corners = np.column_stack([corners[:, 1], len(shown) - 1 - corners[:, 0]])
    assert np.abs(found.corners - corners).max() < 1.5


def test_a_cell_says_one_bit_at_most() -> None:
    """Random cells in a black border agree with a code as seldom as chance says: here never."""
    reader, rng = CodeReader({"tag36h11": frozenset(range(40))}, {}), np.random.default_rng(3)
    for _ in range(80):
        bitmap = np.pad(255 * rng.integers(0, 2, (6, 6)).astype(np.uint8), 1)
        assert reader.read(glossy(bitmap, row=4.0, column=4.0), [BLACK]) == []


@pytest.mark.parametrize(("sun", "is_read"), [({"gain": 0.0}, True), ({"width": 4.0}, False)])
def test_blown_on_both_sides_of_a_line_says_nothing(sun: dict[str, float], is_read: bool) -> None:
    shown = glossy(cells("tag36h11", 48), row=4.0, column=4.0, **sun)
    assert bool(CodeReader(TAGS.whitelist, {}).read(shown, [BLACK])) is is_read


CODE = ("tag36h11", 48)
MIDDLE = (slice(3, 5), slice(3, 5))


def flooded(pixels_per_cell: int) -> np.ndarray:
    """The outer tag of the nested target, its four middle cells as white as the inner tag's paper."""
    drawn = cells(*CODE).copy()
    assert not drawn[MIDDLE].any()
    drawn[MIDDLE] = 255
    return printed(drawn, pixels_per_cell)


@pytest.mark.parametrize("name", ["nested", "nested-36"])
def test_the_inner_tag_covers_the_middle_of_the_outer_one(name: str) -> None:
    outer, inner = shipped(name).tags
    covered = covered_cells(TagMap((shipped(name),)))
    assert not covered[inner.code].any()
    under = covered[outer.code]
    assert under[MIDDLE].all()
    assert under.sum() == 4


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


@pytest.mark.parametrize("quarters", range(4))
@pytest.mark.parametrize(("distance", "reflectance"), [(1.7, 0.06), (2.8, 0.35), (4.0, 0.15)])
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


@pytest.mark.parametrize("degrees", [0.0, 20.0, 45.0])
@pytest.mark.parametrize("stretch", [0.8, 1.0, 1.25])
@pytest.mark.parametrize("at", BESIDE)
def test_a_print_with_one_side_in_a_highlight_is_found(at: tuple[float, float], stretch: float, degrees: float) -> None:
    corners = square(100.0, degrees, stretch)
    [found] = NESTED.search(seen(corners, at=at, gain=450.0, width=2.0), "outline")
    assert found.tag_id == 48
    # what is blown leaves the far corners to the cells: a third of a cell
    assert np.abs(found.corners - corners).max() < 100.0 * max(stretch, 1.0) / 24


@pytest.mark.parametrize("tag_id", [0, 100])
def test_another_print_with_one_side_in_a_highlight_is_none(tag_id: int) -> None:
    for at, degrees in itertools.product(BESIDE, (0.0, 20.0, 45.0)):
        image = seen(square(100.0, degrees), at=at, gain=450.0, width=2.0, tag_id=tag_id)
        assert NESTED.search(image, "outline") == []


def test_a_sheet_without_a_print_has_no_open_quads() -> None:
    image = np.full((240, 320), 70, np.uint8)
    cv2.fillPoly(image, [square(120.0, 20.0).astype(np.int32)], (255,))
    assert NESTED.search(image, "outline") == []
