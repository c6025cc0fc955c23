"""Reading the cells of a known tag from an image: codes, quiet zones and how well a pose explains them."""

from __future__ import annotations

from functools import lru_cache

import cv2
import numpy as np
import numpy.typing as npt

from mkdaemon.vision.limits import HALF, LIMITS, NOISE_GREY
from mkdaemon.vision.tags.tagfamily import cells

Array = npt.NDArray[np.float64]
Grey = npt.NDArray[np.uint8]

QUIET_DEPTHS = (0.5, 0.3)
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
    """Map `(n, 2)` points."""
    carried = points @ homography[:, :2].T + homography[:, 2]
    mapped: Array = carried[:, :2] / carried[:, 2:]
    return mapped


@lru_cache(maxsize=16)
def _grid(n: int) -> Array:
    """Centres of all cells row by row `(n * n, 2)`."""
    row, column = np.divmod(np.arange(n * n), n)
    return np.column_stack([column + 0.5, row + 0.5])


@lru_cache(maxsize=16)
def _rims(n: int, depth: float = 0.5) -> tuple[Array, Array]:
    """Samples `depth` cells outside and half a cell inside top, right, bottom, left: `(4, 2 * n, 2)` each."""
    along = (np.arange(2 * n) + 0.5) / 2
    half = np.full_like(along, 0.5)
    away = np.full_like(along, depth)
    outside = np.stack(
        [
            np.column_stack([along, -away]),
            np.column_stack([n + away, along]),
            np.column_stack([along, n + away]),
            np.column_stack([-away, along]),
        ]
    )
    inside = np.stack(
        [
            np.column_stack([along, half]),
            np.column_stack([n - half, along]),
            np.column_stack([along, n - half]),
            np.column_stack([half, along]),
        ]
    )
    return outside, inside


def read_code(pixels: Grey, corners: Array, family: str, tag_id: int, n: int) -> tuple[int, float]:
    """Compare an image region with a code.

    Args:
        pixels: `(h, w)` uint8.
        corners: `(4, 2)` TL, TR, BR, BL [px].
        family: tag family.
        tag_id: expected code.
        n: cells along the black square.

    Returns:
        Wrong data bits and the mean distance of the bits from the threshold [grey].
    """
    values = sample(pixels, carry(image_from_cells(corners, n), _grid(n))).reshape(n, n)
    known = cells(family, tag_id) > 0
    data = values[1:-1, 1:-1]
    bits = known[1:-1, 1:-1]
    rim = np.concatenate([values[0], values[-1], values[1:-1, 0], values[1:-1, -1]])
    outside = sample(pixels, carry(image_from_cells(corners, n), _rims(n)[0].reshape(-1, 2)))
    threshold = (float(np.median(rim)) + float(np.median(outside))) / 2
    signed = np.where(bits, data - threshold, threshold - data)
    return int((signed < 0).sum()), float(np.abs(signed).mean())


def quiet_sides(pixels: Grey, corners: Array, n: int, *, inverted: bool = False) -> int:
    """Count the sides of a quad that have a white surround and a black border `(0..4)`; `inverted` the other way round.

    A quad whose side is the edge of something lying over the tag has grey or mixed cells there. White and black are
    taken per side from its own neighbourhood, so shadow edges and gradients do not count against a side. White has to
    begin right outside the quad: one whose side was cut by the image edge has black left there.
    """
    homography = image_from_cells(corners, n)
    black = sample(pixels, carry(homography, _rims(n)[1].reshape(-1, 2))).reshape(4, -1)
    quiet = np.ones(4, dtype=bool)
    for depth in QUIET_DEPTHS:
        white = sample(pixels, carry(homography, _rims(n, depth)[0].reshape(-1, 2))).reshape(4, -1)
        contrast = black - white if inverted else white - black
        floor = max(NOISE_GREY, LIMITS.read.least_contrast * float(np.median(np.abs(contrast))))
        quiet &= (contrast > floor).mean(axis=1) > HALF
    return int(quiet.sum())
