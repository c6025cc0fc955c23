"""A search for tags with things lying on them: four lines of a broken outline, and the cells that can still be read.

libapriltag wants an unbroken quad. Here a dark blob's outline is cut into straight pieces, pieces of one line are put
together, and every four lines that could bound a black square are tried; where no four are whole, three too. What can
be read of their cells has to agree with a code beyond chance (`coderead.py`).

Of three sides of a black square, whose fourth a highlight opens, or a hand, foot or shoe lies over, two whole corners
and the ways of the sides leave one unknown, how far away the fourth side is. The lines between the cells tell it,
whatever the code is: at the right distance they lie where the image has steps, and none lie amid cells.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from mkdaemon.vision.limits import LIMITS
from mkdaemon.vision.tags.cellread import carry, image_from_cells, sample
from mkdaemon.vision.tags.coderead import CodeReader, Covered
from mkdaemon.vision.tags.detection import Detection, best_of_codes

OUTLINE = LIMITS.outline
Array = npt.NDArray[np.float64]
Bools = npt.NDArray[np.bool_]
Grey = npt.NDArray[np.uint8]
Ints = npt.NDArray[np.int32]

SPECK_PX = 3
"""Side of the window whose median a pixel of dark and light is."""
MAX_BLOBS = 12
"""Blobs with the longest hulls that are tried."""
HULL_SHARE = 0.75
"""What sticks out of a quad makes its hull longer: so much of the support is asked for before quads are tried."""
MAX_QUADS = 3
"""Quads of a blob that are read, the best first."""
MAX_THREES = 2
"""Threes of lines of a blob that are tried."""
MAX_LINES = 8
"""Longest lines of a blob that are tried: what more would cost is four lines of each."""
MAX_PIECES = 32
"""Longest straight pieces of a blob that are put together."""
CORNER_POINTS = 2
"""Points at each end of a piece that do not lie on its line: corners of a blob are round."""
BIN_PX = 2.0
"""Part of a side in which a point of its outline shows it [px]: diagonal neighbours are 1.4 px apart."""
DEPTHS = np.geomspace(0.6, 1.6, 41)
"""Distances of the fourth side that are tried, over the length of the one before it: a print tilted by 50 degrees is
so much shorter or longer. Neighbours are a fifth of a cell apart at the far side."""
STEP_CELLS = 0.15
"""How far on both sides of a line its step is sampled [cells]."""
OVER = 0.05
"""How far a side may seem to end beyond its corner, or before it, share of it: corners are blurred."""


class OutlineSearch:
    """Finds tags whose outline or cells are partly covered.

    Corners are those of fitted lines, good to some tenths of a pixel: a start for the edge fit.
    """

    def __init__(self, whitelist: Mapping[str, frozenset[int]], covered: Covered) -> None:
        """Prepare the codes of a whitelist.

        Args:
            whitelist: ids by family.
            covered: cells of a code that another tag lies on, which say nothing.
        """
        self._reader = CodeReader(whitelist, covered)

    def find(self, pixels: Grey) -> list[Detection]:
        """All codes inside of dark outlines of `(h, w)` uint8 that agree beyond chance; of one code the sharpest."""
        dark = _dark(pixels)
        # Holes too: where something dark over a side joins a tag to dark ground, its sides bound the paper around it.
        outlines, _ = cv2.findContours(dark, cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)
        least = 3 * OUTLINE.min_side_px  # three sides
        # Neighbouring points are at most a diagonal apart.
        long = [np.asarray(outline, dtype=np.int32) for outline in outlines if len(outline) * math.sqrt(2) > least]
        hulls = [(around, outline) for outline in long if (around := _around(outline)) > least]
        large = sorted(hulls, key=lambda pair: -pair[0])[:MAX_BLOBS]
        read = (self._read(pixels, outline, around) for around, outline in large)
        return best_of_codes((one for one in read if one is not None), lambda one: (one.decision_margin,))

    def _read(self, pixels: Grey, outline: Ints, around: float) -> Detection | None:
        """The first code in the quads of an outline whose hull is `around` long [px]."""
        readings = (self._reader.read(pixels, quad) for quad in self._quads_of(pixels, outline, around))
        return next((one for one in readings if one is not None), None)

    def _quads_of(self, pixels: Grey, outline: Ints, around: float) -> Iterator[Array]:
        """Quads that an outline may belong to, the likeliest first."""
        lines = lines_of(outline, OUTLINE.min_support * HULL_SHARE * around)
        sides = _facing(lines)
        rated = _quads(lines, sides)
        yield from (quad for _, quad in rated)
        if not (rated and rated[0][0] >= LIMITS.agreement.whole):
            yield from _open_quads(pixels, lines, sides, self._reader.sizes)


def has_highlights(pixels: Grey) -> bool:
    """Whether enough of `(h, w)` uint8 is blown to be a print in a highlight."""
    return bool(np.count_nonzero(pixels >= LIMITS.read.saturated) >= LIMITS.search.highlight_px)


def _dark(pixels: Grey) -> Grey:
    """What is dark `(h, w)`, not 0, of an image of dark and light.

    In a highlight ink may be brighter than paper is elsewhere. There that is dark which is neither blown nor brighter
    than its surroundings: every edge has a line of light along its bright side, and what is even and noisy has no
    outlines.
    """
    if not has_highlights(pixels):
        _, dark = cv2.threshold(pixels, 0, 255, cv2.THRESH_BINARY_INV | cv2.THRESH_OTSU)
        # Specks have outlines too, thousands in noise or on a lawn.
        return np.asarray(cv2.medianBlur(dark, SPECK_PX), dtype=np.uint8)
    side, rise = OUTLINE.highlight_box_px, OUTLINE.min_contrast
    even = cv2.adaptiveThreshold(pixels, 255, cv2.ADAPTIVE_THRESH_MEAN_C, cv2.THRESH_BINARY_INV, side, -rise)
    return np.where(pixels < LIMITS.read.saturated, even, 0).astype(np.uint8)


def _around(outline: Ints) -> float:
    """Length of the hull of an outline [px]."""
    return cv2.arcLength(cv2.convexHull(outline), closed=True)


@dataclass(frozen=True, slots=True, eq=False)
class Line:
    """Straight part of an outline: `normal @ p = offset`, the outline's points on it, their mean and length [px].

    Its normal points out of what is dark.
    """

    normal: Array
    offset: float
    points: Array
    middle: Array
    length: float


def lines_of(outline: Ints, least: float) -> list[Line]:
    """The longest straight lines of an outline, pieces of one line put together.

    Args:
        outline: `(n, 1, 2)` [px].
        least: length of all lines together [px]; none where they are shorter.
    """
    ends = np.asarray(cv2.approxPolyDP(outline, OUTLINE.straight_px, closed=True), dtype=np.int32).reshape(-1, 2)
    chords = np.linalg.norm(ends - np.roll(ends, -1, axis=0), axis=1)
    # The outline of a lawn has hundreds of pieces, and all of them are short.
    if float(np.sort(chords)[-MAX_PIECES:].sum()) < least:
        return []
    pieces = _pieces(outline.reshape(-1, 2), ends)
    merged: list[Line] = []
    normals = np.empty((len(pieces), 2))
    for piece in pieces:
        # of all lines only the parallel ones are looked at
        parallel = normals[: len(merged)] @ piece.normal > OUTLINE.parallel
        for k in np.flatnonzero(parallel).tolist():
            line = merged[k]
            if float(np.abs(piece.points @ line.normal - line.offset).max()) < OUTLINE.straight_px:
                merged[k] = _line(np.concatenate([line.points, piece.points]), line.normal)
                normals[k] = merged[k].normal
                break
        else:
            normals[len(merged)] = piece.normal
            merged.append(piece)
    longest = sorted(merged, key=lambda line: -line.length)[:MAX_LINES]
    return longest if sum(line.length for line in longest) >= least else []


def _pieces(outline: Ints, ends: Ints) -> list[Line]:
    """The longest straight pieces of an outline `(n, 2)` between these `ends` `(m, 2)`, the longest first."""
    keys, wanted = (points.astype(np.int64) @ np.array([1, 1 << 20]) for points in (outline, ends))
    marks = np.flatnonzero(np.isin(keys, wanted))
    after = np.append(marks[1:], marks[0] + len(outline))
    is_long = after - marks - 2 * CORNER_POINTS + 1 >= OUTLINE.min_piece_px
    first, last = marks[is_long] + CORNER_POINTS, after[is_long] - CORNER_POINTS
    points = np.concatenate([outline, outline[: marks[0] + 1]]).astype(np.float64)
    ways = points[last] - points[first]
    longest = np.argsort(-np.linalg.norm(ways, axis=1), kind="stable")[:MAX_PIECES]
    parts = zip(first[longest].tolist(), last[longest].tolist(), ways[longest], strict=True)
    found = [_line(points[a : b + 1], np.array([-way[1], way[0]])) for a, b, way in parts]
    return sorted(found, key=lambda piece: -piece.length)


def _line(points: Array, side: Array) -> Line:
    """Fit a line whose normal points to this `side` `(2,)`, which lies right of the way along the outline."""
    middle = points.mean(axis=0)
    (xx, xy), (_, yy) = ((points - middle).T @ (points - middle)).tolist()
    turn = 0.5 * math.atan2(2.0 * xy, xx - yy)  # of the axis with the largest second moment
    along, normal = (math.cos(turn), math.sin(turn)), np.array([-math.sin(turn), math.cos(turn)])
    if float(normal @ side) < 0:
        normal = -normal
    # an outline's steps are straight or diagonal
    return Line(normal, float(normal @ middle), points, middle, len(points) / max(abs(along[0]), abs(along[1])))


def _seen_share(place: Array, length: float) -> float:
    """Share of a side that outline runs along, from the places of its points along the side [px]."""
    inside = place[(place > -1) & (place < length + 1)]
    return len(np.unique(np.floor(inside / BIN_PX))) * BIN_PX / length


def _facing(lines: Sequence[Line]) -> Bools:
    """Which lines may be sides of one dark convex shape: each lies on the dark side of the other `(n, n)`."""
    normals, middles = (np.array(of).reshape(-1, 2) for of in ([a.normal for a in lines], [a.middle for a in lines]))
    inside = normals @ middles.T < np.array([line.offset for line in lines])[:, None]
    return np.asarray(inside & inside.T)


def _crossing(first: Line, second: Line) -> Array | None:
    """Corner of a dark shape between two of its sides `(2,)` [px]; none where they are parallel."""
    (a, b), (c, d) = first.normal.tolist(), second.normal.tolist()
    sine = a * d - b * c
    if sine == 0.0:
        return None
    # The outline runs over the blob's own pixels: its edge is half a pixel farther out.
    e, f = first.offset + 0.5, second.offset + 0.5
    return np.array([(d * e - b * f) / sine, (a * f - c * e) / sine])


def _quads(lines: Sequence[Line], sides: Bools) -> list[tuple[float, Array]]:
    """Quads that the lines of a blob bound, clockwise in the image, with the share that is outline, the best first."""
    rated: list[tuple[float, Array]] = []
    for four in itertools.combinations(range(len(lines)), 4):
        if all(sides[pair] for pair in itertools.combinations(four, 2)):
            bounds = [lines[k] for k in four]
            quad = _corners(bounds)
            support = _support(quad, bounds) if quad is not None else 0.0
            if quad is not None and support >= OUTLINE.min_support:
                rated.append((support, quad))
    return sorted(rated, key=lambda pair: -pair[0])[:MAX_QUADS]


def _corners(four: Sequence[Line]) -> Array | None:
    """Corners of a convex quad between four lines, clockwise in the image; none when they bound none."""
    order = sorted(four, key=lambda line: math.atan2(line.normal[1], line.normal[0]))
    corners = [_crossing(first, second) for first, second in zip(order, [*order[1:], order[0]], strict=True)]
    if any(corner is None for corner in corners):
        return None
    quad = np.array(corners)
    sides = np.roll(quad, -1, axis=0) - quad
    after = np.roll(sides, -1, axis=0)
    turns = sides[:, 0] * after[:, 1] - sides[:, 1] * after[:, 0]
    if float(np.linalg.norm(sides, axis=1).min()) < OUTLINE.min_side_px / 2 or not (turns > 0).all():
        return None
    return quad


def _support(quad: Array, four: Sequence[Line]) -> float:
    """Share of the perimeter that is outline; 0 when a side has too little of it or the outline leaves the quad."""
    covered, perimeter = 0.0, 0.0
    for a, b in zip(quad, np.roll(quad, -1, axis=0), strict=True):
        length = float(np.linalg.norm(b - a))
        along = (b - a) / length
        normal = np.array([-along[1], along[0]])
        share = 0.0
        for line in four:
            if float(np.abs((line.points - a) @ normal).max()) < 2 * OUTLINE.straight_px:
                share += _seen_share((line.points - a) @ along, length)
        if share < OUTLINE.min_side_support:
            return 0.0
        covered += min(share, 1.0) * length
        perimeter += length
    return covered / perimeter


@dataclass(frozen=True, slots=True, eq=False)
class _Arm:
    """A side beside the middle one: which line, their corner, the way from there, and how far it is seen [px]."""

    line: int
    end: Array
    way: Array
    reach: float


def _open_quads(pixels: Grey, lines: Sequence[Line], sides: Bools, sizes: Sequence[int]) -> list[Array]:
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
        for first, second in itertools.product(*_arms(lines, k, sides)):
            if sides[first.line, second.line] and _are_ends(middle, first, second):
                length = middle.length + lines[first.line].length + lines[second.line].length
                threes.append((length, first, second))
    threes.sort(key=lambda three: -three[0])
    quads = [_closed(pixels, first, second, n) for _, first, second in threes[:MAX_THREES] for n in sizes]
    return [quad for quad in quads if quad is not None]


def _arms(lines: Sequence[Line], k: int, sides: Bools) -> tuple[list[_Arm], list[_Arm]]:
    """The sides before and after one, clockwise, as far as they begin at its corners."""
    before: list[_Arm] = []
    after: list[_Arm] = []
    for j in np.flatnonzero(sides[k]).tolist():
        line, end = lines[j], _crossing(lines[k], lines[j])
        if end is None:
            continue
        clockwise = np.array([-line.normal[1], line.normal[0]])
        is_after = float(clockwise @ lines[k].normal) < 0.0
        way = clockwise if is_after else -clockwise
        place = (line.points - end) @ way
        reach = float(place.max())
        begins = float(place.min()) > -OVER * reach - OUTLINE.straight_px
        if begins and _seen_share(place, reach) >= OUTLINE.min_support:
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
    return is_between and _seen_share(place, side) >= OUTLINE.min_support


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
