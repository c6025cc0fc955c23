"""Reading the cells of a quad from an image: grey values, sides and codes, and how likely chance reads as well.

Of a code whose cells are partly hidden or in a highlight two readings are tried. By levels a cell is black or white as
border and paper are; what is neither has something on it and says nothing. By steps a cell is compared with its
neighbours: a highlight lifts ink above the paper elsewhere, but it grows slowly and leaves the step between ink and
paper beside it. What is blown on both sides says nothing.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Final

import cv2
import numpy as np
import numpy.typing as npt

from mkdaemon.vision.arrays import Array, Bools, Grey
from mkdaemon.vision.camera.image import BRIGHTEST
from mkdaemon.vision.limits import HALF, LIMITS, NOISE_GREY
from mkdaemon.vision.tags.detection import Detection
from mkdaemon.vision.tags.tagfamily import cells, find_family

Covered = Mapping[tuple[str, int], Bools]
"""Cells `(n, n)` of tags, by family and id, that say nothing."""

READINGS = 2
"""By levels and by steps: chance has so many tries."""
TURNS = 4
"""Of a quad: chance has as many tries with each code."""
QUIET_CELLS = 0.3
"""Where the quiet zone is sampled, outside the black square [cells]."""
LEVEL: Final = HALF / 2
"""Of a contrast, within which a cell is black or white: half way to what is neither."""
LEAST_GREY: Final = NOISE_GREY / LEVEL
"""Contrast below which noise alone can make a cell neither [grey]."""
STEP_CELLS: Final = 0.15
"""How far on both sides of a line its step is sampled, before light changes much [cells]."""
ALONG = (-0.3, 0.0, 0.3)
"""Where a step is sampled along the line [cells]."""


def sample(pixels: Grey, points: Array) -> Array:
    """Grey values at `(n, 2)` [px], bilinear, edge pixels repeated."""
    xy = np.asarray(points, dtype=np.float32)
    found = cv2.remap(pixels, xy[:, None, 0], xy[:, None, 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(found, dtype=np.float64).ravel()


def image_from_cells(corners: Array, n: int) -> Array:
    """Homography `(3, 3)` from cell coordinates (column, row; 0..n over the black square) to pixels."""
    square = np.array([[0, 0], [n, 0], [n, n], [0, n]], dtype=np.float32)
    return np.asarray(cv2.getPerspectiveTransform(square, np.asarray(corners, dtype=np.float32)), dtype=np.float64)


def carry(homography: Array, points: Array) -> Array:
    """Map `(n, 2)` points; by each of several homographies `(..., 3, 3)` where there are more."""
    carried = points @ np.swapaxes(homography[..., :2], -1, -2) + homography[..., None, :, 2]
    mapped: Array = carried[..., :2] / carried[..., 2:]
    return mapped


def cell_values(pixels: Grey, homography: Array, n: int) -> Array:
    """Grey values in the middles of all cells, and of those around the black square `(n + 2, n + 2)`."""
    row, column = np.divmod(np.arange((n + 2) ** 2), n + 2)
    return sample(pixels, carry(homography, np.column_stack([column, row]) - 0.5)).reshape(n + 2, n + 2)


def rim_steps(
    pixels: Grey, homography: Array, n: int, outside: float = STEP_CELLS, inside: float = STEP_CELLS
) -> Array:
    """How much brighter the paper is than the ink beside it, along all sides of a black square `(4, 2 * n)` [grey].

    Args:
        pixels: `(h, w)` uint8.
        homography: see `image_from_cells`.
        n: cells along the black square.
        outside: how far outside of it paper is sampled [cells].
        inside: how far inside ink is [cells].
    """
    values = sample(pixels, carry(homography, _rims(n, outside, -inside))).reshape(2, 4, -1)
    return np.asarray(values[0] - values[1])


@lru_cache(maxsize=32)
def _rims(n: int, *depths: float) -> Array:
    """Points so far outside the black square, inside where negative, top, right, bottom, left `(depths * 8 * n, 2)`."""
    along = (np.arange(2 * n) + 0.5) / 2
    sides = (((along, -d), (n + d, along), (along, n + d), (-d, along)) for d in depths)
    return np.concatenate([np.stack(np.broadcast_arrays(x, y), axis=-1) for four in sides for x, y in four])


def has_sides(pixels: Grey, corners: Array, n: int, *, inverted: bool) -> bool:
    """Whether all four sides of a quad have white right outside and black inside; `inverted` the other way round.

    A quad whose side is the edge of the image, or of something lying over the tag, has black or mixed cells outside.
    White and black are taken from beside each other, so shadow edges and gradients do not count against a side.
    """
    contrast = rim_steps(pixels, image_from_cells(corners, n), n, QUIET_CELLS, HALF) * (-1 if inverted else 1)
    floor = max(NOISE_GREY, LIMITS.read.least_contrast * float(np.median(np.abs(contrast))))
    return bool(((contrast > floor).mean(axis=1) > HALF).all())


@lru_cache(maxsize=4096)
def chance(read: int, wrong: int, tries: int) -> float:
    """Probability that so many cells of a random quad disagree with one of so many codes in so few, or fewer.

    A bound where it is small: tries are added up.
    """
    return tries * sum(math.comb(read, k) for k in range(wrong + 1)) / 2.0**read


@dataclass(frozen=True, slots=True, eq=False)
class _Codes:
    """Codes of one family, each turned counter-clockwise by 0 to 3 quarters: `k` in all.

    Attributes:
        ids: of the codes, each for four turns.
        bits: which cells are white, border included `(k, n, n)`.
        seen: which have nothing on them `(k, n, n)`.
    """

    ids: list[int]
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
        self._codes: dict[str, _Codes] = {}
        for name, ids in ((name, sorted(ids)) for name, ids in whitelist.items() if ids):
            bits = np.array([cells(name, tag_id) > 0 for tag_id in ids])
            seen = np.array([~covered.get((name, k), np.zeros_like(bits[0])) for k in ids])
            self._codes[name] = _Codes(ids, *(_turned(of) for of in (bits, seen)))
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
                white, black = np.abs(share - 1) < LEVEL, np.abs(share) < LEVEL
                known = (white | black) & codes.seen
                wrong = known & (white != codes.bits)
                # The border is the same in all codes.
                read, wrong = (np.count_nonzero(of[:, 1:-1, 1:-1], axis=(1, 2)) for of in (known, wrong))
                tries = READINGS * len(read)
                chances = [chance(*pair, tries) for pair in zip(read.tolist(), wrong.tolist(), strict=True)]
                best = int(np.argmin(chances))
                if chances[best] <= LIMITS.read.max_chance:
                    k, quarters = divmod(best, TURNS)
                    margin, corners = _margin(pixels, homography, n), np.roll(quad, quarters, axis=0)
                    one = Detection(name, codes.ids[k], int(wrong[best]), margin, corners)
                    found.append((chances[best], one))
        return min(found, key=lambda one: one[0])[1] if found else None


def read_code(pixels: Grey, corners: Array, family: str, tag_id: int) -> tuple[int, float]:
    """Wrong data bits of a code in a quad `(4, 2)` TL, TR, BR, BL [px], and their mean margin [grey]."""
    n = find_family(family).black_cells
    homography = image_from_cells(corners, n)
    wrong = (_levels(pixels, homography, n)[0] > HALF) != (cells(family, tag_id) > 0)
    return int(np.count_nonzero(wrong[1:-1, 1:-1])), _margin(pixels, homography, n)


def _margin(pixels: Grey, homography: Array, n: int) -> float:
    """Mean distance of black and white from the threshold between them [grey]; beside a tag a quad has little."""
    return HALF * float(rim_steps(pixels, homography, n).mean())


def _turned(codes: Bools) -> Bools:
    """Cells `(k, n, n)` turned by 0 to 3 quarters `(4 * k, n, n)`."""
    turned = np.stack([np.rot90(codes, quarters, axes=(1, 2)) for quarters in range(TURNS)], axis=1)
    return turned.reshape(-1, *codes.shape[1:])


def _levels(pixels: Grey, homography: Array, n: int) -> Array:
    """White share of cells `(1, n, n)`: 0 as the border, 1 as the paper."""
    values = cell_values(pixels, homography, n)
    paper, ink = (np.median(values[_layers(n + 2) == k]) for k in (0, 1))
    return np.asarray((values[None, 1:-1, 1:-1] - ink) / max(paper - ink, LEAST_GREY))


def _steps(pixels: Grey, homography: Array, n: int, codes: _Codes) -> Array:
    """White share of cells `(k, n, n)` by the steps from their outer neighbours.

    Beside a black neighbour of grey value b a cell has b when it is black, and the least of b + contrast and 255 when
    it is white; beside a white one b - contrast and b. One blown neighbour of a white cell is as good as any; a cell
    that is blown beside one tells nothing. Cells without a line that tells have one half.
    """
    contrast = max(float(np.median(rim_steps(pixels, homography, n))), LEAST_GREY)
    outer, of_cell, points = _lines(n)
    here, there = sample(pixels, carry(homography, points)).reshape(2, -1, len(ALONG)).mean(axis=2)
    least = LIMITS.read.faint * contrast
    room = np.minimum(there + contrast, BRIGHTEST) - there
    by_black = np.where(room < least, 0.0, (here - there) / np.maximum(room, 1.0) - 0.5)
    by_white = 0.5 + (here - there) / contrast
    blown = there >= LIMITS.read.saturated
    by_white[blown] = np.where(here[blown] < BRIGHTEST - least, -0.5, 0.0)
    white, seen = (of.reshape(len(of), -1)[:, outer] for of in (codes.bits, codes.seen))
    votes = np.where(white, by_white, by_black).clip(-0.5, 0.5) * seen
    lines = (votes != 0).astype(np.float64) @ of_cell
    share: Array = 0.5 + (votes @ of_cell) / np.maximum(lines, 1.0)
    return share.reshape(-1, n, n)


@lru_cache(maxsize=32)
def _layers(n: int) -> npt.NDArray[np.intp]:
    """How many cells lie between each of `(n, n)` and the rim."""
    away = np.minimum(np.arange(n), np.arange(n)[::-1])
    return np.minimum.outer(away, away)


@lru_cache(maxsize=32)
def _lines(n: int) -> tuple[npt.NDArray[np.intp], Array, Array]:
    """The `m` lines between neighbouring cells of a tag of `n` cells a side, in cell coordinates.

    Every line counts for one of its cells, the inner one, so that a cell says no more than one bit.

    Returns:
        The other cell of each line, row by row `(m,)`; whether a line counts for a cell `(m, n * n)`; samples
        beside the lines, those in inner cells first `(2 * m * 3, 2)`.
    """
    index, layer = np.arange(n * n).reshape(n, n), _layers(n).ravel()
    beside, below = (index[:, :-1], index[:, 1:]), (index[:-1], index[1:])
    pairs = np.concatenate([np.stack(two, axis=-1).reshape(-1, 2) for two in (beside, below)])
    pairs = np.where(np.diff(layer[pairs]) < 0, pairs, pairs[:, ::-1])
    cell, outer = pairs[layer[pairs[:, 0]] > 0].T
    middle = np.column_stack(np.divmod(np.arange(n * n), n)[::-1]) + 0.5
    across = middle[cell] - middle[outer]
    line = (middle[cell] + middle[outer]) / 2
    spread = np.array(ALONG)[:, None] * across[:, None, ::-1]
    points = [(line + away * across)[:, None] + spread for away in (STEP_CELLS, -STEP_CELLS)]
    return outer, (cell[:, None] == np.arange(n * n)).astype(np.float64), np.concatenate(points).reshape(-1, 2)
