"""Reading the code of a quad whose cells are partly hidden or in a highlight, and how likely chance reads as well.

Two readings are tried. By levels a cell is black or white as border and paper are; what is neither has something on it
and says nothing. By steps a cell is compared with its neighbours: a highlight lifts ink above the paper elsewhere, but
it grows slowly and leaves the step between ink and paper beside it. What is blown on both sides says nothing.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from mkdaemon.vision.camera.image import BRIGHTEST
from mkdaemon.vision.limits import LIMITS
from mkdaemon.vision.tags.cellread import carry, image_from_cells, sample
from mkdaemon.vision.tags.detection import Detection, Stage
from mkdaemon.vision.tags.tagfamily import cells, find_family

Array = npt.NDArray[np.float64]
Bools = npt.NDArray[np.bool_]
Grey = npt.NDArray[np.uint8]
Covered = Mapping[tuple[str, int], Bools]
"""Cells `(n, n)` of tags, by family and id, that say nothing."""

OUTLINE = LIMITS.outline
READINGS = 2
"""By levels and by steps: chance has so many tries."""
DEPTHS = (0.3, 0.25, 0.2, 0.15, 0.1)
"""Where a step is sampled, from the line between both cells [cells]: beyond the blur of small tags, and in larger ones
no farther than `OutlineLimits.max_depth_px`, before light changes much."""
ALONG = (-0.3, 0.0, 0.3)
"""The same, along the line."""
SHARP_DEPTH = 0.1
"""The same for the sides of a quad: an eighth of the border."""
CLEAR_PERCENT = 75
"""Percentile of the steps around a tag that are not blown."""


@dataclass(frozen=True, slots=True, eq=False)
class _Codes:
    """Codes of one family, each turned counter-clockwise by 0 to 3 quarters.

    Attributes:
        tag_id: of each `(k,)`.
        turn: quarters `(k,)`.
        bits: which cells are white, border included `(k, n, n)`.
        seen: which have nothing on them `(k, n, n)`.
        data: the same, without the border `(k, n, n)`.
    """

    tag_id: list[int]
    turn: list[int]
    bits: Bools
    seen: Bools
    data: Bools


@dataclass(frozen=True, slots=True, eq=False)
class _Sides:
    """Lines between neighbouring cells of a tag, in cell coordinates.

    Every line counts for one of its cells, the inner one, so that a cell says no more than one bit.

    Attributes:
        outer: of each line the other cell, row by row `(m,)`.
        of_cell: whether a line counts for a cell `(m, n * n)`.
        points: samples on both sides, inner ones first `(2 * m * 3, 2)`.
        rim: samples outside the black square, then as many inside `(2 * r, 2)`.
    """

    outer: npt.NDArray[np.intp]
    of_cell: Array
    points: Array
    rim: Array


class CodeReader:
    """Reads quads against the codes of a whitelist.

    Attributes:
        sizes: cells along the black squares of its families.
    """

    def __init__(self, whitelist: Mapping[str, frozenset[int]], covered: Covered) -> None:
        """Prepare the codes.

        Args:
            whitelist: ids by family.
            covered: cells of a code that another tag lies on, which say nothing.
        """
        self._codes = {name: _turned(name, ids, covered) for name, ids in whitelist.items() if ids}
        self.sizes = sorted({find_family(name).black_cells for name in self._codes})

    def read(self, pixels: Grey, quad: Array, stage: Stage) -> Detection | None:
        """The code that explains the readable cells of a quad; none when chance does as well.

        Args:
            pixels: `(h, w)` uint8.
            quad: corners of the black square, clockwise in the image `(4, 2)` [px].
            stage: the search that found it.
        """
        best: tuple[float, Detection] | None = None
        for name, codes in self._codes.items():
            n = find_family(name).black_cells
            homography = image_from_cells(quad, n)
            for share in (_levels(pixels, homography, n), _steps(pixels, homography, n, codes)):
                if share is None:
                    continue
                white, black = np.abs(share - 1) < OUTLINE.level, np.abs(share) < OUTLINE.level
                known = np.count_nonzero((white | black) & codes.data, axis=(1, 2))
                wrong = np.count_nonzero((white & ~codes.bits | black & codes.bits) & codes.data, axis=(1, 2))
                chances = [_chance(*pair) for pair in zip(known.tolist(), wrong.tolist(), strict=True)]
                k = int(np.argmin(chances))
                chance = READINGS * len(chances) * chances[k]
                if chance <= OUTLINE.max_chance and (best is None or chance < best[0]):
                    # The print is turned counter-clockwise by `turn` quarters: so are its corners.
                    corners = np.roll(quad, codes.turn[k], axis=0)
                    margin = _sharpness(pixels, homography, n)
                    best = chance, Detection(name, codes.tag_id[k], int(wrong[k]), margin, corners, stage)
        return best[1] if best is not None else None


def _turned(name: str, ids: frozenset[int], covered: Covered) -> _Codes:
    """All codes of a family in all turns."""
    tag_id, turn, bits, seen = [], [], [], []
    for one in sorted(ids):
        white = cells(name, one) > 0
        free = ~covered.get((name, one), np.zeros_like(white))
        for quarters in range(4):
            tag_id.append(one)
            turn.append(quarters)
            bits.append(np.rot90(white, quarters))
            seen.append(np.rot90(free, quarters))
    data = np.array(seen)
    data[:, [0, -1]] = False
    data[:, :, [0, -1]] = False
    return _Codes(tag_id, turn, np.array(bits), np.array(seen), data)


@lru_cache(maxsize=4096)
def _chance(known: int, wrong: int) -> float:
    """Probability that so many cells read by chance disagree with a code in so few, or fewer."""
    return sum(math.comb(known, k) for k in range(wrong + 1)) / 2.0**known


def _levels(pixels: Grey, homography: Array, n: int) -> Array | None:
    """White share of cells `(1, n, n)`: 0 as the border, 1 as the paper; none without contrast."""
    row, column = np.divmod(np.arange((n + 2) ** 2), n + 2)
    values = sample(pixels, carry(homography, np.column_stack([column - 0.5, row - 0.5]))).reshape(n + 2, n + 2)
    inside = values[1:-1, 1:-1]
    paper, ink = _median_around(values), _median_around(inside)
    return ((inside - ink) / (paper - ink))[None] if paper - ink >= OUTLINE.min_contrast else None


def _median_around(values: Array) -> float:
    """Median of the outermost cells."""
    return float(np.median(np.concatenate([values[0], values[-1], values[1:-1, 0], values[1:-1, -1]])))


def _steps(pixels: Grey, homography: Array, n: int, codes: _Codes) -> Array | None:
    """White share of cells `(k, n, n)` by the steps from their outer neighbours; none without contrast.

    Beside a black neighbour of grey value b a cell has b when it is black, and the least of b + contrast and 255 when
    it is white; beside a white one b - contrast and b. One blown neighbour of a white cell is as good as any; a cell
    that is blown beside one tells nothing. Cells without a line that tells have one half.
    """
    sides = _sides(n, _depth(homography, n))
    outside, inside = sample(pixels, carry(homography, sides.rim)).reshape(2, -1)
    contrast = float(np.percentile(outside - inside, CLEAR_PERCENT))
    if contrast < OUTLINE.min_contrast:
        return None
    here, there = sample(pixels, carry(homography, sides.points)).reshape(2, -1, len(ALONG)).mean(axis=2)
    least = max(OUTLINE.min_room, LIMITS.read.faint * contrast)
    room = np.minimum(there + contrast, BRIGHTEST) - there
    by_black = np.where(room < least, 0.0, (here - there) / np.maximum(room, 1.0) - 0.5)
    by_white = 0.5 + (here - there) / contrast
    blown = there >= LIMITS.read.saturated
    by_white[blown] = np.where(here[blown] < BRIGHTEST - least, -0.5, 0.0)
    white = codes.bits.reshape(len(codes.turn), -1)[:, sides.outer]
    seen = codes.seen.reshape(len(codes.turn), -1)[:, sides.outer]
    votes = np.where(white, by_white, by_black).clip(-0.5, 0.5) * seen
    lines = (votes != 0).astype(np.float64) @ sides.of_cell
    share: Array = 0.5 + (votes @ sides.of_cell) / np.maximum(lines, 1.0)
    return share.reshape(-1, n, n)


def _depth(homography: Array, n: int) -> float:
    """Where steps are sampled in cells as large as those of a quad [cells]."""
    square = carry(homography, np.array([[0.0, 0.0], [n, 0.0], [n, n], [0.0, n]]))
    cell_px = float(np.linalg.norm(square - np.roll(square, 1, axis=0), axis=1).mean()) / n
    return next((depth for depth in DEPTHS if depth * cell_px <= OUTLINE.max_depth_px), DEPTHS[-1])


def _sharpness(pixels: Grey, homography: Array, n: int) -> float:
    """Mean step over the quad's sides, close to them: a quad that lies beside the tag's has little [grey]."""
    outside, inside = sample(pixels, carry(homography, _rim(n, SHARP_DEPTH))).reshape(2, -1)
    return float(np.mean(outside - inside))


@lru_cache(maxsize=32)
def _sides(n: int, depth: float) -> _Sides:
    """The lines of a tag of `n` cells a side, sampled `depth` cells from them."""
    index = np.arange(n * n).reshape(n, n)
    first = np.concatenate([index[:, :-1].ravel(), index[:-1].ravel()])
    second = np.concatenate([index[:, 1:].ravel(), index[1:].ravel()])
    row, column = np.divmod(np.arange(n * n), n)
    layer = np.minimum(np.minimum(row, column), n - 1 - np.maximum(row, column))
    inner_first = layer[first] > layer[second]
    cell, outer = np.where(inner_first, first, second), np.where(inner_first, second, first)
    data = layer[cell] > 0
    cell, outer = cell[data], outer[data]
    middle = np.column_stack([column, row]) + 0.5
    across = middle[cell] - middle[outer]
    line = (middle[cell] + middle[outer]) / 2
    spread = np.array(ALONG)[:, None] * across[:, None, ::-1]
    points = [(line + away * across)[:, None] + spread for away in (depth, -depth)]
    of_cell = (cell[:, None] == np.arange(n * n)).astype(np.float64)
    return _Sides(outer, of_cell, np.concatenate(points).reshape(-1, 2), _rim(n, depth))


@lru_cache(maxsize=32)
def _rim(n: int, depth: float) -> Array:
    """Samples `depth` cells outside the black square, then as many inside `(2 * 8 * n, 2)`."""
    along = (np.arange(2 * n) + 0.5) / 2
    near, far = np.full_like(along, depth), np.full_like(along, n - depth)
    return np.concatenate(
        [
            np.column_stack(pair)
            for low, high in ((-near, n + near), (near, far))
            for pair in ((along, low), (high, along), (along, high), (low, along))
        ]
    )
