"""A camera's tone curve taken back: grey values in proportion to light, where edges blur evenly."""

from __future__ import annotations

from typing import Final

import cv2
import numpy as np
import numpy.typing as npt

Grey = npt.NDArray[np.uint8]

WHITE: Final = 225.0
"""Grey value that the brightest pixel of an image gets, so that a dark image keeps its steps.

A percentile would not do: the paper of a far target is less than 0.5 % of the image, and was clipped to white.
"""
DARKEST: Final = 30.0
"""The brightest pixel is taken to be at least this bright [grey]."""
SATURATED: Final = 253
"""From here up a pixel may have been anything, and stays so."""


def in_light(pixels: Grey, gamma: float) -> Grey:
    """Grey values `(h, w)` of an image as its sensor saw it, where grey is light to the power 1 / gamma."""
    if gamma == 1.0:
        return pixels
    bright = max(float(pixels[::4, ::4].max()), DARKEST)
    table = np.clip(WHITE * (np.arange(256) / bright) ** gamma, 0.0, 255.0).round().astype(np.uint8)
    table[SATURATED:] = 255
    return np.asarray(cv2.LUT(pixels, table), dtype=np.uint8)
