"""The light on a print: black, white, their gradients over it, and the tone curve of the camera."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Final

import numpy as np
import numpy.typing as npt

from mkdaemon.vision.pose.printimage import PrintSamples

Array = npt.NDArray[np.float64]

LIGHTS: Final = 7
"""Unknowns: white over black, black, two gradients, three of the tone curve."""
TOE: Final = 0.05
"""Light of ink over that of paper: where a tone curve lifts the dark. With a logarithm from there the model follows a
gamma of 1.6 to 2.2 to 0.3 % of the contrast, a cubic polynomial alone to 0.7-3.4 % (ink 0.03 to 0.1)."""
TOE_GAIN: Final = 1.0 / float(np.log1p(1.0 / TOE))


@dataclass(frozen=True, slots=True, eq=False)
class Lit:
    """The model of the grey values: I = gain . columns, and what a change of the print changes in it."""

    columns: Array
    gain: Array
    contrast: Array

    @classmethod
    def of(cls, at: PrintSamples, half: float) -> Lit:
        """Light by least squares at the present pose and blur."""
        tone = at.value * (1.0 - at.value)
        skew = 1.0 - 2.0 * at.value
        lifted = TOE_GAIN * np.log1p(at.value / TOE) - at.value
        columns = np.stack([at.value, np.ones_like(at.value), at.u / half, at.v / half, tone, tone * skew, lifted])
        gain = np.asarray(np.linalg.solve(columns @ columns.T + 1e-6 * np.eye(LIGHTS), columns @ at.grey), np.float64)
        contrast = gain[0] + gain[4] * skew + gain[5] * (1.0 - 6.0 * tone)
        return cls(columns, gain, contrast + gain[6] * (TOE_GAIN / (TOE + at.value) - 1.0))


def without_blown(at: PrintSamples, saturated: int) -> PrintSamples:
    """The samples without pixels that are blown and should be: they may have been anything.

    A blown pixel that should be dark stays, and speaks against the pose. Which should be is told by a straight line
    from the pixels that are not blown; clipped paper would be a white that ends before its edge does.

    Args:
        at: all pixels of a print.
        saturated: grey value of a blown pixel.
    """
    blown = at.grey >= saturated
    if not bool(blown.any()):
        return at
    line = np.stack([at.value, np.ones_like(at.value)])
    seen = line[:, ~blown]
    gain = np.linalg.solve(seen @ seen.T + 1e-6 * np.eye(len(seen)), seen @ at.grey[~blown])
    keep = ~blown | (gain @ line < saturated)
    used = at.used.copy()
    used[at.used] = keep
    kept = {part.name: getattr(at, part.name)[keep] for part in fields(at) if part.name != "used"}
    return PrintSamples(**kept, used=used)
