"""A search for tags with things lying on them: four lines of a broken outline, and the cells that can still be read.

libapriltag wants an unbroken quad. Here a dark blob's outline is cut into straight pieces, pieces of one line are put
together, and every four lines that could bound a black square are tried; where no four are whole, three too. What can
be read of their cells has to agree with a code beyond chance (`coderead.py`): that decides, and nothing else has to.

Of three sides of a black square, whose fourth a highlight opens, or a hand, foot or shoe lies over, two whole corners
and the ways of the sides leave one unknown, how far away the fourth side is. The lines between the cells tell it,
whatever the code is: at the right distance they lie where the image has steps, and none lie amid cells.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Final

import cv2
import numpy as np
import numpy.typing as npt

from mkdaemon.vision.arrays import Array, Grey
from mkdaemon.vision.limits import HALF, LIMITS
from mkdaemon.vision.tags.cellread import sample
from mkdaemon.vision.tags.coderead import STEP_CELLS, CodeReader, Covered
from mkdaemon.vision.tags.detection import Detection, best_of_codes

Index = npt.NDArray[np.intp]
Ints = npt.NDArray[np.int32]

SPECK_PX: Final = 3
"""Side of the window whose median a pixel of dark and light is."""
BOX_CELLS: Final = 3
"""Surroundings that ink in a highlight is darker than: a cell and its neighbours."""
MAX_BLOBS: Final = 12
"""Blobs with the longest hulls that are tried."""
MAX_LINES: Final = 8
"""Lines of a blob that are tried: what more would cost is four lines of each."""
MAX_PIECES: Final = 32
"""Longest straight pieces of a blob that are put together."""
CORNER_POINTS: Final = 2
"""Points at each end of a piece that do not lie on its line: corners of a blob are round."""
FAR: Final = 1e6
"""Between the places of points of different lines [px]: longer than any line."""
DEPTHS: Final = np.geomspace(0.6, 1.6, 41)
"""Distances of the fourth side that are tried, over the length of the one before it: a print tilted by 50 degrees is
so much shorter or longer. Neighbours are a fifth of a cell apart at the far side."""


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
        """All codes inside of dark outlines of `(h, w)` uint8 that agree beyond chance; of one code the clearest."""
        if not self._reader.sizes:
            return []
        # Holes too: where something dark over a side joins a tag to dark ground, its sides bound the paper around it.
        outlines, _ = cv2.findContours(_dark(pixels), cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)
        least = 3 * self._reader.sizes[0] * LIMITS.cells.mixed_px  # three sides
        # Neighbouring points are at most a diagonal apart.
        long = (np.asarray(outline, dtype=np.int32) for outline in outlines if len(outline) * math.sqrt(2) > least)
        hulls = ((cv2.arcLength(cv2.convexHull(outline), closed=True), outline) for outline in long)
        large = sorted(hulls, key=lambda pair: -pair[0])[:MAX_BLOBS]
        quads = (quad for _, outline in large for quad in _quads(pixels, lines_of(outline), self._reader.sizes))
        # A side along the image's edge is where the print was cut.
        far = np.array(pixels.shape[::-1]) - 1 - SPECK_PX
        whole = (quad for quad in quads if ((quad >= SPECK_PX) & (quad <= far)).all())
        read = (self._reader.read(pixels, quad) for quad in whole)
        return best_of_codes((one for one in read if one is not None), lambda one: (-one.hamming, one.decision_margin))


def has_highlights(pixels: Grey) -> bool:
    """Whether enough of `(h, w)` uint8 is blown to be a print in a highlight: cells that tell something."""
    blown = np.count_nonzero(pixels >= LIMITS.read.saturated)
    return bool(blown >= LIMITS.read.min_cells * LIMITS.cells.mixed_px**2)


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
    box, rise = BOX_CELLS * int(LIMITS.cells.mixed_px), LIMITS.read.rise
    even = cv2.adaptiveThreshold(pixels, 255, cv2.ADAPTIVE_THRESH_MEAN_C, cv2.THRESH_BINARY_INV, box, -rise)
    return np.where(pixels < LIMITS.read.saturated, even, 0).astype(np.uint8)


@dataclass(frozen=True, slots=True, eq=False)
class Lines:
    """Straight parts of an outline, clockwise around what is dark, `n` in all.

    Attributes:
        middles: mean of the points of each `(n, 2)` [px].
        ways: along each, what is dark lies on the right `(n, 2)`.
        pitches: of its points, longer along diagonals `(n,)` [px].
        lengths: how much outline each has `(n,)` [px].
        places: of all points along their line from its middle, those of line `k` around `k * FAR`, in order [px].
    """

    middles: Array
    ways: Array
    pitches: Array
    lengths: Array
    places: Array

    @property
    def outwards(self) -> Array:
        """Unit vectors away from what is dark `(n, 2)`."""
        return np.column_stack([self.ways[:, 1], -self.ways[:, 0]])

    def corners(self) -> Array:
        """Where each line meets each one that may follow it clockwise `(n, n, 2)` [px]; NaN where none may.

        The outline runs over the blob's own pixels: its edge is half a pixel farther out.
        """
        sines = self.ways[:, None, 0] * self.ways[:, 1] - self.ways[:, None, 1] * self.ways[:, 0]
        out = (self.outwards * self.middles).sum(axis=1)[:, None] + HALF
        crossings = out * self.ways[:, None] - out[:, None] * self.ways
        return np.asarray(crossings / np.where(sines > 0, sines, np.nan)[..., None])

    def support(self, quads: Array, sides: Index) -> Array:
        """How well the worst of the first sides of quads is seen `(m,)`: share of side and line that is both.

        What a line has beyond its corners counts against it: the rim of a thing on a print ends elsewhere. Lines that
        bound no quad have 0.

        Args:
            quads: corners clockwise `(m, 4, 2)` [px].
            sides: lines from the first corner on `(m, 3)` or `(m, 4)`.
        """
        of = sides.shape[1]
        corners = np.stack([quads[:, :of], np.roll(quads, -1, axis=1)[:, :of]])
        start, end = ((corners - self.middles[sides]) * self.ways[sides]).sum(axis=-1).clip(-FAR / 2, FAR / 2)
        first, last = (np.searchsorted(self.places, place + FAR * sides) for place in (start, end))
        seen = (last - first) * self.pitches[sides]
        either = end - start + self.lengths[sides] - seen
        return np.asarray(np.where(end > start, seen / np.maximum(either, 1.0), 0.0).min(axis=1))


def lines_of(outline: Ints) -> Lines:
    """The longest straight lines of an outline `(n, 1, 2)` [px], pieces of one line put together."""
    pieces = _pieces(outline)
    ends = np.array([piece[[0, -1]] for piece in pieces]).reshape(-1, 2, 2)
    found: list[tuple[Array, Array, Array]] = []
    while pieces and len(found) < MAX_LINES:
        middle, way = _fit(pieces[0], ends[0, 1] - ends[0, 0])
        # An edge is found within its half width.
        off = np.abs((ends - middle) @ [way[1], -way[0]]).max(axis=1)
        on = (off < LIMITS.blur.sharp_px) & ((ends[:, 1] - ends[:, 0]) @ way > 0)
        on[0] = True
        points = np.concatenate(list(itertools.compress(pieces, on)))
        middle, way = _fit(points, way) if np.count_nonzero(on) > 1 else (middle, way)
        found.append((middle, way, np.sort((points - middle) @ way)))
        pieces, ends = list(itertools.compress(pieces, ~on)), ends[~on]
    found.sort(key=lambda line: math.atan2(line[1][1], line[1][0]))
    middles, ways = (np.array([line[k] for line in found]).reshape(-1, 2) for k in (0, 1))
    # An outline's steps are straight or diagonal.
    pitches = 1.0 / np.abs(ways).max(axis=1)
    lengths = pitches * [len(line[2]) for line in found]
    places = np.concatenate([np.empty(0), *(FAR * k + line[2] for k, line in enumerate(found))])
    return Lines(middles, ways, pitches, lengths, places)


def _pieces(outline: Ints) -> list[Array]:
    """Points `(m, 2)` of the longest straight pieces of an outline without its round corners, the longest first."""
    ends = np.asarray(cv2.approxPolyDP(outline, LIMITS.blur.sharp_px, closed=True), dtype=np.int64)
    # findContours has what is dark on the left.
    points = outline.reshape(-1, 2)[::-1].astype(np.int64)
    keys, wanted = (xy.reshape(-1, 2) @ np.array([1, 1 << 20]) for xy in (points, ends))
    marks = np.flatnonzero(np.isin(keys, wanted))
    after = np.append(marks[1:], marks[0] + len(points))
    around = np.concatenate([points, points[: marks[0]]]).astype(np.float64)
    longest = np.argsort(marks - after, kind="stable")[:MAX_PIECES]
    spans = zip(marks[longest] + CORNER_POINTS, after[longest] - CORNER_POINTS, strict=True)
    return [around[first : last + 1] for first, last in spans if last - first >= 2 * CORNER_POINTS]


def _fit(points: Array, towards: Array) -> tuple[Array, Array]:
    """Mean of points and the way of a line through them, turned towards this."""
    fitted = cv2.fitLine(points.astype(np.float32), cv2.DIST_L2, 0, 0.01, 0.01).astype(np.float64).ravel()
    way = fitted[:2] if float(fitted[:2] @ towards) > 0.0 else -fitted[:2]
    return fitted[2:], way


def _quads(pixels: Grey, lines: Lines, sizes: Sequence[int]) -> Iterator[Array]:
    """Quads that the lines of a blob may bound, their corners clockwise in the image `(4, 2)` [px].

    The best one of four lines, and where that is not whole the best one of three.

    Args:
        pixels: `(h, w)` uint8.
        lines: of its outline.
        sizes: cells along the black squares that may be there.
    """
    corners = lines.corners()
    four = _choices(len(corners), 4)
    quads = corners[np.roll(four, 1, axis=1), four]
    support = lines.support(quads, four)
    best = _best(support)
    if best is not None:
        yield quads[best]
    if best is None or support[best] < LIMITS.agreement.whole:
        yield from _open_quads(pixels, lines, corners, sizes)


def _open_quads(pixels: Grey, lines: Lines, corners: Array, sizes: Sequence[int]) -> Iterator[Array]:
    """Quads between the best three of a blob's lines and the fourth side that the image's cells ask for; see `_quads`.

    The fourth side is taken to be parallel to the middle one, as far away as that is long until the cells are asked.
    """
    three = _choices(len(corners), 3)
    first, middle, last = three.T
    starts, ends = corners[first, middle], corners[middle, last]
    outwards, side = lines.outwards[middle], np.linalg.norm(ends - starts, axis=1)
    before, after = (
        (-side / (lines.ways[arm] * outwards).sum(axis=1))[:, None] * lines.ways[arm] for arm in (first, last)
    )
    best = _best(lines.support(np.stack([starts + before, starts, ends, ends + after], axis=1), three))
    if best is None:
        return
    start, end = starts[best], ends[best]
    quads = np.array([(start + d * before[best], start, end, end + d * after[best]) for d in DEPTHS])
    yield from (quads[int(np.argmax(_combs(pixels, quads, n)))] for n in sizes)


@lru_cache(maxsize=32)
def _choices(n: int, of: int) -> Index:
    """Four of `n` lines clockwise `(m, 4)`; or three, from each of them on: the last side is gone `(m, 3)`."""
    chosen = np.array(list(itertools.combinations(range(n), of)), dtype=np.intp).reshape(-1, of)
    return chosen if of == 4 else np.concatenate([np.roll(chosen, k, axis=1) for k in range(of)])


def _best(support: Array) -> int | None:
    """The quad that is seen best; none where all have a side that is hardly seen."""
    best = int(np.argmax(support)) if len(support) else None
    return best if best is not None and support[best] >= LIMITS.read.least_side else None


def _combs(pixels: Grey, quads: Array, n: int) -> Array:
    """Mean step over the lines between cells that run along the second side, less that amid cells, of each [grey].

    Second and fourth side are parallel: what lies a share t of the cells from the one to the other is their mean with
    the weights 1 - t and t r, with r the second one's length over the fourth one's.
    """
    away = np.arange(1, 2 * n)[:, None] / 2 + np.array([STEP_CELLS, -STEP_CELLS])[:, None, None]
    t = (away / n)[None, ..., None]
    along = ((np.arange(2 * n) + 0.5) / (2 * n))[:, None]
    far, start, end, last = (corner[:, None, None, None] for corner in quads.transpose(1, 0, 2))
    second, fourth = end - start, last - far
    weight = t * np.linalg.norm(second, axis=-1, keepdims=True) / np.linalg.norm(fourth, axis=-1, keepdims=True)
    points = ((1 - t) * (start + along * second) + weight * (far + along * fourth)) / (1 - t + weight)
    values = sample(pixels, points.reshape(-1, 2)).reshape(len(quads), 2, 2 * n - 1, -1)
    steps = np.minimum(np.abs(values[:, 0] - values[:, 1]), LIMITS.read.rise).mean(axis=2)
    return np.asarray(steps[:, 1::2].sum(axis=1) - steps[:, ::2].sum(axis=1))
