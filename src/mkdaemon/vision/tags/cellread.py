"""Tags found in an image: the cells of a quad are read, and chance has to explain hardly what they say.

A highlight lifts ink above the paper elsewhere, but leaves the step between ink and paper beside it. So a cell is
compared with its neighbours; what is blown on both sides says nothing.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Final, Literal

import cv2
import numpy as np
import numpy.typing as npt

from mkdaemon.vision.arrays import Array, Bools, Grey
from mkdaemon.vision.camera.image import BRIGHTEST
from mkdaemon.vision.limits import HALF, LIMITS, NOISE_GREY
from mkdaemon.vision.tags.tagfamily import cells, find_family, middles, to_rim

View = Literal["grey", "light", "log", "outline"]
"""What a search for tags sees: an image in one of three tones, or its broken outlines."""
Covered = Mapping[tuple[str, int], Bools]
"""Cells `(n, n)` of tags, by family and id, that say nothing."""

TURNS = 4
"""Of a quad: chance has as many tries with each code."""
SIDE_CELLS: Final = 0.3
"""How far from a side of a whole quad paper and ink are looked for [cells]."""
CLEAR: Final = HALF / 2
"""Of a contrast, from the middle, beyond which a cell is black or white: half way to what is neither."""
LEAST_GREY: Final = NOISE_GREY / CLEAR
"""Contrast below which noise alone can make a cell neither [grey]."""
STEP_CELLS: Final = 0.15
"""How far on both sides of a line its step is sampled, before light changes much [cells]."""
ALONG = (-0.3, 0.0, 0.3)
"""Where a step is sampled along the line [cells]."""


@dataclass(frozen=True, slots=True, eq=False)
class Detection:
    """A decoded tag in one image.

    Attributes:
        family: tag family.
        tag_id: code.
        hamming: corrected bits.
        decision_margin: mean distance of the bits from the threshold [grey].
        corners: `(4, 2)` TL, TR, BR, BL of the official print [px, centres at integers].
        view: in which it was found.
        shrunk: factor by which the image was reduced to find the corners; their uncertainty grows by it.
    """

    family: str
    tag_id: int
    hamming: int
    decision_margin: float
    corners: Array
    view: View = "grey"
    shrunk: int = 1

    @property
    def code(self) -> tuple[str, int]:
        """Family and id."""
        return self.family, self.tag_id

    @property
    def side_px(self) -> float:
        """Mean side [px]."""
        return mean_side(self.corners)


def mean_side(corners: Array) -> float:
    """Mean side of a quad `(4, 2)`, in the unit of its corners."""
    return float(np.linalg.norm(corners - np.roll(corners, 1, axis=0), axis=1).mean())


def best_of_codes(found: Iterable[Detection]) -> list[Detection]:
    """Of the detections of each code the one with the fewest wrong bits, of those the clearest."""
    best: dict[tuple[str, int], Detection] = {}
    for one in found:
        best[one.code] = min(best.get(one.code, one), one, key=lambda tag: (tag.hamming, -tag.decision_margin))
    return list(best.values())


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
    return np.asarray(carried[..., :2] / carried[..., 2:])


def rim_steps(pixels: Grey, homography: Array, n: int, depth: float) -> Array:
    """Contrast of paper and ink along the sides of a black square `(4, 2 * n)`, `depth` cells away [grey]."""
    paper, ink = sample(pixels, carry(homography, _rims(n, depth))).reshape(2, 4, -1)
    return np.asarray(paper - ink)


@lru_cache(maxsize=32)
def _rims(n: int, depth: float) -> Array:
    """Points outside a square of `n` cells, then inside: top, right, bottom, left `(2 * 4 * 2 n, 2)` [cells]."""
    along = (np.arange(2 * n) + 0.5) / 2
    sides = (((along, -d), (n + d, along), (along, n + d), (-d, along)) for d in (depth, -depth))
    return np.concatenate([np.stack(np.broadcast_arrays(x, y), axis=-1) for four in sides for x, y in four])


def has_sides(pixels: Grey, corners: Array, n: int, *, inverted: bool) -> bool:
    """Whether all four sides of a quad have white right outside and black inside; `inverted` the other way round."""
    # Both are taken from beside each other, so that shadows do not count against a side.
    contrast = rim_steps(pixels, image_from_cells(corners, n), n, SIDE_CELLS) * (-1 if inverted else 1)
    floor = max(NOISE_GREY, LIMITS.read.least_contrast * float(np.median(np.abs(contrast))))
    return bool(((contrast > floor).mean(axis=1) > HALF).all())


@lru_cache(maxsize=4096)
def chance(read: int, wrong: int, tries: int) -> float:
    """Bound of the probability that at most `wrong` of `read` cells of a random quad differ from one of the codes."""
    # P(X <= wrong) of X ~ Bin(read, 1/2), times the codes that are tried: the bound of Boole.
    return tries * sum(math.comb(read, k) for k in range(wrong + 1)) / 2.0**read


@dataclass(frozen=True, slots=True, eq=False)
class _Codes:
    """Ids of a family, and of each turned by 0 to 3 quarters the cells that are white and seen `(4 * k, n * n)`."""

    ids: list[int]
    bits: Bools
    seen: Bools


class CodeReader:
    """Reads quads against the codes of a whitelist.

    Args:
        whitelist: ids by family.
        covered: cells of a code that another tag lies on, which say nothing.

    Attributes:
        sizes: cells along the black squares of its families.
    """

    def __init__(self, whitelist: Mapping[str, frozenset[int]], covered: Covered) -> None:
        self._codes: dict[str, _Codes] = {}
        for name, ids in ((name, sorted(ids)) for name, ids in whitelist.items() if ids):
            bits = np.array([cells(name, tag_id) > 0 for tag_id in ids])
            seen = np.array([~covered.get((name, k), np.zeros_like(bits[0])) for k in ids])
            turned = [np.rot90((bits, seen), quarters, axes=(2, 3)) for quarters in range(TURNS)]
            self._codes[name] = _Codes(ids, *np.stack(turned, axis=2).reshape(2, len(ids) * TURNS, -1))
        self.sizes = sorted({find_family(name).black_cells for name in self._codes})

    def read(self, pixels: Grey, quads: Iterable[Array]) -> list[Detection]:
        """The codes that the readable cells of quads agree with, the clearest of each.

        Args:
            pixels: `(h, w)` uint8.
            quads: corners of black squares, clockwise in the image `(4, 2)` [px].
        """
        read = (self._explain(pixels, quad, *of) for quad in quads for of in self._codes.items())
        return best_of_codes(found for by_chance, found in read if by_chance <= LIMITS.read.max_chance)

    def _explain(self, pixels: Grey, quad: Array, name: str, codes: _Codes) -> tuple[float, Detection]:
        """The likeliest code of a family, and the probability that chance reads as well."""
        n = find_family(name).black_cells
        homography = image_from_cells(quad, n)
        steps = rim_steps(pixels, homography, n, STEP_CELLS)
        votes = _votes(pixels, homography, max(float(np.median(steps)), LEAST_GREY), codes)
        known = (np.abs(votes) > CLEAR) & codes.seen
        wrong = known & ((votes > 0) != codes.bits)
        read, misread = (np.count_nonzero(of, axis=1).tolist() for of in (known, wrong))
        chances = [chance(*pair, len(read)) for pair in zip(read, misread, strict=True)]
        best = int(np.argmin(chances))
        k, quarters = divmod(best, TURNS)
        # The threshold between black and white is half a step away; beside a tag a quad has little.
        margin = HALF * float(steps.mean())
        found = Detection(name, codes.ids[k], misread[best], margin, np.roll(quad, quarters, axis=0))
        return chances[best], found


def _votes(pixels: Grey, homography: Array, contrast: float, codes: _Codes) -> Array:
    """Whether cells are white `(k, n * n)`, -0.5 to 0.5, by the steps from their outer neighbours; 0 of the border.

    Beside a black neighbour of grey value b a cell has b when it is black, and the least of b + contrast and 255 when
    it is white; beside a white one b - contrast and b.
    """
    # Each line between two cells is one vote: v = (step to the inner cell) / (step expected for white) - 1/2. Comparing
    # neighbours makes the vote independent of light that changes over the tag.
    outer, of_cell, points = _lines(math.isqrt(codes.bits.shape[1]))
    here, there = sample(pixels, carry(homography, points)).reshape(2, -1, len(ALONG)).mean(axis=2)
    least = LIMITS.read.faint * contrast
    room = np.minimum(there + contrast, BRIGHTEST) - there
    by_black = np.where(room < least, 0.0, (here - there) / np.maximum(room, 1.0) - HALF)
    by_white = HALF + (here - there) / contrast
    blown = there >= LIMITS.read.saturated
    by_white[blown] = np.where(here[blown] < BRIGHTEST - least, -HALF, 0.0)
    votes = np.where(codes.bits[:, outer], by_white, by_black).clip(-HALF, HALF) * codes.seen[:, outer]
    lines = (votes != 0).astype(np.float64) @ of_cell
    return np.asarray(votes @ of_cell / np.maximum(lines, 1.0))


@lru_cache(maxsize=32)
def _lines(n: int) -> tuple[npt.NDArray[np.intp], Array, Array]:
    """Of the `m` lines between neighbouring cells of a tag the outer cell `(m,)`, and whether one counts for a cell.

    Only for the inner one `(m, n * n)`. And samples on both sides, those in inner cells first `(2 * m * 3, 2)` [cells].
    """
    # All pairs of neighbours, across and down; of each pair the cell nearer to the rim is the outer one.
    index, inside = np.arange(n * n).reshape(n, n), to_rim(n).ravel()
    beside, below = (index[:, :-1], index[:, 1:]), (index[:-1], index[1:])
    first, second = (np.concatenate([of.ravel() for of in one]) for one in zip(beside, below, strict=True))
    both = np.where(inside[second] < inside[first], (first, second), (second, first))
    cell, outer = both[:, inside[both[0]] > 0]
    middle = middles(n)
    across, line = middle[cell] - middle[outer], (middle[cell] + middle[outer]) / 2
    spread = np.array(ALONG)[:, None] * across[:, None, ::-1]
    points = [(line + side * across)[:, None] + spread for side in (STEP_CELLS, -STEP_CELLS)]
    return outer, (cell[:, None] == index.ravel()).astype(np.float64), np.concatenate(points).reshape(-1, 2)
