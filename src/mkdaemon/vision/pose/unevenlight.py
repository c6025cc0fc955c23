"""Edges in light that grows or falls over the print: how far it moves them.

Behind dirt on the lens, in the soft rim of a shadow or near the corner of an image the contrast of an edge grows along
its normal by a share c for each pixel, its bright side slopes, and the centre of gravity of the slope moves by c w^2
times a factor, with w the half width of the window it is taken in. An even growth moves the print; one that differs
over the print turns it. Grey values on both sides of all edges are a quadratic in the image each; edges these do not
explain, as across a hard shadow, are left alone.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import numpy.typing as npt

from mkdaemon.vision.limits import EdgeLimits
from mkdaemon.vision.pose.blown import EdgeSides
from mkdaemon.vision.pose.edgefind import FoundEdges
from mkdaemon.vision.pose.pose import median

Array = npt.NDArray[np.float64]
Bools = npt.NDArray[np.bool_]

MOVED: Final = 0.38
"""Share of w^2 c that an edge moves: edges drawn with a point spread of 0.5 to 1.5 px, 0.33 to 0.41."""
ROUNDS: Final = 2
"""Of weights and light."""
UNSURE: Final = 0.5
"""Share of what the light moves that is unsure, and by which it may move edges another way, as marks of dirt are
smaller than a quadratic over the print: NEES 1.2-1.4 behind dirt and 0.8-1.0 under a shadow's rim."""
EVEN_PX: Final = 0.003
"""What the light may move edges against each other without being asked [px]: below a third of `systematic_px`."""
ENOUGH: Final = 60
"""Edges that show how the light changes."""
WHOLE_REACH: Final = 0.99
"""Share of the longest reach from which both sides of an edge are seen at their plain grey values."""
RIDGE: Final = 1e-6


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
        if int(use.sum()) < ENOUGH:
            return None
        at, out = sides.pixels[use], sides.reach[use, None] * sides.normals[use]
        return cls(Light.of(at + out, sides.bright[use]), Light.of(at - out, sides.dark[use]))

    def without(self, edges: FoundEdges, limits: EdgeLimits) -> FoundEdges:
        """Edges without what the light moves, and with what of that is unsure."""
        if edges.sides is None or self.is_even(edges.width):
            return edges
        moved = self.moved(edges.sides, edges.widths, limits)
        return replace(edges, offsets=edges.offsets - moved, unsure=self._unsure(moved, edges.sides))

    def _unsure(self, moved: Array, sides: EdgeSides) -> Array:
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
        return MOVED * width**2 * growth < EVEN_PX * max(float(self.bright.terms[0] - self.dark.terms[0]), 1.0)

    def moved(self, sides: EdgeSides, widths: Array, limits: EdgeLimits) -> Array:
        """How far edges are moved towards their bright side `(n,)` [px].

        Args:
            sides: of the edges.
            widths: half widths of the windows in which their centres are taken `(n,)` [px].
            limits: how far the light may be from a quadratic.
        """
        out = sides.reach[:, None] * sides.normals
        bright, bright_grows = self.bright.at(sides.pixels + out, sides.normals)
        dark, dark_grows = self.dark.at(sides.pixels - out, sides.normals)
        scatter = max(self.bright.scatter, self.dark.scatter)
        contrast = np.maximum(bright - dark, scatter)
        beside = np.maximum(np.abs(sides.bright - bright), np.abs(sides.dark - dark))
        explained = 1.0 / (1.0 + (np.maximum(beside, scatter) / (limits.smooth_light * contrast)) ** 4)
        return np.asarray(MOVED * widths**2 * explained * (bright_grows - dark_grows) / contrast)


def _powers(place: Array) -> Array:
    """Terms of a quadratic `(6, n)`."""
    x, y = place.T
    return np.stack([np.ones_like(x), x, y, x * x, x * y, y * y])
