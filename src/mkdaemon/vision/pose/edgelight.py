"""What light does to the edges of a print: it grows along some, and others are blown.

Grey values on both sides of all edges are a quadratic in the image each.

Behind dirt on the lens, in the soft rim of a shadow or near the corner of an image the contrast of an edge grows along
its normal by a share c for each pixel, its bright side slopes, and the centre of gravity of the slope moves by
c sigma^2 times a factor, with sigma the deviation of the slope. An even growth moves the print; one that differs over
the print turns it. Edges that the light does not explain, as across a hard shadow, are left alone.

Where the bright side of an edge is blown, the clipping moves the edge that is found.
A blurred edge rises from the grey value d by the contrast c as d + c Phi(s / sigma). What lies above the largest grey
value is cut off, a share 1 - q with q = (top - d) / c, and the centre of gravity of the slope that is left lies at
-sigma lambda(z), with lambda = phi / Phi, z = Phi^-1(q): towards the dark side by half a pixel where half is cut off.
A highlight on a glossy print lights its ink by different amounts, so that edges move where it lies and others stay,
which looks like a tilt. Dark sides say how much is cut off; blur and contrast are known nearly and fitted with the
pose.

Source: mean of a truncated normal distribution, Johnson and Kotz, Continuous Univariate Distributions, 13.10.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import erf, pi, sqrt
from typing import Final

import numpy as np

from mkdaemon.vision.arrays import Array, Bools
from mkdaemon.vision.camera.image import BRIGHTEST
from mkdaemon.vision.limits import HALF, LIMITS
from mkdaemon.vision.pose.edgemodel import Samples
from mkdaemon.vision.pose.pose import median, quantile
from mkdaemon.vision.pose.unknowns import Unknown

PLACES: Final = np.linspace(-3.0, 2.0, 201)
"""At which the two functions below are tabled [sigma]: shares of 0.1 to 98 %."""
BELOW: Final = np.array([(1.0 + erf(z / sqrt(2.0))) / 2.0 for z in PLACES])
"""Share q of an edge below each place."""
DENSITY: Final = np.exp(-(PLACES**2) / 2.0) / sqrt(2.0 * pi)
MOVED: Final = DENSITY / BELOW
"""The mean's distance lambda(z) [sigma]."""
BY_CONTRAST: Final = BELOW * MOVED * (PLACES + MOVED) / DENSITY
"""Derivative of lambda by the logarithm of the contrast."""
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
GROWTH_MOVES: Final = 1.9
"""Share of sigma^2 c that an edge moves: edges drawn with a point spread of 0.5 to 1.5 px, 1.7 to 2.1."""
UNSURE: Final = 0.5
"""Share of what the light moves that is unsure, and by which it may move edges another way, as marks of dirt are
smaller than a quadratic over the print: NEES 1.2-1.4 behind dirt and 0.8-1.0 under a shadow's rim."""
EVEN_PX: Final = 0.003
"""What the light may move edges without being asked, root mean square [px]: below a third of `systematic_px`."""
ENOUGH_FOR_LIGHT: Final = 60
"""Edges that show how the light changes."""
RIDGE: Final = 1e-6


@dataclass(frozen=True, slots=True, eq=False)
class Light:
    """Grey values of the paper, or the ink, beside edges, as quadratics in the image.

    Attributes:
        place: of the edges in the part of the image that these take, -1 to 1 `(n, 2)`.
        grey: of each side that was asked for, at each edge `(k, n)`.
        rise: slope of that along its normal `(k, n)` [grey/px].
        scatter: of the sides around it, of the one with most [grey].
    """

    place: Array
    grey: Array
    rise: Array
    scatter: float

    @classmethod
    def of(cls, samples: Samples, sides: Array, telling: Bools) -> Light:
        """From the sides `(k, n)` of the edges that show the light `(n,)`, by a robust fit."""
        middle = samples.pixels.mean(axis=0)
        size = max(float(np.abs(samples.pixels - middle).max()), 1.0)
        place = (samples.pixels - middle) / size
        x, y = place.T
        across, down = samples.normals.T / size
        powers = np.stack([np.ones_like(x), x, y, x * x, x * y, y * y])
        slopes = np.stack([np.zeros_like(x), across, down, 2.0 * x * across, y * across + x * down, 2.0 * y * down])
        weights = telling.astype(np.float64)
        terms, scatter = np.zeros((len(sides), len(powers))), 1.0
        for _ in range(ROUNDS):
            weighted = powers * weights
            normal = weighted @ powers.T + RIDGE * np.eye(len(powers))
            terms = np.linalg.solve(normal, weighted @ sides.T).T
            residual = np.abs(sides - terms @ powers).max(axis=0)
            scatter = max(median(residual[telling]), 1.0)
            weights = telling / (1.0 + (residual / scatter) ** 2)
        return cls(place, terms @ powers, terms @ slopes, scatter)


@dataclass(frozen=True, slots=True, eq=False)
class LightShift:
    """How light moves the edges that are found.

    Attributes:
        moved: of each towards its bright side, as far as it is known `(n,)` [px].
        unsure: the unknowns of what is not; none where light moves nothing.
        flooded: edges whose ink is blown, too: a highlight shows nothing of them `(n,)`.
    """

    moved: Array
    unsure: Unknown | None
    flooded: Bools


def light_shift(
    samples: Samples, sides: Array, slope_sd: Array, telling: Bools, cut: Bools, *, is_near: bool
) -> LightShift:
    """How light moves edges: by clipping where bright sides are blown, by its growth elsewhere.

    Args:
        samples: of the edge model.
        sides: grey values on the dark and the bright side `(2, n)`.
        slope_sd: deviation of the slope of each edge `(n,)` [px].
        telling: which edges show light and contrast `(n,)`.
        cut: which edges are blown `(n,)`.
        is_near: whether the places are nearly known; what lies beside others tells no growth.
    """
    if bool(cut.any()):
        return _blown(samples, sides, slope_sd, telling, cut)
    none = LightShift(np.zeros(len(telling)), None, np.zeros(len(telling), dtype=bool))
    return _uneven(samples, sides, slope_sd, telling, none) if is_near else none


def _uneven(samples: Samples, sides: Array, slope_sd: Array, telling: Bools, none: LightShift) -> LightShift:
    """By light that grows over a print; none where it is even, or few edges show it. See `light_shift`.

    Unsure are a share of that, and shifts in proportion that grow evenly over the print, e = n . (a + B x).
    """
    if int(telling.sum()) < ENOUGH_FOR_LIGHT:
        return none
    light = Light.of(samples, sides, telling)
    contrast = np.maximum(light.grey[1] - light.grey[0], light.scatter)
    beside = np.maximum(np.abs(sides - light.grey).max(axis=0), light.scatter)
    explained = 1.0 / (1.0 + (beside / (LIMITS.read.faint * contrast)) ** 4)
    moved = GROWTH_MOVES * slope_sd**2 * explained * (light.rise[1] - light.rise[0]) / contrast
    size = float(np.sqrt(np.mean(moved**2)))
    if size < EVEN_PX:
        return none
    (x, y), (across, down) = light.place.T, samples.normals.T
    even = size * np.stack([across, down, across * x, across * y, down * x, down * y])
    return replace(none, moved=moved, unsure=Unknown("uneven", UNSURE * np.vstack([moved, even]), np.ones(7)))


def _blown(samples: Samples, sides: Array, slope_sd: Array, telling: Bools, cut: Bools) -> LightShift:
    """By clipping, see `light_shift`.

    Unsure are, as shares, the blur of the edges that run either way and the contrast. Motion blurs edges of one way:
    with one blur for both, edges across it lay 0.04-0.13 px beside those along it (over-exposed flights), which looks
    like a tilt. A flooded edge is no missing one, as long as enough others are left to be missed.
    """
    contrast, blur = sides[1] - sides[0], blur_of(slope_sd)
    clearest, beyond = least_cut(contrast, telling, cut & telling)
    usual = beyond * median(contrast[clearest])
    light = Light.of(samples, sides[:1], telling)
    dark = sides[0] + (samples.reach + AHEAD * slope_sd) * light.rise[0]
    place = np.interp((BRIGHTEST - dark) / max(usual, 1.0), BELOW, PLACES)
    moved = -blur * np.interp(place, PLACES, MOVED) * cut
    by_contrast = -blur * np.interp(place, PLACES, BY_CONTRAST) * cut
    rows = np.stack([samples.upright * moved, ~samples.upright * moved, by_contrast])
    flooded = light.grey[0] >= LIMITS.read.saturated - LIMITS.read.nearly_blown
    if float(flooded.mean()) >= HALF:
        flooded = np.zeros_like(flooded)
    return LightShift(moved, Unknown("blown", rows, np.full(len(rows), LIMITS.edges.clipped_sd**-2)), flooded)


def least_cut(contrast: Array, found: Bools, cut: Bools) -> tuple[Bools, float]:
    """Edges that come nearest to whole ones `(n,)`, and their whole contrast over what is seen of it.

    Args:
        contrast: that is seen of each edge `(n,)` [grey].
        found: which edges were found `(n,)`.
        cut: which of them are blown `(n,)`.
    """
    whole = found & ~cut
    if not bool(cut.any()) or int(whole.sum()) >= ENOUGH:
        return whole, 1.0
    return found & (contrast >= quantile(contrast[found], LEAST_CUT)), BEYOND


def blur_of(width: Array) -> Array:
    """Deviation of the blur of edges, by that of their slopes `(n,)` [px]."""
    return np.asarray(np.sqrt(np.maximum(width**2 - LOOKED, LEAST_BLUR)))
