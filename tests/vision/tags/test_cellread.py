"""Codes in a highlight are read by the steps between neighbouring cells."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest

from mkdaemon.vision.tags.cellread import CodeReader
from mkdaemon.vision.tags.detector import FIRST, Detector, looks_of
from mkdaemon.vision.tags.tagfamily import cells
from mkdaemon.vision.tags.tagmap import TagMap, covered_cells
from tests.vision.views import printed, shipped

Grey = npt.NDArray[np.uint8]

TAGS = TagMap((shipped("nested"),))
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


def corners_of(bitmap: Grey) -> npt.NDArray[np.float64]:
    """Corners of the black square in such an image, clockwise."""
    first = 40 + ROOM * CELL - 0.5
    last = first + len(bitmap) * CELL
    return np.array([[first, first], [last, first], [last, last], [first, last]])


@pytest.mark.parametrize("turns", [0, 1, 2, 3])
@pytest.mark.parametrize("place", [(4.0, 4.0), (5.0, 3.0)])
def test_a_print_with_a_highlight_over_its_middle_is_found(turns: int, place: tuple[float, float]) -> None:
    shown = np.ascontiguousarray(np.rot90(glossy(cells("tag36h11", 48), row=place[0], column=place[1]), turns))
    detector = Detector(TAGS.whitelist, covered=covered_cells(TAGS))
    whole = [look for look in (*FIRST, *looks_of(*shown.shape[::-1])) if look.view != "outline"]
    assert all(detector.search(shown, *look) == [] for look in whole)
    [found] = detector.search(shown, "outline")
    assert found.tag_id == 48
    corners = corners_of(cells("tag36h11", 48))
    size = len(shown) - 1
    for _ in range(turns):
        corners = np.column_stack([corners[:, 1], size - corners[:, 0]])
    assert np.abs(found.corners - corners).max() < 1.5


@pytest.mark.parametrize("other", [0, 47, 100, 300])
def test_another_print_in_a_highlight_is_none(other: int) -> None:
    reader = CodeReader(TAGS.whitelist, covered_cells(TAGS))
    bitmap = cells("tag36h11", other)
    for column in np.arange(0.0, 9.0, 2.0):
        for row in np.arange(0.0, 9.0, 2.0):
            assert reader.read(glossy(bitmap, row=row, column=column), [corners_of(bitmap)]) == []


def test_a_cell_says_one_bit_at_most() -> None:
    """Random cells in a black border agree with a code as seldom as chance says: here never."""
    reader = CodeReader({"tag36h11": frozenset(range(40))}, {})
    rng = np.random.default_rng(3)
    for _ in range(80):
        bitmap = np.zeros((8, 8), np.uint8)
        bitmap[1:-1, 1:-1] = 255 * rng.integers(0, 2, (6, 6))
        assert reader.read(glossy(bitmap, row=4.0, column=4.0), [corners_of(bitmap)]) == []


def test_blown_on_both_sides_of_a_line_says_nothing() -> None:
    bitmap = cells("tag36h11", 48)
    reader = CodeReader(TAGS.whitelist, {})
    assert reader.read(glossy(bitmap, row=4.0, column=4.0, gain=0.0), [corners_of(bitmap)]) != []
    assert reader.read(glossy(bitmap, row=4.0, column=4.0, width=4.0), [corners_of(bitmap)]) == []
