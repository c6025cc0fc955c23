"""The texture of a print, soft enough for the sub-samples it is looked up at.

A sharp edge that is looked up at points lies where the nearest point is: an edge along a row of pixels was drawn up to
0.08 px beside its place, the whole of it alike. A blur that belongs to the point spread anyway takes that away.

Source: mip maps, Williams, SIGGRAPH 1983; a Gaussian in place of the box.
"""

from __future__ import annotations

from typing import Final

import cv2
import numpy as np
import numpy.typing as npt

Image32 = npt.NDArray[np.float32]

SOFT: Final = 0.5
"""Deviation of the blur [sub-samples]: 1 % is left of what repeats from one to the next."""
LEVELS_PER_OCTAVE: Final = 2
SMALLEST: Final = 24
"""Texels across the coarsest level."""


class PrintTexture:
    """A drawn print and its softer levels, each made when it is first asked for.

    Args:
        drawn: `(side, side)`, 0 black to 1 white.
    """

    def __init__(self, drawn: Image32) -> None:
        self._drawn = drawn
        self._levels: dict[int, Image32] = {}
        self._softest = LEVELS_PER_OCTAVE * int(np.log2(max(len(drawn) // SMALLEST, 1)))

    def level(self, step: float) -> tuple[Image32, float]:
        """The level for sub-samples some texels of the drawn print apart, and its blur [texels of the drawn print].

        Levels have at least two texels from one sub-sample to the next, as far as the drawn print has.

        Args:
            step: between neighbouring sub-samples, along the way in which it is longer [texels].
        """
        number = round(LEVELS_PER_OCTAVE * float(np.log2(max(step, 1e-6))))
        if number < 0:
            return self._drawn, 0.0
        number = min(number, self._softest)
        blur = SOFT * 2.0 ** (number / LEVELS_PER_OCTAVE)
        found = self._levels.get(number)
        if found is None:
            soft = cv2.GaussianBlur(self._drawn, (0, 0), blur, borderType=cv2.BORDER_REPLICATE)
            side = len(soft) // max(2 ** (number // LEVELS_PER_OCTAVE - 1), 1)
            found = np.asarray(cv2.resize(soft, (side, side), interpolation=cv2.INTER_AREA), dtype=np.float32)
            self._levels[number] = found
        return found, blur
