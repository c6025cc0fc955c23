"""The point spread of an image: round, or a round one with the even streak of a motion."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
import numpy.typing as npt

from mkdaemon.vision.pose.printimage import FINE

Array = npt.NDArray[np.float64]
Image32 = npt.NDArray[np.float32]

REACH: Final = 3
"""Deviations of the point spread that are rendered around a print."""
BOX: Final = 12.0
"""Square of a box's length over its variance: what motion blur adds is a box."""
LEAST_STREAK_PX: Final = 0.3
"""Shorter streaks are rendered as round [px]."""
SHORT_STREAK: Final = 8.0
"""Of which a longer one is put together [sub-samples]: with a kernel of 11 x 11."""
LEAST_PX: Final = 0.1
"""Deviation that is rendered at least [px]."""


@dataclass(frozen=True, slots=True, eq=False)
class PointSpread:
    """A point spread.

    Attributes:
        narrow: deviation across its longer axis [px].
        streak: even motion along that axis `(2,)` [px].
    """

    narrow: float
    streak: Array

    @classmethod
    def of(cls, spread: Array) -> PointSpread:
        """From its covariance `(2, 2)` [px^2]."""
        values, vectors = np.linalg.eigh(spread)
        length = float(np.sqrt(BOX * (values[1] - values[0])))
        return cls(float(np.sqrt(values[0])), length * vectors[:, 1])

    @property
    def pad(self) -> int:
        """How far it carries light [px]."""
        return int(np.ceil(REACH * self.narrow + float(np.linalg.norm(self.streak)) / 2)) + 2

    def blurred(self, fine: Image32, soft_px: float) -> Image32:
        """What pixels see of an image of `FINE` sub-samples a pixel that has a blur of its own [px] in it."""
        rest = float(np.sqrt(max(self.narrow**2 - soft_px**2, LEAST_PX**2)))
        image = np.asarray(cv2.GaussianBlur(fine, (0, 0), rest * FINE), dtype=np.float32)
        if float(np.linalg.norm(self.streak)) > LEAST_STREAK_PX:
            image = _streaked(image, FINE * self.streak)
        return np.asarray(cv2.blur(image, (FINE, FINE)), dtype=np.float32)


def _streaked(fine: Image32, way: Array) -> Image32:
    """An image after an even, centred motion along `way` `(2,)` [sub-samples].

    A long streak is a short one at several places: filters of 13 x 13 and more go through a Fourier transform.
    """
    length = float(np.linalg.norm(way))
    parts = int(np.ceil(length / SHORT_STREAK))
    short = np.asarray(cv2.filter2D(fine, -1, _kernel(way / parts, 4 * int(np.ceil(length / parts)) + 1)), np.float32)
    if parts == 1:
        return short
    places = _kernel(way, parts)
    (height, width), reach = fine.shape, len(places) // 2
    around = cv2.copyMakeBorder(short, reach, reach, reach, reach, cv2.BORDER_REPLICATE)
    moved = np.zeros_like(fine)
    for down, right in np.argwhere(places).tolist():
        part = around[down : down + height, right : right + width]
        cv2.scaleAdd(part, float(places[down, right]), moved, moved)
    return moved


def _kernel(way: Array, count: int) -> Image32:
    """Kernel of so many places, evenly along `way` `(2,)` about its middle [sub-samples]."""
    reach = int(np.ceil(np.abs(way).max() / 2)) + 1
    at = ((np.arange(count) + 0.5) / count - 0.5)[:, None] * way + reach
    first = np.floor(at).astype(np.intp)
    right, down = (at - first).T
    kernel = np.zeros((2 * reach + 1, 2 * reach + 1))
    for y, below in ((0, 1.0 - down), (1, down)):
        for x, beside in ((0, 1.0 - right), (1, right)):
            np.add.at(kernel, (first[:, 1] + y, first[:, 0] + x), below * beside)
    return (kernel / count).astype(np.float32)
