"""Quads of which one side is gone: three sides of a black square that a highlight opens.

Two whole corners and the ways of three sides leave one unknown, how far away the fourth side is. The lines between the
cells tell it, whatever the code is: at the right distance they lie where the image has steps, and none lie amid cells.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from mkdaemon.vision.limits import LIMITS
from mkdaemon.vision.tags.cellread import carry, image_from_cells, sample
from mkdaemon.vision.tags.lines import Bools, Line, crossing, seen_share

Array = npt.NDArray[np.float64]
Grey = npt.NDArray[np.uint8]

OUTLINE = LIMITS.outline
MOST = 2
"""Threes of lines of a blob that are tried."""
DEPTHS = np.geomspace(0.6, 1.6, 41)
"""Distances of the fourth side that are tried, over the length of the one before it: a print tilted by 50 degrees is
so much shorter or longer. Neighbours are a fifth of a cell apart at the far side."""
STEP_CELLS = 0.15
"""How far on both sides of a line its step is sampled [cells]."""
OVER = 0.05
"""How far a side may seem to end beyond its corner, or before it, share of it: corners are blurred."""


@dataclass(frozen=True, slots=True, eq=False)
class _Arm:
    """A side beside the middle one: which line, their corner, the way from there, and how far it is seen [px]."""

    line: int
    end: Array
    way: Array
    reach: float


def open_quads(pixels: Grey, lines: Sequence[Line], sides: Bools, sizes: Sequence[int]) -> list[Array]:
    """Quads between three of a blob's lines and the fourth side that the image's cells ask for.

    Args:
        pixels: `(h, w)` uint8.
        lines: of its outline.
        sides: which of them may be sides of one shape `(n, n)`.
        sizes: cells along the black squares that may be there.

    Returns:
        Corners clockwise in the image `(4, 2)` [px], the longest three lines first.
    """
    threes: list[tuple[float, _Arm, _Arm]] = []
    for k, middle in enumerate(lines):
        before, after = _arms(lines, k, sides)
        for first, second in itertools.product(before, after):
            if sides[first.line, second.line] and _are_ends(middle, first, second):
                length = middle.length + lines[first.line].length + lines[second.line].length
                threes.append((length, first, second))
    threes.sort(key=lambda three: -three[0])
    quads = [_closed(pixels, first, second, n) for _, first, second in threes[:MOST] for n in sizes]
    return [quad for quad in quads if quad is not None]


def _arms(lines: Sequence[Line], k: int, sides: Bools) -> tuple[list[_Arm], list[_Arm]]:
    """The sides before and after one, clockwise, as far as they begin at its corners."""
    before: list[_Arm] = []
    after: list[_Arm] = []
    for j in np.flatnonzero(sides[k]).tolist():
        line, end = lines[j], crossing(lines[k], lines[j])
        if end is None:
            continue
        clockwise = np.array([-line.normal[1], line.normal[0]])
        is_after = float(clockwise @ lines[k].normal) < 0.0
        way = clockwise if is_after else -clockwise
        place = (line.points - end) @ way
        reach = float(place.max())
        begins = float(place.min()) > -OVER * reach - OUTLINE.straight_px
        if begins and seen_share(place, reach) >= OUTLINE.min_open_support:
            (after if is_after else before).append(_Arm(j, end, way, reach))
    return before, after


def _are_ends(middle: Line, first: _Arm, second: _Arm) -> bool:
    """Whether the middle side is whole between its neighbours, and enough of these is seen."""
    side = float(np.linalg.norm(second.end - first.end))
    if side < OUTLINE.min_side_px / 2 or min(first.reach, second.reach) < OUTLINE.min_open * side:
        return False
    place = (middle.points - first.end) @ (second.end - first.end) / side
    room = OVER * side + 2 * OUTLINE.straight_px
    is_between = float(place.min()) > -room and float(place.max()) < side + room
    return is_between and seen_share(place, side) >= OUTLINE.min_open_support


def _closed(pixels: Grey, first: _Arm, second: _Arm, n: int) -> Array | None:
    """The quad of `n` cells a side whose lines between cells lie on the steps of the image."""
    middle = second.end - first.end
    side = float(np.linalg.norm(middle))
    into = np.array([-middle[1], middle[0]]) / side
    # The fourth side is taken to be parallel to the middle one.
    ways = [arm.way / float(arm.way @ into) for arm in (first, second)]
    seen = max(arm.reach * float(arm.way @ into) for arm in (first, second))
    depths = side * DEPTHS[side * DEPTHS > (1 - OVER) * seen]
    if not len(depths):
        return None
    quads = [np.array([first.end, second.end, second.end + d * ways[1], first.end + d * ways[0]]) for d in depths]
    return quads[int(np.argmax(_combs(pixels, quads, n)))]


def _combs(pixels: Grey, quads: Sequence[Array], n: int) -> Array:
    """Mean step over the lines between cells that run along the first side, less that amid cells, of each [grey]."""
    along, line = np.meshgrid((np.arange(2 * n) + 0.5) / 2, np.arange(1, 2 * n) / 2)
    away = [np.column_stack([along.ravel(), line.ravel() + depth]) for depth in (STEP_CELLS, -STEP_CELLS)]
    points = np.concatenate([carry(image_from_cells(quad, n), np.concatenate(away)) for quad in quads])
    values = sample(pixels, points).reshape(len(quads), 2, 2 * n - 1, -1)
    steps = np.minimum(np.abs(values[:, 0] - values[:, 1]), OUTLINE.min_contrast).mean(axis=2)
    return np.asarray(steps[:, 1::2].sum(axis=1) - steps[:, ::2].sum(axis=1))
