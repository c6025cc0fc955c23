"""Straight lines along the outline of a blob: pieces of one line put together."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from mkdaemon.vision.limits import LIMITS

Array = npt.NDArray[np.float64]
Bools = npt.NDArray[np.bool_]

OUTLINE = LIMITS.outline
MAX_LINES = 8
"""Longest lines of a blob that are tried: what more would cost is four lines of each."""
CORNER_POINTS = 2
"""Points at each end of a piece that do not lie on its line: corners of a blob are round."""
BIN_PX = 2.0
"""Part of a side in which a point of its outline shows it [px]: diagonal neighbours are 1.4 px apart."""
LINE_REACH = 0.01
"""A line's direction is good to this angle: collinear pieces may be off by so much of their distance [rad]."""


@dataclass(frozen=True, slots=True, eq=False)
class Line:
    """Straight part of an outline: `normal @ p = offset`, the outline's points on it, their mean and length [px]."""

    normal: Array
    offset: float
    points: Array
    middle: Array
    length: float


def lines_of(outline: npt.NDArray[np.int32]) -> list[Line]:
    """The longest straight lines of an outline, pieces of one line put together."""
    points = outline.reshape(-1, 2).astype(np.float64)
    ends = cv2.approxPolyDP(outline, OUTLINE.straight_px, closed=True).reshape(-1, 2)
    keys = outline.reshape(-1, 2).astype(np.int64) @ np.array([1, 1 << 20])
    marks = np.flatnonzero(np.isin(keys, ends.astype(np.int64) @ np.array([1, 1 << 20]))).tolist()
    pieces: list[Line] = []
    for a, b in itertools.pairwise([*marks, marks[0] + len(points)]):
        part = points[np.arange(a + CORNER_POINTS, b - CORNER_POINTS + 1) % len(points)]
        if len(part) >= OUTLINE.min_piece_px:
            pieces.append(_line(part))
    pieces.sort(key=lambda piece: -piece.length)
    merged: list[Line] = []
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


def _line(points: Array, part: Line | None = None) -> Line:
    """Fit a line, or a longer one around a `part` of it; its normal lies right of the way along the outline."""
    middle = points.mean(axis=0)
    spread = points - middle
    along = np.linalg.eigh(spread.T @ spread)[1][:, 1]
    way = points[-1] - points[0] if part is None else np.array([part.normal[1], -part.normal[0]])
    if float(along @ way) < 0:
        along = -along
    normal = np.array([-along[1], along[0]])
    # an outline's steps are straight or diagonal
    return Line(normal, float(normal @ middle), points, middle, len(points) / float(np.abs(along).max()))


def seen_share(place: Array, length: float) -> float:
    """Share of a side that outline runs along, from the places of its points along the side [px]."""
    inside = place[(place > -1) & (place < length + 1)]
    return len(np.unique(np.floor(inside / BIN_PX))) * BIN_PX / length


def facing(lines: Sequence[Line]) -> Bools:
    """Which lines may be sides of one dark convex shape: each lies on the dark side of the other `(n, n)`."""
    normals = np.array([line.normal for line in lines]).reshape(-1, 2)
    offsets = np.array([line.offset for line in lines])
    middles = np.array([line.middle for line in lines]).reshape(-1, 2)
    inside = normals @ middles.T < offsets[:, None]
    return np.asarray(inside & inside.T)


def crossing(first: Line, second: Line) -> Array | None:
    """Corner of a dark shape between two of its sides `(2,)` [px]; none where they are nearly parallel."""
    matrix = np.array([first.normal, second.normal])
    if abs(float(np.linalg.det(matrix))) < OUTLINE.min_sine:
        return None
    # The outline runs over the blob's own pixels: its edge is half a pixel farther out.
    return np.asarray(np.linalg.solve(matrix, np.array([first.offset, second.offset]) + 0.5))
