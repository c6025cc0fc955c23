"""Straight lines along the outline of a blob: pieces of one line put together."""

from __future__ import annotations

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
MAX_PIECES = 32
"""Longest straight pieces of a blob that are put together."""
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


def lines_of(outline: npt.NDArray[np.int32], least: float) -> list[Line]:
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
    pieces = _pieces(outline, ends)
    merged: list[Line] = []
    normals = np.empty((len(pieces), 2))
    for piece in pieces:
        # of all lines only the parallel ones are looked at
        parallel = normals[: len(merged)] @ piece.normal > OUTLINE.parallel
        for k in np.flatnonzero(parallel).tolist():
            line = merged[k]
            reach = OUTLINE.straight_px + LINE_REACH * math.dist(piece.middle, line.middle)
            if float(np.abs(piece.points @ line.normal - line.offset).max()) < reach:
                merged[k] = _line(np.concatenate([line.points, piece.points]), line.normal)
                normals[k] = merged[k].normal
                break
        else:
            normals[len(merged)] = piece.normal
            merged.append(piece)
    merged.sort(key=lambda line: -line.length)
    return merged[:MAX_LINES] if sum(line.length for line in merged[:MAX_LINES]) >= least else []


def _pieces(outline: npt.NDArray[np.int32], ends: npt.NDArray[np.int32]) -> list[Line]:
    """The longest straight pieces of an outline between these `ends` `(m, 2)`, the longest first."""
    points = outline.reshape(-1, 2).astype(np.float64)
    keys = outline.reshape(-1, 2).astype(np.int64) @ np.array([1, 1 << 20])
    marks = np.flatnonzero(np.isin(keys, ends.astype(np.int64) @ np.array([1, 1 << 20])))
    after = np.append(marks[1:], marks[0] + len(points))
    is_long = after - marks - 2 * CORNER_POINTS + 1 >= OUTLINE.min_piece_px
    first, last = marks[is_long] + CORNER_POINTS, after[is_long] - CORNER_POINTS
    points = np.concatenate([points, points[: marks[0] + 1]])
    chord = np.linalg.norm(points[last] - points[first], axis=1)
    longest = np.argsort(-chord, kind="stable")[:MAX_PIECES]
    found = []
    for a, b in zip(first[longest].tolist(), last[longest].tolist(), strict=True):
        part = points[a : b + 1]
        way = part[-1] - part[0]
        found.append(_line(part, np.array([-way[1], way[0]])))
    found.sort(key=lambda piece: -piece.length)
    return found


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
    (a, b), (c, d) = first.normal.tolist(), second.normal.tolist()
    sine = a * d - b * c
    if abs(sine) < OUTLINE.min_sine:
        return None
    # The outline runs over the blob's own pixels: its edge is half a pixel farther out.
    e, f = first.offset + 0.5, second.offset + 0.5
    return np.array([(d * e - b * f) / sine, (a * f - c * e) / sine])
