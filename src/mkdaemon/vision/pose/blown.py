"""Where the bright side of an edge is blown: how far the clipping moves the edge that is found.

A blurred edge rises from the grey value d by the contrast c as d + c Phi(s / sigma). What lies above the largest grey
value is cut off, a share 1 - q with q = (top - d) / c, and the centre of gravity of the slope that is left lies at
-sigma lambda(z), with lambda = phi / Phi, z = Phi^-1(q): towards the dark side by half a pixel where half is cut off.
A highlight on a glossy print lights its ink by different amounts, so that edges move where it lies and others stay,
which looks like a tilt. Dark sides say how much is cut off; blur and contrast are known nearly and fitted with the
pose.

Source: mean of a truncated normal distribution, Johnson and Kotz, Continuous Univariate Distributions, 13.10.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import erf, pi, sqrt
from typing import Final

import numpy as np
import numpy.typing as npt

from mkdaemon.vision.camera.image import BRIGHTEST
from mkdaemon.vision.limits import LIMITS
from mkdaemon.vision.pose.pose import median, quantile

Array = npt.NDArray[np.float64]
Bools = npt.NDArray[np.bool_]

PLACES: Final = np.linspace(-3.0, 2.0, 201)
"""At which the two functions below are tabled [sigma]: shares of 0.1 to 98 %."""
BELOW: Final = np.array([(1.0 + erf(z / sqrt(2.0))) / 2.0 for z in PLACES])
"""Share q of an edge below each place."""
DENSITY: Final = np.exp(-(PLACES**2) / 2.0) / sqrt(2.0 * pi)
MOVED: Final = DENSITY / BELOW
"""The mean's distance lambda(z) [sigma]."""
BY_CONTRAST: Final = BELOW * MOVED * (PLACES + MOVED) / DENSITY
"""Derivative of lambda by the logarithm of the contrast."""
SLOPE_WIDTH: Final = sqrt(2.0 * pi)
"""Area of a Gaussian slope over its peak [sigma]."""
LOOKED: Final = 0.25
"""Variance that looking at the slope adds to the blur: linear interpolation and differences over a pixel [px^2]."""
LEAST_BLUR: Final = 0.3
"""Variance of the sharpest blur, and of the pixel itself [px^2]."""
ENOUGH: Final = 20
"""Edges that show contrast and blur of this image."""
AHEAD: Final = 2.0
"""So far beyond an edge the dark side's light counts, where it grows along the normal, over the width of the slope: the
slope is cut there (edges rendered at 1 and 2 grey/px, 1.4 to 2.4)."""
ROUNDS: Final = 3
"""Of weights and light."""
LEAST_CUT: Final = 0.8
"""Quantile of the contrast from which edges are taken for the clearest, where every bright side is blown."""
BEYOND: Final = 1.2
"""Their whole contrast over what is seen of it."""


@dataclass(frozen=True, slots=True, eq=False)
class Blown:
    """What clipping does to the edges of an image.

    Attributes:
        moved: offset of each edge that it causes, as far as blur and contrast are known `(n,)` [px].
        columns: derivative of the offsets by the blur of the edges that run either way and by the contrast, as shares
            of them `(n, 3)` [px]. Motion blurs edges of one way: with one blur for both, edges across it lay 0.04-0.13
            px beside those along it (over-exposed flights), which looks like a tilt.
        spread: how well these are known `(3,)`.
        clear: variance of a located edge that is not blown over its own `(n,)`.
        shown: whether the ink beside each is darker than what is blown: a highlight floods the others `(n,)`.
    """

    moved: Array
    columns: Array
    spread: Array
    clear: Array
    shown: Bools

    @property
    def share(self) -> float:
        """Of the edges that are blown."""
        return float(np.count_nonzero(self.clear < 1.0)) / len(self.clear)


@dataclass(frozen=True, slots=True, eq=False)
class EdgeSides:
    """What lies on both sides of each edge, `(n,)` each.

    Attributes:
        dark: grey values at `reach` on the dark side.
        bright: and on the bright side.
        slope_width: area of the slope over its peak [px].
        pixels: where the edges should be `(n, 2)` [px].
        normals: towards the bright side, unit `(n, 2)`.
        reach: how far from there the grey values are [px].
    """

    dark: Array
    bright: Array
    slope_width: npt.NDArray[np.floating]
    pixels: Array
    normals: Array
    reach: Array


def blown_edges(sides: EdgeSides, found: Bools, upright: Bools) -> Blown | None:
    """What clipping does to edges; none where no bright side is blown.

    Args:
        sides: what lies beside the edges.
        found: which of them were found `(n,)`.
        upright: which of them run one way `(n,)`.
    """
    edges = LIMITS.edges
    cut = found & (sides.bright >= LIMITS.read.saturated)
    if not bool(cut.any()):
        return None
    whole = found & ~cut
    sees_both = int(whole.sum()) >= ENOUGH
    contrast = sides.bright - sides.dark
    # Where all are blown, those that are cut least come nearest to a whole edge.
    clearest = whole if sees_both else found & (contrast >= quantile(contrast[found], LEAST_CUT))
    usual = (1.0 if sees_both else BEYOND) * median(contrast[clearest])
    kinds = np.stack([upright, ~upright])
    width = _widths(sides.slope_width, clearest, kinds)
    blur = blur_of(width)
    light, rise = _dark_light(sides, found)
    dark = sides.dark + (sides.reach + AHEAD * width) * rise
    place = np.interp((BRIGHTEST - dark) / max(usual, 1.0), BELOW, PLACES)
    moved = -blur * np.interp(place, PLACES, MOVED) * cut
    by_contrast = -blur * np.interp(place, PLACES, BY_CONTRAST) * cut
    of_contrast = edges.contrast_share if sees_both else edges.unseen_contrast_share
    spread = np.array([edges.blur_share, edges.blur_share, of_contrast])
    clear = 1.0 / (1.0 + (moved / edges.blown_px) ** 2)
    shown = light < LIMITS.read.saturated - LIMITS.read.nearly_blown
    return Blown(moved, np.column_stack([*(kinds * moved), by_contrast]), spread, clear, shown)


def blur_of(width: Array) -> Array:
    """Deviation of the blur of edges, by that of their slopes `(n,)` [px]."""
    return np.asarray(np.sqrt(np.maximum(width**2 - LOOKED, LEAST_BLUR)))


def _widths(slope_width: npt.NDArray[np.floating], clearest: Bools, kinds: Bools) -> Array:
    """Width of the slope of each edge `(n,)` [px]: motion blurs edges of one kind, of `kinds` `(2, n)`, more."""
    widths: Array = np.full(len(clearest), median(slope_width[clearest]))
    for kind in kinds:
        if int((clearest & kind).sum()) >= ENOUGH // 2:
            widths[kind] = median(slope_width[clearest & kind])
    return widths / SLOPE_WIDTH


def _dark_light(sides: EdgeSides, found: Bools) -> tuple[Array, Array]:
    """The dark beside each edge in a highlight, and how it grows along the normal, `(n,)` each [grey], [grey/px].

    A quadratic in the image.
    """
    at = sides.pixels - sides.reach[:, None] * sides.normals
    middle, size = at.mean(axis=0), float(np.abs(at - at.mean(axis=0)).max())
    x, y = ((at - middle) / max(size, 1.0)).T
    terms = np.stack([np.ones_like(x), x, y, x * x, x * y, y * y])
    light, weights = np.zeros(len(terms)), found.astype(np.float64)
    for _ in range(ROUNDS):
        weighted = terms * weights
        light = np.linalg.solve(weighted @ terms.T + 1e-6 * np.eye(len(terms)), weighted @ sides.dark)
        residual = np.abs(sides.dark - light @ terms)
        weights = found / (1.0 + (residual / max(median(residual[found]), 1.0)) ** 2)
    along_x = light[1] + 2.0 * light[3] * x + light[4] * y
    along_y = light[2] + light[4] * x + 2.0 * light[5] * y
    rise: Array = (sides.normals[:, 0] * along_x + sides.normals[:, 1] * along_y) / max(size, 1.0)
    return light @ terms, rise
