"""A tag found in an image, and what a search has to offer."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
import numpy.typing as npt

from mkdaemon.vision.limits import Stage

Array = npt.NDArray[np.float64]
Grey = npt.NDArray[np.uint8]

__all__ = ["Detection", "Search", "Stage"]


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
        shrunk: by how much the image was shrunk for it; corners are so much looser.
    """

    family: str
    tag_id: int
    hamming: int
    decision_margin: float
    corners: Array
    stage: Stage
    shrunk: int = 1

    @property
    def side_px(self) -> float:
        """Mean side [px]."""
        return float(np.linalg.norm(self.corners - np.roll(self.corners, 1, axis=0), axis=1).mean())


class Search(Protocol):
    """One way of finding quads and codes."""

    def find(self, pixels: Grey, stage: Stage) -> list[Detection]:
        """Find all codes in `(h, w)` uint8, unchecked."""
