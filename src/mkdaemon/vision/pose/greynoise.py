"""The noise of grey values after a fit: how it depends on brightness, and over how many pixels it is shared."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from mkdaemon.vision.pose.pose import median

Array = npt.NDArray[np.float64]

DARK, BRIGHT = 0.3, 0.7
"""Values of the model whose residuals give the noise of black and of white."""
LEAST_PIXELS = 20
"""That tell a noise."""
LEAST_SCATTER = 0.5
"""Of pixels that are rounded to grey values."""
MOST_RATIO = 5.0
"""Of the noise of black and white."""
MOST_SHARED = 0.7
"""Correlation of neighbouring residuals, at most."""


def clarity(residual: Array, value: Array) -> Array:
    """By how much a pixel is less noisy than the mean one `(n,)`: a tone curve spreads the noise of dark pixels.

    Args:
        residual: of each pixel `(n,)` [grey].
        value: of the model there, 0 black to 1 white `(n,)`.
    """
    dark, bright = np.abs(residual[value < DARK]), np.abs(residual[value > BRIGHT])
    if min(dark.size, bright.size) < LEAST_PIXELS:
        return np.ones_like(value)
    ratio = max(median(dark), LEAST_SCATTER) / max(median(bright), LEAST_SCATTER)
    ratio = float(np.clip(ratio, 1.0 / MOST_RATIO, MOST_RATIO))
    clear: Array = 1.0 / (ratio + (1.0 - ratio) * value)
    return np.asarray(clear / np.sqrt(np.mean(clear**2)))


def shared_by(residual: Array, used: npt.NDArray[np.bool_]) -> float:
    """By how much noise that neighbours share raises the variance of a fit, 1 or more.

    Demosaicing, denoising and what the model lacks are shared. Where the correlation falls by r from a pixel to the
    next, the variance of a mean is (1 + r) / (1 - r) times that of independent pixels, each way; edges, which change
    over a few pixels, suffer less: (1 + r) / sqrt(1 - r), by the NEES of 80 development images (0.66 to 1.19).

    Args:
        residual: of each used pixel `(n,)`.
        used: which pixels of a window these are `(rows, columns)`.
    """
    image = np.zeros(used.shape)
    image[used] = residual
    total = max(float(residual @ residual), LEAST_SCATTER)
    factor = 1.0
    for one, neighbour in ((image[:, 1:], image[:, :-1]), (image[1:], image[:-1])):
        r = float(np.clip((one * neighbour).sum() / total, 0.0, MOST_SHARED))
        factor *= (1.0 + r) / float(np.sqrt(1.0 - r))
    return factor
