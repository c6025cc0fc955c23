"""A tag found in an image."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from mkdaemon.vision.arrays import Array

Stage = Literal["decimate2", "decimate1", "log", "halflog", "linear", "outline"]
"""A way to search an image for tags, at half or at full resolution."""


@dataclass(frozen=True, slots=True, eq=False)
class Detection:
    """A decoded tag in one image.

    Attributes:
        family: tag family.
        tag_id: code.
        hamming: corrected bits.
        decision_margin: mean distance of the bits from the threshold [grey].
        corners: `(4, 2)` TL, TR, BR, BL of the official print [px, centres at integers].
        stage: the search that found it.
        shrunk: by how much the image was shrunk for its corners, which are so much looser.
    """

    family: str
    tag_id: int
    hamming: int
    decision_margin: float
    corners: Array
    stage: Stage = "decimate1"
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


def best_of_codes(found: Iterable[Detection], rank: Callable[[Detection], tuple[float, ...]]) -> list[Detection]:
    """Of the detections of each code the one of the highest rank, the first of equal ones."""
    best: dict[tuple[str, int], Detection] = {}
    for one in found:
        if one.code not in best or rank(one) > rank(best[one.code]):
            best[one.code] = one
    return list(best.values())
