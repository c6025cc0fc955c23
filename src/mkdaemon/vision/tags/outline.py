"""A search for tags with things lying on them: four lines of a broken outline, and the cells that can still be read.

libapriltag wants an unbroken quad. Here a dark blob's outline is cut into straight pieces, pieces of one line are put
together, and every four lines that could bound a black square are tried. What can be read of their cells has to agree
with a code beyond chance (`coderead.py`).
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from mkdaemon.vision.limits import LIMITS
from mkdaemon.vision.tags.coderead import CodeReader, Covered
from mkdaemon.vision.tags.detection import Detection, Stage

Array = npt.NDArray[np.float64]
Grey = npt.NDArray[np.uint8]

OUTLINE = LIMITS.outline
MAX_LINES, MAX_BLOBS = 8, 12
"""Longest lines of a blob and largest blobs that are tried: what more would cost is four lines of each."""
HULL_SHARE = 0.75
"""What sticks out of a quad makes its hull longer: so much of the support is asked for before quads are tried."""
CORNER_POINTS = 2
"""Points at each end of a piece that do not lie on its line: corners of a blob are round."""
LINE_REACH = 0.01
"""A line's direction is good to this angle: collinear pieces may be off by so much of their distance [rad]."""


@dataclass(frozen=True, slots=True, eq=False)
class _Line:
    """Straight part of an outline: `normal @ p = offset`, the outline's points on it, their mean and number."""

    normal: Array
    offset: float
    points: Array
    middle: Array
    length: float


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

    def find(self, pixels: Grey, stage: Stage) -> list[Detection]:
        """All codes whose readable cells agree beyond chance, in an image of dark and light."""
        _, dark = cv2.threshold(pixels, 0, 255, cv2.THRESH_BINARY_INV | cv2.THRESH_OTSU)
        return self._read(pixels, np.asarray(dark, dtype=np.uint8), stage)

    def find_in_highlight(self, pixels: Grey, stage: Stage) -> list[Detection]:
        """The same where a highlight makes ink brighter than paper is elsewhere.

        Dark is what is not blown and no brighter than its surroundings, so that every edge has a line of light along
        its bright side, and what is even and noisy has no outlines.
        """
        side, rise = OUTLINE.highlight_box_px, OUTLINE.min_contrast
        even = cv2.adaptiveThreshold(pixels, 255, cv2.ADAPTIVE_THRESH_MEAN_C, cv2.THRESH_BINARY_INV, side, -rise)
        dark = np.where(pixels < LIMITS.read.saturated, even, 0)
        return self._read(pixels, np.asarray(dark, dtype=np.uint8), stage)

    def _read(self, pixels: Grey, dark: Grey, stage: Stage) -> list[Detection]:
        """The codes inside of dark outlines; of quads around the same tag the sharpest."""
        outlines, _ = cv2.findContours(dark, cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)
        least = 3 * OUTLINE.min_side_px  # points of three sides
        large = sorted((c for c in outlines if len(c) > least), key=len, reverse=True)[:MAX_BLOBS]
        found: dict[tuple[str, int], Detection] = {}
        for outline in large:
            for quad in _quads(np.asarray(outline, dtype=np.int32)):
                read = self._reader.read(pixels, quad, stage)
                if read is None:
                    continue
                key = (read.family, read.tag_id)
                if key not in found or read.decision_margin > found[key].decision_margin:
                    found[key] = read
                break
        return list(found.values())


def _quads(outline: npt.NDArray[np.int32]) -> list[Array]:
    """Quads that a blob's outline supports, the best first, corners clockwise in the image."""
    around = cv2.arcLength(cv2.convexHull(outline), closed=True)
    lines = _lines(outline)
    if sum(line.length for line in lines) < OUTLINE.min_support * HULL_SHARE * around:
        return []
    rated: list[tuple[float, Array]] = []
    for four in itertools.combinations(lines, 4):
        quad = _corners(four)
        if quad is None:
            continue
        support = _support(quad, four)
        if support >= OUTLINE.min_support:
            rated.append((support, quad))
    rated.sort(key=lambda pair: -pair[0])
    return [quad for _, quad in rated[:3]]


def _lines(outline: npt.NDArray[np.int32]) -> list[_Line]:
    """The longest straight lines of an outline, pieces of one line put together."""
    points = outline.reshape(-1, 2).astype(np.float64)
    ends = cv2.approxPolyDP(outline, OUTLINE.straight_px, closed=True).reshape(-1, 2)
    keys = outline.reshape(-1, 2).astype(np.int64) @ np.array([1, 1 << 20])
    marks = np.flatnonzero(np.isin(keys, ends.astype(np.int64) @ np.array([1, 1 << 20]))).tolist()
    pieces: list[_Line] = []
    for a, b in itertools.pairwise([*marks, marks[0] + len(points)]):
        part = points[np.arange(a + CORNER_POINTS, b - CORNER_POINTS + 1) % len(points)]
        if len(part) >= OUTLINE.min_piece_px:
            pieces.append(_line(part))
    pieces.sort(key=lambda piece: -piece.length)
    merged: list[_Line] = []
    normals = np.empty((len(pieces), 2))
    for piece in pieces:
        # of all lines only the parallel ones are looked at: hundreds of pieces against hundreds of lines cost time
        parallel = normals[: len(merged)] @ piece.normal > OUTLINE.parallel
        for k in np.flatnonzero(parallel).tolist():
            line = merged[k]
            reach = OUTLINE.straight_px + LINE_REACH * math.dist(piece.middle, line.middle)
            if float(np.abs(piece.points @ line.normal - line.offset).max()) < reach:
                merged[k] = _line(np.concatenate([line.points, piece.points]), line)
                normals[k] = merged[k].normal
                break
        else:
            normals[len(merged)] = piece.normal
            merged.append(piece)
    merged.sort(key=lambda line: -line.length)
    return merged[:MAX_LINES]


def _line(points: Array, part: _Line | None = None) -> _Line:
    """Fit a line, or a longer one around a `part` of it; its normal lies right of the way along the outline."""
    middle = points.mean(axis=0)
    spread = points - middle
    along = np.linalg.eigh(spread.T @ spread)[1][:, 1]
    way = points[-1] - points[0] if part is None else np.array([part.normal[1], -part.normal[0]])
    if float(along @ way) < 0:
        along = -along
    normal = np.array([-along[1], along[0]])
    return _Line(normal, float(normal @ middle), points, middle, float(len(points)))


def _corners(four: tuple[_Line, ...]) -> Array | None:
    """Corners of a convex quad between four lines, clockwise in the image; none when they bound none."""
    order = sorted(four, key=lambda line: math.atan2(line.normal[1], line.normal[0]))
    middle = np.concatenate([line.points for line in order]).mean(axis=0)
    corners = []
    for first, second in zip(order, [*order[1:], order[0]], strict=True):
        matrix = np.array([first.normal, second.normal])
        if abs(float(np.linalg.det(matrix))) < OUTLINE.min_sine:
            return None
        # The outline runs over the blob's own pixels: its edge is half a pixel farther out.
        out = [0.5 * np.sign(line.offset - float(line.normal @ middle)) for line in (first, second)]
        corners.append(np.linalg.solve(matrix, np.array([first.offset + out[0], second.offset + out[1]])))
    quad = np.array(corners)
    sides = np.roll(quad, -1, axis=0) - quad
    after = np.roll(sides, -1, axis=0)
    turns = sides[:, 0] * after[:, 1] - sides[:, 1] * after[:, 0]
    if float(np.linalg.norm(sides, axis=1).min()) < OUTLINE.min_side_px / 2 or not (turns > 0).all():
        return None
    return quad


def _support(quad: Array, four: tuple[_Line, ...]) -> float:
    """Share of the perimeter that is outline; 0 when a side has too little of it or the outline leaves the quad."""
    covered, perimeter = 0.0, 0.0
    for a, b in zip(quad, np.roll(quad, -1, axis=0), strict=True):
        length = float(np.linalg.norm(b - a))
        along = (b - a) / length
        normal = np.array([-along[1], along[0]])
        share = 0.0
        for line in four:
            if float(np.abs((line.points - a) @ normal).max()) < 2 * OUTLINE.straight_px:
                place = (line.points - a) @ along
                inside = (place > -1) & (place < length + 1)
                share += len(np.unique(np.floor(place[inside]))) / length
        if share < OUTLINE.min_side_support:
            return 0.0
        covered += min(share, 1.0) * length
        perimeter += length
    return covered / perimeter
