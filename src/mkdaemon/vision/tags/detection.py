"""A tag found in an image."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from mkdaemon.vision.arrays import Array

View = Literal["grey", "light", "log", "outline"]
"""What a search for tags sees: an image in one of three tones, or its broken outlines."""


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
        shrunk: by how much the image was shrunk for its corners, which are so much looser.
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
