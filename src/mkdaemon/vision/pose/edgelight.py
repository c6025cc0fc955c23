"""What light does to the edges of a print: it grows along some, and others are blown.

Edges in light that grows or falls over the print: how far it moves them.

Behind dirt on the lens, in the soft rim of a shadow or near the corner of an image the contrast of an edge grows along
its normal by a share c for each pixel, its bright side slopes, and the centre of gravity of the slope moves by c w^2
times a factor, with w the half width of the window it is taken in. An even growth moves the print; one that differs
over the print turns it. Grey values on both sides of all edges are a quadratic in the image each; edges these do not
explain, as across a hard shadow, are left alone.

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

from dataclasses import dataclass
from math import erf, pi, sqrt
from typing import Final

import numpy as np
import numpy.typing as npt

from mkdaemon.vision.arrays import Array, Bools
from mkdaemon.vision.camera.image import BRIGHTEST
from mkdaemon.vision.limits import HALF, LIMITS
from mkdaemon.vision.pose.pose import median, quantile

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
GROWTH_MOVES: Final = 0.38
"""Share of w^2 c that an edge moves: edges drawn with a point spread of 0.5 to 1.5 px, 0.33 to 0.41."""
UNSURE: Final = 0.5
"""Share of what the light moves that is unsure, and by which it may move edges another way, as marks of dirt are
smaller than a quadratic over the print: NEES 1.2-1.4 behind dirt and 0.8-1.0 under a shadow's rim."""
EVEN_PX: Final = 0.003
"""What the light may move edges against each other without being asked [px]: below a third of `systematic_px`."""
ENOUGH_FOR_LIGHT: Final = 60
"""Edges that show how the light changes."""
WHOLE_REACH: Final = 0.99
"""Share of the longest reach from which both sides of an edge are seen at their plain grey values."""
RIDGE: Final = 1e-6


@dataclass(frozen=True, slots=True, eq=False)
class Blown:
    """What clipping does to the edges of an image.

    Attributes:
        moved: offset of each edge that it causes, as far as blur and contrast are known `(n,)` [px].
        rows: derivative of the offsets by the blur of the edges that run either way and by the contrast, as shares
            of them `(3, n)` [px]. Motion blurs edges of one way: with one blur for both, edges across it lay 0.04-0.13
            px beside those along it (over-exposed flights), which looks like a tilt.
        clear: variance of a located edge that is not blown over its own `(n,)`.
        shown: whether the ink beside each is darker than what is blown: a highlight floods the others `(n,)`.
    """

    moved: Array
    rows: Array
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


@dataclass(frozen=True, slots=True, eq=False)
class Light:
    """Grey values as a quadratic in the image.

    Attributes:
        middle: of where they were seen `(2,)` [px].
        size: of that part of the image [px].
        terms: of the quadratic: 1, x, y, x^2, x y, y^2 `(6,)` [grey].
        scatter: around it [grey].
    """

    middle: Array
    size: float
    terms: Array
    scatter: float

    @classmethod
    def of(cls, at: Array, grey: Array) -> Light:
        """From grey values `(n,)` at places `(n, 2)`."""
        middle = at.mean(axis=0)
        size = max(float(np.abs(at - middle).max()), 1.0)
        powers = _powers((at - middle) / size)
        weights = np.ones(len(grey))
        terms, scatter = np.zeros(len(powers)), 1.0
        for _ in range(ROUNDS):
            weighted = powers * weights
            terms[:] = np.linalg.solve(weighted @ powers.T + RIDGE * np.eye(len(powers)), weighted @ grey)
            residual = np.abs(grey - terms @ powers)
            scatter = max(median(residual), 1.0)
            weights = 1.0 / (1.0 + (residual / scatter) ** 2)
        return cls(middle, size, terms, scatter)

    @property
    def growth(self) -> float:
        """By how much the slope differs within that part of the image, at most [grey/px]."""
        return 2.0 * float(np.abs(self.terms[3:]).sum()) / self.size

    def place(self, pixels: Array) -> Array:
        """Places `(n, 2)` [px] in that part of the image, -1 to 1."""
        return np.asarray((pixels - self.middle) / self.size)

    def at(self, places: Array, normals: Array) -> tuple[Array, Array]:
        """Grey value and slope along normals at places, `(n,)` each [grey], [grey/px]."""
        place = self.place(places)
        x, y = place.T
        _, by_x, by_y, xx, xy, yy = self.terms
        along_x, along_y = by_x + 2.0 * xx * x + xy * y, by_y + xy * x + 2.0 * yy * y
        return self.terms @ _powers(place), (normals[:, 0] * along_x + normals[:, 1] * along_y) / self.size


@dataclass(frozen=True, slots=True, eq=False)
class UnevenLight:
    """Light on both sides of the edges of a print."""

    bright: Light
    dark: Light

    @classmethod
    def of(cls, sides: EdgeSides, found: Bools) -> UnevenLight | None:
        """From what lies on both sides of edges; none where too few are seen whole."""
        use = found & (sides.reach > WHOLE_REACH * float(sides.reach.max()))
        if int(use.sum()) < ENOUGH_FOR_LIGHT:
            return None
        at, out = sides.pixels[use], sides.reach[use, None] * sides.normals[use]
        return cls(Light.of(at + out, sides.bright[use]), Light.of(at - out, sides.dark[use]))

    def unsure(self, moved: Array, sides: EdgeSides) -> Array:
        """Errors of all edges that what the light moves `(n,)` leaves, deviations with their signs `(7, n)` [px].

        A share of it, and shifts in proportion that grow evenly over the print: e = n . (a + B x), each of the six
        coefficients an unknown.
        """
        x, y = self.bright.place(sides.pixels).T
        across, down = sides.normals.T
        size = UNSURE * float(np.sqrt(np.mean(moved**2)))
        even = size * np.stack([across, down, across * x, across * y, down * x, down * y])
        return np.vstack([UNSURE * moved, even])

    def is_even(self, width: float) -> bool:
        """Whether the light moves no edge of a half width by as much as could turn the print."""
        growth = self.bright.growth + self.dark.growth
        return GROWTH_MOVES * width**2 * growth < EVEN_PX * max(float(self.bright.terms[0] - self.dark.terms[0]), 1.0)

    def moved(self, sides: EdgeSides, widths: Array) -> Array:
        """How far edges are moved towards their bright side `(n,)` [px].

        Args:
            sides: of the edges.
            widths: half widths of the windows in which their centres are taken `(n,)` [px].
        """
        out = sides.reach[:, None] * sides.normals
        bright, bright_grows = self.bright.at(sides.pixels + out, sides.normals)
        dark, dark_grows = self.dark.at(sides.pixels - out, sides.normals)
        scatter = max(self.bright.scatter, self.dark.scatter)
        contrast = np.maximum(bright - dark, scatter)
        beside = np.maximum(np.abs(sides.bright - bright), np.abs(sides.dark - dark))
        explained = 1.0 / (1.0 + (np.maximum(beside, scatter) / (LIMITS.read.faint * contrast)) ** 4)
        return np.asarray(GROWTH_MOVES * widths**2 * explained * (bright_grows - dark_grows) / contrast)


def _powers(place: Array) -> Array:
    """Terms of a quadratic `(6, n)`."""
    x, y = place.T
    return np.stack([np.ones_like(x), x, y, x * x, x * y, y * y])


def blown_edges(sides: EdgeSides, found: Bools, upright: Bools) -> Blown | None:
    """What clipping does to edges; none where no bright side is blown.

    Args:
        sides: what lies beside the edges.
        found: which of them were found `(n,)`.
        upright: which of them run one way `(n,)`.
    """
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
    beside = sides.pixels - sides.reach[:, None] * sides.normals
    light, rise = Light.of(beside[found], sides.dark[found]).at(beside, sides.normals)
    dark = sides.dark + (sides.reach + AHEAD * width) * rise
    place = np.interp((BRIGHTEST - dark) / max(usual, 1.0), BELOW, PLACES)
    moved = -blur * np.interp(place, PLACES, MOVED) * cut
    by_contrast = -blur * np.interp(place, PLACES, BY_CONTRAST) * cut
    clear = 1.0 / (1.0 + (moved / (HALF * LIMITS.edges.located_px)) ** 2)
    shown = light < LIMITS.read.saturated - LIMITS.read.nearly_blown
    return Blown(moved, np.vstack([kinds * moved, by_contrast]), clear, shown)


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
