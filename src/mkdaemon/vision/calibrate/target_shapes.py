"""What is on a printed target, as outlines in millimetres: black and white areas, texts, rulers."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from mkdaemon.errors import ConfigError
from mkdaemon.vision.calibrate.board import CELLS_PER_SQUARE, CharucoBoard
from mkdaemon.vision.tags.tagfamily import size_words
from mkdaemon.vision.tags.tagmap import Tag, Target

Array = npt.NDArray[np.float64]

MARGIN_MM = 10.0
"""White around everything: printers leave a rim blank."""
CENTIMETRE, HALF_CENTIMETRE = 10, 5
"""Longer marks of the ruler [mm]."""
LISTED = 6
"""Tags that are named in the title of a page."""
RULER_MM = 100
FOOT_MM = 24.0
"""Height of the strip with ruler and text under a target."""


@dataclass(frozen=True, slots=True)
class Area:
    """A filled outline.

    Attributes:
        loops: closed polygons, each `(n, 2)` [mm; page, x right, y down]; what lies in an even number of them is not
            filled.
        white: filled with white instead of black.
    """

    loops: tuple[Array, ...]
    white: bool = False


@dataclass(frozen=True, slots=True)
class Words:
    """A line of text: left end of its baseline [mm; page], height of its capitals [mm]."""

    x: float
    y: float
    height: float
    text: str


@dataclass(frozen=True, slots=True)
class Page:
    """Everything on one sheet of `width` x `height` [mm]."""

    width: float
    height: float
    areas: tuple[Area, ...]
    words: tuple[Words, ...]
    title: str


def outlines(cells: npt.NDArray[np.bool_]) -> list[Array]:
    """Trace the edge of all set cells.

    One outline instead of many rectangles leaves no hairlines between neighbours in any viewer or printer driver.

    Args:
        cells: `(rows, columns)`.

    Returns:
        Closed loops `(n, 2)` of (column, row) corners, without points on straight lines.
    """
    padded = np.pad(cells, 1)
    steps: dict[tuple[int, int], list[tuple[int, int]]] = {}
    for row, column in np.argwhere(padded):
        left, top = int(column) - 1, int(row) - 1
        sides = (
            ((row - 1, column), (left, top), (left + 1, top)),
            ((row, column + 1), (left + 1, top), (left + 1, top + 1)),
            ((row + 1, column), (left + 1, top + 1), (left, top + 1)),
            ((row, column - 1), (left, top + 1), (left, top)),
        )
        for beyond, start, end in sides:
            if not padded[beyond]:
                steps.setdefault(start, []).append(end)
    loops = []
    while steps:
        first = next(iter(steps))
        path = [first]
        while True:
            here = path[-1]
            ends = steps[here]
            following = ends.pop()
            if not ends:
                del steps[here]
            if following == first:
                break
            path.append(following)
        loops.append(_corners_only(np.array(path, dtype=np.float64)))
    return loops


def _corners_only(path: Array) -> Array:
    before, after = np.roll(path, 1, axis=0), np.roll(path, -1, axis=0)
    bends = np.any((path - before) != (after - path), axis=1)
    return path[bends]


def target_page(target: Target, *, note: str = "") -> Page:
    """Lay out a flat target with cut marks, ruler and sizes.

    Raises:
        ConfigError: the target is not flat.
    """
    if not target.is_planar or not np.allclose(target.tags[0].rotation[:, 2], (0.0, 0.0, 1.0)):
        msg = f"target '{target.name}' is not flat: print its tags one by one with --tag ID:SIZE"
        raise ConfigError(msg)
    sheets = np.concatenate([_paper(tag) for tag in target.tags])
    (x0, y0), (x1, y1) = sheets.min(axis=0), sheets.max(axis=0)

    def on_page(points: Array) -> Array:
        return 1000.0 * np.column_stack([points[:, 0] - x0, y1 - points[:, 1]]) + MARGIN_MM

    areas = []
    for tag in target.tags:
        quiet = on_page(_paper(tag))
        areas.append(Area((quiet,), white=True))
        ink = outlines(tag.bitmap == 0)
        half = tag.bitmap.shape[0] / 2
        placed = [
            on_page(tag.place(np.column_stack([loop[:, 0] - half, half - loop[:, 1]]) * tag.module)[:, :2])
            for loop in ink
        ]
        areas.append(Area(tuple(placed)))
    sizes = ", ".join(f"{tag.family.name} {tag.tag_id} = {1000 * tag.size:g} mm" for tag in target.tags[:LISTED])
    more = f" and {len(target.tags) - LISTED} more" if len(target.tags) > LISTED else ""
    width, height = 1000.0 * (x1 - x0), 1000.0 * (y1 - y0)
    measured = " or ".join(dict.fromkeys(size_words(tag.family) for tag in target.tags))
    return _finished(areas, width, height, f"{target.name}: {sizes}{more} ({measured})", note)


def board_page(board: CharucoBoard, *, note: str = "") -> Page:
    """Lay out a ChArUco board with ruler and sizes."""
    cell = 1000.0 * board.square / CELLS_PER_SQUARE
    loops = [loop * cell + MARGIN_MM for loop in outlines(board.cells == 0)]
    width, height = 1000.0 * board.square * board.columns, 1000.0 * board.square * board.rows
    return _finished([Area(tuple(loops))], width, height, board.title, note)


def _paper(tag: Tag) -> Array:
    half = tag.paper / 2
    corners = np.array([[-half, half], [half, half], [half, -half], [-half, -half]])
    return tag.place(corners)[:, :2]


def _finished(areas: Iterable[Area], width: float, height: float, title: str, note: str) -> Page:
    """Add cut marks, both rulers and the texts."""
    page_width = max(width, float(RULER_MM)) + 2 * MARGIN_MM + 6.0
    page_height = height + 2 * MARGIN_MM + FOOT_MM
    foot = height + 2 * MARGIN_MM
    extras = [_box(x, y, dx, dy) for x, y, dx, dy in _cut_marks(width, height)]
    extras += [_box(*mark) for mark in _ruler(MARGIN_MM, foot)]
    if height >= RULER_MM:
        right = page_width - 5.0
        extras += [_box(right - (y - foot), MARGIN_MM + x - MARGIN_MM, h, w) for x, y, w, h in _ruler(MARGIN_MM, foot)]
    words = [
        Words(
            MARGIN_MM,
            foot + 11.0,
            2.5,
            f"This ruler is {RULER_MM} mm. Measure it: a print 1 % too large is a pose 1 % too far.",
        ),
        Words(MARGIN_MM, foot + 16.0, 2.5, title),
        Words(
            MARGIN_MM,
            foot + 21.0,
            2.5,
            note or "Print at 100 %, on matte paper, mounted flat. Measure, then correct the size in the file.",
        ),
    ]
    return Page(page_width, page_height, (*areas, *extras), tuple(words), title)


def _box(x: float, y: float, width: float, height: float) -> Area:
    return Area((np.array([[x, y], [x + width, y], [x + width, y + height], [x, y + height]]),))


def _cut_marks(width: float, height: float) -> list[tuple[float, float, float, float]]:
    """Short lines outside the corners."""
    marks = []
    for x, away_x in ((MARGIN_MM, -1), (MARGIN_MM + width, 1)):
        for y, away_y in ((MARGIN_MM, -1), (MARGIN_MM + height, 1)):
            marks.append((x + (2 if away_x > 0 else -6), y - 0.1, 4.0, 0.2))
            marks.append((x - 0.1, y + (2 if away_y > 0 else -6), 0.2, 4.0))
    return marks


def _ruler(x: float, y: float) -> list[tuple[float, float, float, float]]:
    """Millimetre marks and a line; the first and last mark's outer edges are exactly `RULER_MM` apart."""
    line = 0.15
    marks = [(x, y, float(RULER_MM), line)]
    for mm in range(RULER_MM + 1):
        length = 5.0 if mm % CENTIMETRE == 0 else 3.5 if mm % HALF_CENTIMETRE == 0 else 2.0
        at = x + mm - (0.0 if mm == 0 else line if mm == RULER_MM else line / 2)
        marks.append((at, y, line, length))
    return marks
