"""The image as a search sees it: other tones for shadows, tone curves and highlights."""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt

from mkdaemon.vision.limits import LIMITS, Stage

Grey = npt.NDArray[np.uint8]

_LOG_LUT: Grey = np.round(100 + 14 * (np.log10(np.arange(256) + 4.0) - np.log10(64.0))).clip(0, 255).astype(np.uint8)
"""Compresses bright and dark halves of a shadow to equal steps; 14 levels a decade merge texture below a real edge."""

_LIGHT_LUT: Grey = np.round(255 * (np.arange(256) / 255) ** LIMITS.search.tone).astype(np.uint8)
"""Light from grey values: a tone curve lets white cells spread over small black ones, which then read as white."""

_BRIGHT_LUT: Grey = np.round(255 * (np.arange(256) / 255) ** LIMITS.search.highlight).astype(np.uint8)
"""Spreads the brightest grey values: ink in a highlight is nearly as bright as paper beside it."""


def prepare(pixels: Grey, stage: Stage) -> npt.NDArray[np.generic]:
    """The image a stage searches `(h, w)`, 8 bits.

    Args:
        pixels: `(h, w)` uint8.
        stage: how it is searched.
    """
    if stage in ("log", "halflog"):
        return cv2.LUT(pixels, _LOG_LUT)
    if stage == "linear":
        return cv2.LUT(pixels, _LIGHT_LUT)
    if stage == "bright":
        return cv2.LUT(pixels, _BRIGHT_LUT)
    if stage == "equalised":
        tiles = [max(round(length / LIMITS.search.tile_px), 2) for length in (pixels.shape[1], pixels.shape[0])]
        return cv2.createCLAHE(4.0, (tiles[0], tiles[1])).apply(pixels)
    return pixels
