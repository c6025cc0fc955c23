"""The tone curve of a camera from the edges of a chess board: what lies half way between black and white.

On a straight edge the blur of the lens mixes as much black as white, in light. The grey value there is therefore
((b^g + w^g) / 2)^(1/g) for black b, white w and a curve that makes light from grey to the power g. Where the edge runs
is known from the corners at its ends, which no tone curve moves.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from mkdaemon.errors import VisionError
from mkdaemon.vision.arrays import Array, Grey
from mkdaemon.vision.tags.cellread import sample

ALONG: Final = (0.35, 0.42, 0.5, 0.58, 0.65)
"""Where an edge is looked at, shares of its length: corners and markers are far."""
ASIDE: Final = 0.09
"""How far beside it black and white are read, share of its length; a marker begins at an eighth."""
LEAST_PX: Final = 3.0
"""The same at least: blur ends there [px]."""
CONTRAST: Final = 40.0
"""Between black and white at least [grey]."""
RANGE: Final = (4.0, 250.0)
"""Grey values that are neither crushed nor blown."""
GAMMAS: Final = (0.5, 4.0)
"""Curves there are."""
LEAST_EDGES: Final = 60
STEP: Final = 0.01
KNOWN: Final = 0.1
"""Deviation up to which a curve is stored."""
NONE: Final = 0.1
"""A curve nearer to 1 is none: the method itself is off by 6 %."""


def edge_levels(pixels: Grey, starts: Array, ends: Array) -> Array:
    """Black, middle and white `(n, 3)` of straight edges that run from `starts` to `ends` `(m, 2)` [px].

    Edges that are too short, too pale, crushed or blown are left out.
    """
    along = ends - starts
    length = np.linalg.norm(along, axis=1, keepdims=True)
    aside = np.column_stack([-along[:, 1], along[:, 0]]) * ASIDE
    places = starts[:, None, :] + np.array(ALONG)[None, :, None] * along[:, None, :]
    first, middle, second = (
        sample(pixels, (places + side * aside[:, None, :]).reshape(-1, 2)).reshape(len(places), -1).mean(axis=1)
        for side in (-1.0, 0.0, 1.0)
    )
    black, white = np.minimum(first, second), np.maximum(first, second)
    good = (length[:, 0] * ASIDE > LEAST_PX) & (white - black > CONTRAST) & (black > RANGE[0]) & (white < RANGE[1])
    levels: Array = np.column_stack([black, middle, white])[good]
    return levels


def gamma_of(levels: Array) -> tuple[float, float]:
    """The curve and its deviation.

    Args:
        levels: black, middle and white `(n, 3)` of edges.

    Raises:
        VisionError: too few edges, or no such curve.
    """
    if len(levels) < LEAST_EDGES:
        msg = f"the tone curve needs {LEAST_EDGES} edges with black and white in range, {len(levels)} were seen"
        raise VisionError(msg)
    black, middle, white = levels.T
    gammas = np.arange(GAMMAS[0], GAMMAS[1] + STEP, STEP)
    best = int(np.abs(_off(black, middle, white, gammas[:, None])).sum(axis=1).argmin())
    if best in (0, len(gammas) - 1):
        msg = "the edges of the board show no tone curve: sharpen the focus, even the light"
        raise VisionError(msg)
    gamma = float(gammas[best])
    slope = (_off(black, middle, white, gamma + STEP) - _off(black, middle, white, gamma - STEP)) / (2 * STEP)
    spread = float(np.sqrt(np.mean(_off(black, middle, white, gamma) ** 2)))
    return gamma, spread / max(float(np.sqrt((slope**2).sum())), 1e-9)


def curve_to_store(levels: Array) -> tuple[float, str]:
    """The curve for the camera file, 1 where none is known, and how it was found in words."""
    try:
        gamma, sd = gamma_of(levels)
    except VisionError as error:
        return 1.0, f"not known: {error}"
    words = f"{gamma:.2f} +- {sd:.2f} from {len(levels)} edges"
    if sd > KNOWN:
        return 1.0, f"not known: {words}"
    return (1.0, f"{words}: as good as none") if abs(gamma - 1.0) < NONE else (gamma, words)


def _off(black: Array, middle: Array, white: Array, gamma: float | Array) -> Array:
    """How far the middles are from where a curve has them `(n,)`, or several `(m, 1)` have them `(m, n)` [grey]."""
    expected: Array = ((black**gamma + white**gamma) / 2) ** (1 / gamma)
    return middle - expected
