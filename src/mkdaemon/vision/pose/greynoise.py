"""The noise of grey values after a fit: how it depends on brightness, and over how many pixels it is shared."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import sqrt

import numpy as np
import numpy.typing as npt

from mkdaemon.vision.pose.pointspread import BOX
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
"""Correlation of neighbouring residuals, at most, and of residuals that hold nothing but what the model lacks."""
LEAST_ON_SLOPES = 0.5
"""Variance of residuals on slopes, over that of all: few pixels tell it where hardly a slope is in view (0.7-0.9 behind
gamma 2.2, above 1 elsewhere)."""
LEAST_SHARED = -0.5
"""The same where sharpening has set the noise of neighbours against each other: webcams have -0.2."""

STREAK_PX = 15.0
"""A streak so long doubles the variance of a fit; by the NEES of 819 smeared images of 29 development flights: 1.2 to
12 px, 2.3 at 14, 3.2 at 18, 5 at 25."""


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


@dataclass(frozen=True, slots=True)
class SharedNoise:
    """What neighbouring residuals have in common.

    Attributes:
        factor: by which that raises the variance of a fit; less than 1 where neighbours contradict each other.
        common: share of the variance of a residual, 0 to 1; not less than so many pixels can tell from none.
    """

    factor: float
    common: float


def shared_by(residual: Array, used: npt.NDArray[np.bool_], least: float = 0.0) -> SharedNoise:
    """What neighbours share of the residuals of a fit.

    Demosaicing, denoising and what the model lacks are shared; the noise of a sensor is not. Where the correlation
    falls by r from a pixel to the next, the variance of a mean is (1 + r) / (1 - r) times that of independent pixels,
    each way; edges, which change over a few pixels, suffer less: (1 + r) / sqrt(1 - r), by the NEES of 80 development
    images (0.66 to 1.19). Sharpening sets the noise of neighbours against each other, r < 0, and a mean has less of it.

    Args:
        residual: of each used pixel `(n,)`.
        used: which pixels of a window these are `(rows, columns)`.
        least: correlation that is believed.
    """
    image = np.zeros(used.shape)
    image[used] = residual
    total = max(float(residual @ residual), LEAST_SCATTER)
    factor, common = 1.0, 0.0
    for one, neighbour in ((image[:, 1:], image[:, :-1]), (image[1:], image[:-1])):
        r = float(np.clip((one * neighbour).sum() / total, least, MOST_SHARED))
        factor *= (1.0 + r) / sqrt(1.0 - r)
        common += max(r, 0.0) / MOST_SHARED / 2.0
    return SharedNoise(factor, min(max(common, 1.0 / sqrt(max(residual.size, 1))), 1.0))


def shared_by_all(residual: Array, windows: Sequence[npt.NDArray[np.bool_]], least: float = 0.0) -> SharedNoise:
    """The same over several prints, the mean of their pixels.

    Args:
        residual: of each used pixel of all windows, one window after the other `(n,)`.
        windows: which pixels of each are used, each `(rows, columns)`.
        least: correlation that is believed.
    """
    if len(windows) == 1:
        return shared_by(residual, windows[0], least)
    pieces = np.split(residual, np.cumsum([int(used.sum()) for used in windows])[:-1])
    shares = [shared_by(piece, used, least) for piece, used in zip(pieces, windows, strict=True)]
    size = np.array([piece.size for piece in pieces]) / residual.size
    factor, common = size @ np.array([(share.factor, share.common) for share in shares])
    return SharedNoise(float(factor), float(common))


def shared_on_slopes(
    residual: Array, steep: Array, windows: Sequence[npt.NDArray[np.bool_]], least: float = 0.0
) -> float:
    """By how much the residuals on the slopes of a print raise the variance of a fit, as `SharedNoise.factor`.

    Only slopes tell a pose, and what the model lacks of a point spread, of paper that is blown beside them or of
    sharpening lies there; the even inside of cells from 5 px, most of what is seen, knows nothing of it. Behind a tone
    curve slopes are less noisy (0.8 of the variance) than `clarity` makes of black and white.

    Args:
        residual: of each used pixel of all windows `(n,)`.
        steep: squared slope of the model there `(n,)`.
        windows: which pixels of each are used, each `(rows, columns)`.
        least: correlation that is believed.
    """
    weighed = residual * np.sqrt(steep / max(float(np.mean(steep)), 1e-12))
    larger = max(float(weighed @ weighed) / max(float(residual @ residual), LEAST_SCATTER), LEAST_ON_SLOPES)
    return larger * shared_by_all(weighed, windows, least).factor


def streak_doubt(spread: Array) -> float:
    """Factor on the variance of a fit for what a streak hides: it differs over the print, and its rim has ground in it.

    Args:
        spread: covariance of the point spread `(2, 2)` [px^2]; an even streak of length L adds L^2 / `BOX` one way.
    """
    least, most = np.linalg.eigvalsh(spread)
    return 1.0 + (BOX * float(most - least) / STREAK_PX**2) ** 2
