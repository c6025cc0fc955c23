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
from typing import Final

import numpy as np
import numpy.typing as npt

from mkdaemon.vision.arrays import Array, Bools, Grey
from mkdaemon.vision.camera.image import BRIGHTEST
from mkdaemon.vision.limits import HALF, LIMITS, NOISE_GREY
from mkdaemon.vision.tags.cellread import carry, cell_values, image_from_cells, paper_and_ink, rim_values, sample
from mkdaemon.vision.tags.detection import Detection
from mkdaemon.vision.tags.tagfamily import cells, find_family

Covered = Mapping[tuple[str, int], Bools]
"""Cells `(n, n)` of tags, by family and id, that say nothing."""

READINGS = 2
"""By levels and by steps: chance has so many tries."""
TURNS = 4
"""Of a quad: chance has as many tries with each code."""
LEVEL: Final = HALF / 2
"""Of a contrast, within which a cell is black or white: half way to what is neither."""
LEAST_GREY: Final = NOISE_GREY / LEVEL
"""Contrast below which noise alone can make a cell neither [grey]."""
STEP_CELLS: Final = 0.15
"""How far on both sides of a line its step is sampled, before light changes much [cells]."""
ALONG = (-0.3, 0.0, 0.3)
"""Where a step is sampled along the line [cells]."""


@dataclass(frozen=True, slots=True, eq=False)
class _Codes:
    """Codes of one family, each turned counter-clockwise by 0 to 3 quarters: `k` in all.

    Attributes:
        turned: id and quarters of each.
        bits: which cells are white, border included `(k, n, n)`.
        seen: which have nothing on them `(k, n, n)`.
    """

    turned: list[tuple[int, int]]
    bits: Bools
    seen: Bools


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
        self._codes = {name: _codes(name, ids, covered) for name, ids in whitelist.items() if ids}
        self.sizes = sorted({find_family(name).black_cells for name in self._codes})

    def read(self, pixels: Grey, quad: Array) -> Detection | None:
        """The code that explains the readable cells of a quad; none when chance does as well.

        Args:
            pixels: `(h, w)` uint8.
            quad: corners of the black square, clockwise in the image `(4, 2)` [px].
        """
        found: list[tuple[float, Detection]] = []
        for name, codes in self._codes.items():
            n = find_family(name).black_cells
            homography = image_from_cells(quad, n)
            for share in (_levels(pixels, homography, n), _steps(pixels, homography, n, codes)):
                if share is None:
                    continue
                white, black = np.abs(share - 1) < LEVEL, np.abs(share) < LEVEL
                known = (white | black) & codes.seen
                wrong = known & (white != codes.bits)
                # The border is the same in all codes.
                read, wrong = (np.count_nonzero(of[:, 1:-1, 1:-1], axis=(1, 2)) for of in (known, wrong))
                tries = READINGS * len(read)
                chances = [chance(*pair, tries) for pair in zip(read.tolist(), wrong.tolist(), strict=True)]
                k = int(np.argmin(chances))
                if chances[k] <= LIMITS.read.max_chance:
                    tag_id, quarters = codes.turned[k]
                    # A quad that lies beside the tag's has little contrast there.
                    margin = float(_rim_steps(pixels, homography, n).mean())
                    corners = np.roll(quad, quarters, axis=0)  # turned as the print is
                    found.append((chances[k], Detection(name, tag_id, int(wrong[k]), margin, corners, "outline")))
        return min(found, key=lambda one: one[0])[1] if found else None


def _codes(name: str, ids: frozenset[int], covered: Covered) -> _Codes:
    """All codes of a family in all turns."""
    turned = [(tag_id, quarters) for tag_id in sorted(ids) for quarters in range(TURNS)]
    bits = [np.rot90(cells(name, tag_id) > 0, quarters) for tag_id, quarters in turned]
    nothing = np.zeros_like(bits[0])
    seen = np.array([~np.rot90(covered.get((name, tag_id), nothing), quarters) for tag_id, quarters in turned])
    return _Codes(turned, np.array(bits), seen)


@lru_cache(maxsize=4096)
def chance(read: int, wrong: int, tries: int) -> float:
    """Probability that so many cells of a random quad disagree with one of so many codes in so few, or fewer.

    A bound where it is small: tries are added up.
    """
    return tries * sum(math.comb(read, k) for k in range(wrong + 1)) / 2.0**read


def _levels(pixels: Grey, homography: Array, n: int) -> Array | None:
    """White share of cells `(1, n, n)`: 0 as the border, 1 as the paper; none without contrast."""
    values = cell_values(pixels, homography, n)
    paper, ink = paper_and_ink(values)
    return (values[None, 1:-1, 1:-1] - ink) / (paper - ink) if paper - ink >= LEAST_GREY else None


def _rim_steps(pixels: Grey, homography: Array, n: int) -> Array:
    """Steps over the sides of a quad `(4, 2 * n)` [grey]."""
    return rim_values(pixels, homography, n, STEP_CELLS) - rim_values(pixels, homography, n, -STEP_CELLS)


def _steps(pixels: Grey, homography: Array, n: int, codes: _Codes) -> Array | None:
    """White share of cells `(k, n, n)` by the steps from their outer neighbours; none without contrast.

    Beside a black neighbour of grey value b a cell has b when it is black, and the least of b + contrast and 255 when
    it is white; beside a white one b - contrast and b. One blown neighbour of a white cell is as good as any; a cell
    that is blown beside one tells nothing. Cells without a line that tells have one half.
    """
    contrast = float(np.median(_rim_steps(pixels, homography, n)))
    if contrast < LEAST_GREY:
        return None
    outer, of_cell, points = _lines(n)
    here, there = sample(pixels, carry(homography, points)).reshape(2, -1, len(ALONG)).mean(axis=2)
    least = LIMITS.read.faint * contrast
    room = np.minimum(there + contrast, BRIGHTEST) - there
    by_black = np.where(room < least, 0.0, (here - there) / np.maximum(room, 1.0) - 0.5)
    by_white = 0.5 + (here - there) / contrast
    blown = there >= LIMITS.read.saturated
    by_white[blown] = np.where(here[blown] < BRIGHTEST - least, -0.5, 0.0)
    white, seen = (of.reshape(len(codes.turned), -1)[:, outer] for of in (codes.bits, codes.seen))
    votes = np.where(white, by_white, by_black).clip(-0.5, 0.5) * seen
    lines = (votes != 0).astype(np.float64) @ of_cell
    share: Array = 0.5 + (votes @ of_cell) / np.maximum(lines, 1.0)
    return share.reshape(-1, n, n)


@lru_cache(maxsize=32)
def _lines(n: int) -> tuple[npt.NDArray[np.intp], Array, Array]:
    """The `m` lines between neighbouring cells of a tag of `n` cells a side, in cell coordinates.

    Every line counts for one of its cells, the inner one, so that a cell says no more than one bit.

    Returns:
        The other cell of each line, row by row `(m,)`; whether a line counts for a cell `(m, n * n)`; samples
        beside the lines, those in inner cells first `(2 * m * 3, 2)`.
    """
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
    points = [(line + away * across)[:, None] + spread for away in (STEP_CELLS, -STEP_CELLS)]
    return outer, (cell[:, None] == np.arange(n * n)).astype(np.float64), np.concatenate(points).reshape(-1, 2)
