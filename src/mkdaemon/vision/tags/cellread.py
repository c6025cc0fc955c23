"""Reading the cells of a tag from an image: grey values, codes and sides."""

from __future__ import annotations

from functools import lru_cache

import cv2
import numpy as np

from mkdaemon.vision.arrays import Array, Grey
from mkdaemon.vision.limits import HALF, LIMITS, NOISE_GREY
from mkdaemon.vision.tags.tagfamily import cells, find_family

QUIET_CELLS = 0.3
"""Where the quiet zone is sampled, outside the black square [cells]."""


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


@lru_cache(maxsize=32)
def _rim(n: int, depth: float) -> Array:
    """Points `depth` cells outside the black square, inside where it is negative `(8 * n, 2)`: top, right and so on."""
    along = (np.arange(2 * n) + 0.5) / 2
    low, high = np.full_like(along, -depth), np.full_like(along, n + depth)
    sides = ((along, low), (high, along), (along, high), (low, along))
    return np.concatenate([np.column_stack(side) for side in sides])


def rim_values(pixels: Grey, homography: Array, n: int, depth: float) -> Array:
    """Grey values along top, right, bottom and left of the black square `(4, 2 * n)`.

    Args:
        pixels: `(h, w)` uint8.
        homography: see `image_from_cells`.
        n: cells along the black square.
        depth: how far outside of it, inside where negative [cells].
    """
    return sample(pixels, carry(homography, _rim(n, depth))).reshape(4, -1)


def cell_values(pixels: Grey, homography: Array, n: int) -> Array:
    """Grey values in the middles of all cells, and of those around the black square `(n + 2, n + 2)`."""
    row, column = np.divmod(np.arange((n + 2) ** 2), n + 2)
    return sample(pixels, carry(homography, np.column_stack([column, row]) - 0.5)).reshape(n + 2, n + 2)


def paper_and_ink(values: Array) -> tuple[float, float]:
    """Median of the cells around the black square, and of its border, from `cell_values` [grey]."""
    paper, ink = (
        float(np.median(np.concatenate([ring[0], ring[-1], ring[1:-1, 0], ring[1:-1, -1]])))
        for ring in (values, values[1:-1, 1:-1])
    )
    return paper, ink


def read_code(pixels: Grey, corners: Array, family: str, tag_id: int) -> tuple[int, float]:
    """Compare an image region with a code.

    Args:
        pixels: `(h, w)` uint8.
        corners: `(4, 2)` TL, TR, BR, BL [px].
        family: tag family.
        tag_id: expected code.

    Returns:
        Wrong data bits and the mean distance of the bits from the threshold [grey].
    """
    n = find_family(family).black_cells
    values = cell_values(pixels, image_from_cells(corners, n), n)
    above = values[2:-2, 2:-2] - sum(paper_and_ink(values)) / 2
    signed = np.where(cells(family, tag_id)[1:-1, 1:-1] > 0, above, -above)
    return int((signed < 0).sum()), float(np.abs(signed).mean())


def has_sides(pixels: Grey, corners: Array, n: int, *, inverted: bool) -> bool:
    """Whether all four sides of a quad have white right outside and black inside; `inverted` the other way round.

    A quad whose side is the edge of the image, or of something lying over the tag, has black or mixed cells outside.
    White and black are taken from beside each other, so shadow edges and gradients do not count against a side.
    """
    homography = image_from_cells(corners, n)
    steps = rim_values(pixels, homography, n, QUIET_CELLS) - rim_values(pixels, homography, n, -HALF)
    contrast = -steps if inverted else steps
    floor = max(NOISE_GREY, LIMITS.read.least_contrast * float(np.median(np.abs(contrast))))
    return bool(((contrast > floor).mean(axis=1) > HALF).all())
