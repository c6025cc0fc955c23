"""A search for tags with things lying on them: four lines of a broken outline, and the cells that can still be read.

A dark blob's outline is cut into straight lines, and every four that could bound a black square are tried, and every
three. What can be read of the cells of the best has to agree with a code beyond chance (`cellread.py`): that decides.

Of a black square without its fourth side, two corners and the ways of the sides leave one unknown, how far away that
is. The lines between the cells tell it, whatever the code is: at the right distance they lie where the image has steps,
and none lie amid cells.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Final

import cv2
import numpy as np
import numpy.typing as npt

from mkdaemon.vision.arrays import Array, Grey
from mkdaemon.vision.limits import HALF, LIMITS
from mkdaemon.vision.tags.cellread import STEP_CELLS, CodeReader, Detection, carry, image_from_cells, sample

Index = npt.NDArray[np.intp]

SPECK_PX: Final = 3
"""Side of the window whose median a pixel of dark and light is."""
BOX_CELLS: Final = 3
"""Surroundings that ink in a highlight is darker than: a cell and its neighbours."""
MAX_BLOBS: Final = 12
"""Largest blobs, by width and height, that are tried."""
MAX_LINES: Final = 8
"""Lines of a blob that are tried: what more would cost is four lines of each."""
SAME_WAY: Final = 0.7
"""Cosine of the angle between the ways of a line and of the outline at its points: round corners are none of it."""
DEPTHS: Final = np.geomspace(0.6, 1.6, 21)
"""Distances of the fourth side that are tried, over the length of the one before it: the range
of a print tilted by 50 degrees. Neighbours are two fifths of a cell apart at the far side."""


def read_outlines(pixels: Grey, reader: CodeReader) -> list[Detection]:
    """All codes inside of dark outlines of `(h, w)` uint8 that agree beyond chance.

    Corners are those of fitted lines, good to some tenths of a pixel: a start for the edge fit.
    """
    if not reader.sizes:
        return []
    # Holes too: where something dark over a side joins a tag to dark ground, its sides bound the paper around it.
    outlines, _ = cv2.findContours(_dark(pixels), cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)
    # Three sides, whose points are at most a diagonal apart.
    least = 3 * reader.sizes[0] * LIMITS.cells.mixed_px / math.sqrt(2)
    long = (outline for outline in outlines if len(outline) > least)
    large = sorted(long, key=lambda outline: -sum(cv2.boundingRect(outline)[2:]))[:MAX_BLOBS]
    quads = (quad for outline in large for quad in _quads(pixels, lines_of(outline), reader.sizes))
    # A side along the image's edge is where the print was cut.
    far = np.array(pixels.shape[::-1]) - 1 - SPECK_PX
    return reader.read(pixels, (quad for quad in quads if ((quad >= SPECK_PX) & (quad <= far)).all()))


def has_highlights(pixels: Grey) -> bool:
    """Whether as many cells of `(h, w)` uint8 are blown as could tell a code from chance."""
    telling = -math.log2(LIMITS.read.max_chance)
    return bool(np.count_nonzero(pixels >= LIMITS.read.saturated) >= telling * LIMITS.cells.mixed_px**2)


def _dark(pixels: Grey) -> Grey:
    """What is dark `(h, w)`, not 0, of an image of dark and light."""
    if has_highlights(pixels):
        # Ink may be brighter than paper elsewhere: it is neither blown nor brighter than what is around it.
        box, rise = BOX_CELLS * int(LIMITS.cells.mixed_px), LIMITS.read.rise
        dark = cv2.adaptiveThreshold(pixels, 255, cv2.ADAPTIVE_THRESH_MEAN_C, cv2.THRESH_BINARY_INV, box, -rise)
        dark[pixels >= LIMITS.read.saturated] = 0
    else:
        _, dark = cv2.threshold(pixels, 0, 255, cv2.THRESH_BINARY_INV | cv2.THRESH_OTSU)
    # Specks have outlines too, thousands in noise or on a lawn.
    return np.asarray(cv2.medianBlur(dark, SPECK_PX), dtype=np.uint8)


@dataclass(frozen=True, slots=True, eq=False)
class Lines:
    """Straight parts of an outline, clockwise around what is dark, `n` in all.

    Attributes:
        starts: where each begins `(n, 2)` [px].
        ways: along each, what is dark lies on the right `(n, 2)`.
        lengths: to where each ends `(n,)` [px].
        shares: of that which is outline `(n,)`.
    """

    starts: Array
    ways: Array
    lengths: Array
    shares: Array

    def corners(self) -> Array:
        """Intersections of each line with those that may follow it clockwise `(n, n, 2)` [px]; NaN for the others."""
        x, y = self.ways.T
        sines = x[:, None] * y - y[:, None] * x
        # The outline runs over the blob's own pixels: its edge is half a pixel farther out.
        out = y * self.starts[:, 0] - x * self.starts[:, 1] + HALF
        crossings = out[:, None] * self.ways[:, None] - out[:, None, None] * self.ways
        return np.asarray(crossings / np.where(sines > 0, sines, np.nan)[..., None])

    def best(self, quads: Array, sides: Index) -> Array | None:
        """The quad of which the worst of the first sides is seen best; none where all have one that is hardly seen.

        A side is seen by the share of side and line that is both: the rim of a thing on a print ends elsewhere.

        Args:
            quads: corners clockwise `(m, 4, 2)` [px]; NaN where lines bound none.
            sides: lines from the first corner on `(m, 3)` or `(m, 4)`.
        """
        if not len(quads):
            return None
        corners = np.stack([quads, np.roll(quads, -1, axis=1)])[:, :, : sides.shape[1]]
        start, end = ((corners - self.starts[sides]) * self.ways[sides]).sum(axis=-1)
        last = self.lengths[sides]
        seen, either = np.minimum(end, last) - np.maximum(start, 0.0), np.maximum(end, last) - np.minimum(start, 0.0)
        support = np.where(end > start, self.shares[sides] * seen / either, 0.0).min(axis=1)
        best = int(np.argmax(support))
        return np.asarray(quads[best]) if support[best] >= LIMITS.read.least_side else None


def lines_of(outline: npt.NDArray[Any]) -> Lines:
    """The longest straight lines of an outline `(n, 1, 2)` [px]: what lies along a side of the polygon around it."""
    polygon = cv2.approxPolyDP(outline, LIMITS.blur.sharp_px, closed=True)
    # findContours has what is dark on the left.
    points, ends = (xy.reshape(-1, 2)[::-1].astype(np.float64) for xy in (outline, polygon))
    around = np.roll(points, -2, axis=0) - np.roll(points, 2, axis=0)
    sides = np.roll(ends, -1, axis=0) - ends
    sizes = np.linalg.norm(sides, axis=1)
    longest = np.argsort(-sizes)[:MAX_LINES]
    ways = sides[longest] / np.maximum(sizes[longest, None], 1.0)
    normals = ways[:, ::-1] * [1.0, -1.0]
    # Distance of a point p from a side that ends in e, with normal n: |n . (p - e)|. An edge is found within its half
    # width.
    near = np.abs(points @ normals.T - (ends[longest] * normals).sum(axis=1)) < LIMITS.blur.sharp_px
    near &= around @ ways.T > SAME_WAY * np.linalg.norm(around, axis=1)[:, None]
    found: list[tuple[float, ...]] = []
    for side, on in zip(ways, near.T, strict=True):
        mine = points[on]
        if len(mine) > 4:
            fitted = cv2.fitLine(mine.astype(np.float32), cv2.DIST_L2, 0, 0.01, 0.01).ravel().astype(np.float64)
            way = fitted[:2] * np.sign(fitted[:2] @ side)
            places = (mine - fitted[2:]) @ way
            near[on] = False
            # An outline's steps are straight or diagonal.
            steps = np.abs(way).max() * np.ptp(places)
            found.append((*(fitted[2:] + places.min() * way), *way, np.ptp(places), len(mine) / steps))
    found.sort(key=lambda line: math.atan2(line[3], line[2]))
    lines = np.array(found).reshape(-1, 6)
    return Lines(lines[:, :2], lines[:, 2:4], *lines[:, 4:].T)


def _quads(pixels: Grey, lines: Lines, sizes: Sequence[int]) -> Iterator[Array]:
    """Quads that the lines of a blob may bound, their corners clockwise in the image `(4, 2)` [px].

    The best one of four lines. And of the best three one for each size in cells; the sides beside the middle one are
    taken to be as long as that until the image's cells are asked.
    """
    corners = lines.corners()
    four, three = (_choices(len(corners), of) for of in (4, 3))
    whole = lines.best(corners[np.roll(four, 1, axis=1), four], four)
    if whole is not None:
        yield whole
    first, middle, last = three.T
    start, end = corners[first, middle], corners[middle, last]
    side = np.linalg.norm(end - start, axis=1)[:, None]
    far = start - side * lines.ways[first], end + side * lines.ways[last]
    opened = lines.best(np.stack([far[0], start, end, far[1]], axis=1), three)
    if opened is not None:
        near = opened[[1, 1, 2, 2]]
        quads = near + DEPTHS[:, None, None] * (opened - near)
        yield from (quads[int(np.argmax(_combs(pixels, quads, n)))] for n in sizes)


@lru_cache(maxsize=32)
def _choices(n: int, of: int) -> Index:
    """Four of `n` lines clockwise `(m, 4)`; or three, from each of them on: the last side is gone `(m, 3)`."""
    chosen = np.array(list(itertools.combinations(range(n), of)), dtype=np.intp).reshape(-1, of)
    return chosen if of == 4 else np.concatenate([np.roll(chosen, k, axis=1) for k in range(of)])


def _combs(pixels: Grey, quads: Array, n: int) -> Array:
    """Mean step over the lines between cells that run along the second side, less that amid cells, of each [grey]."""
    homographies = np.stack([image_from_cells(quad, n) for quad in quads])
    values = sample(pixels, carry(homographies, _comb(n)).reshape(-1, 2))
    inner, outer = values.reshape(len(quads), 2, 2 * n - 1, -1).swapaxes(0, 1)
    steps = np.minimum(np.abs(inner - outer), LIMITS.read.rise).mean(axis=2)
    return np.asarray(steps[:, 1::2].sum(axis=1) - steps[:, ::2].sum(axis=1))


@lru_cache(maxsize=32)
def _comb(n: int) -> Array:
    """Points on both sides of lines between cells and amid them, the last line first `(2 * (2 n - 1) * 2 n, 2)`."""
    away = np.arange(1, 2 * n) / 2 + np.array([STEP_CELLS, -STEP_CELLS])[:, None]
    points = np.stack(np.broadcast_arrays(n - away[..., None], (np.arange(2 * n) + 0.5) / 2), axis=-1)
    return points.reshape(-1, 2)
