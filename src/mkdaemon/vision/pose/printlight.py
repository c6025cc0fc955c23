"""The light on a print: black, white, how it changes over the print, and the tone curve of the camera."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Final

import numpy as np
import numpy.typing as npt

from mkdaemon.vision.limits import ReadLimits
from mkdaemon.vision.pose.printimage import PrintSamples

Array = npt.NDArray[np.float64]

LIGHTS: Final = 10
"""Unknowns: white over black, black, two gradients, three of the tone curve, three of a highlight's slope."""
ROUNDS: Final = 3
"""Of telling which pixels are blown, each by the light on the others (two give the same to 1 %)."""
RIDGE: Final = 1e-6
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
    def of(cls, at: PrintSamples, columns: Array) -> Lit:
        """Light by least squares at the present pose and blur.

        Args:
            at: the print's pixels.
            columns: what each unknown adds to them `(10, n)`.
        """
        gain = _gain(columns, at.grey)
        tone = at.value * (1.0 - at.value)
        contrast = gain[0] + gain[4] * (1.0 - 2.0 * at.value) + gain[5] * (1.0 - 6.0 * tone)
        return cls(columns, gain, contrast + gain[6] * (TOE_GAIN / (TOE + at.value) - 1.0))


def lit_print(at: PrintSamples, half: float, limits: ReadLimits) -> tuple[PrintSamples, Lit]:
    """The light on a print, and its pixels without those that should be blown: they may have been anything.

    What should be blown is told by the light on the other pixels. Under a highlight that is more than black and white:
    its slope lifts the ink by half of the contrast, and edges are blown from differing places on. Pixels that should
    be nearly blown are left out whether they are or not; without the blown ones alone the others would be too dark by
    their noise. A blown pixel that should be dark stays, as a dark one that should be blown, and speaks against the
    pose. Where nothing is blown there is no highlight, and slopes are even: ground beside its shadow would look like a
    print with some light on it.

    Args:
        at: all pixels of a print.
        half: half the side of its paper [m].
        limits: from where a pixel is blown, or nearly.
    """
    keep = at.grey < limits.saturated
    if bool(keep.all()):
        return at, Lit.of(at, _columns(at, half, is_highlit=False))
    columns, dark = _columns(at, half, is_highlit=True), at.grey < limits.saturated - 2.0 * limits.nearly_blown
    for _ in range(ROUNDS):
        shown = _gain(columns[:, keep], at.grey[keep]) @ columns
        keep = dark | (shown < limits.saturated - limits.nearly_blown)
    used = at.used.copy()
    used[at.used] = keep
    kept = PrintSamples(
        **{part.name: getattr(at, part.name)[keep] for part in fields(at) if part.name != "used"}, used=used
    )
    return kept, Lit.of(kept, columns[:, keep])


def _columns(at: PrintSamples, half: float, *, is_highlit: bool) -> Array:
    """What each unknown of the light adds to each pixel `(10, n)`; nothing for those that are not asked."""
    columns = np.zeros((LIGHTS, at.value.size))
    u, v = at.u / half, at.v / half
    tone = at.value * (1.0 - at.value)
    curve = tone, tone * (1.0 - 2.0 * at.value), TOE_GAIN * np.log1p(at.value / TOE) - at.value
    columns[:7] = at.value, np.ones_like(u), u, v, *curve
    if is_highlit:
        columns[7:] = u * u, u * v, v * v
    return columns


def _gain(columns: Array, grey: Array) -> Array:
    """The light that explains grey values best `(10,)`."""
    return np.asarray(np.linalg.solve(columns @ columns.T + RIDGE * np.eye(LIGHTS), columns @ grey), np.float64)
