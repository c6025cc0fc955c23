"""Finding the edges of an image along the normals of projected samples, to a fraction of a pixel."""

from __future__ import annotations

from dataclasses import dataclass
from math import pi, sqrt

import cv2
import numpy as np
import numpy.typing as npt

from mkdaemon.vision.arrays import Array, Bools, Grey
from mkdaemon.vision.limits import HALF, LIMITS, NOISE_GREY
from mkdaemon.vision.pose.edgelight import blur_of, least_cut, light_shift
from mkdaemon.vision.pose.edgemodel import Samples
from mkdaemon.vision.pose.pose import median, quantile
from mkdaemon.vision.pose.unknowns import Unknown

Array32 = npt.NDArray[np.float32]
Numbers = npt.NDArray[np.intp]

STEP_PX = 0.5
"""Distance of the grey values along a normal [px]; more while the reach is long."""
STEPS = 12.0
"""A long reach is cut into so many steps."""
WIDTH_FACTOR = 0.9
"""Half width of the window in which an edge's centre is taken, over the width of its slope."""
HALF_WIDTH = WIDTH_FACTOR * sqrt(2.0 * pi)
"""The same over the deviation of a Gaussian point spread."""
SKIRT = 0.15
"""Share of the peak slope that is taken off before a centre is computed: texture and noise have no say in it."""
LEAST_OF_A_KIND = 10
"""Edges of one direction that have a median of their own."""
LARGE = 0.7
"""Reach over the longest of one direction, of edges that tell how wide they are."""
QUARTER = 0.25
"""Of the edges, the flattest ones, have nothing but noise beside them."""
UNEVEN = 2.0
"""Slope beside an edge, over what the skirt takes off or the flattest quarter of the edges has, from which something
else than noise is there. Where it was 0.3-0.5 of the peak under leaf shadows, edges were off by 0.3 px, and by 1 px
beyond; below 0.2 by 0.05 px (development seed, 3,150 edges; 0.05 and 0.03 px in fair light)."""
CLEAR = 0.75
"""Share of the edges that have less than the usual contrast: half of a print may lie in the shade."""
OF_NOISE = 0.5
"""Of the variance of an edge of usual contrast, what grows with the square of the contrast that others lack. In a shade
of 1 to 6 edges were off by 1.7 times as much, those dimmed to a half by grass or a leaf by 2 to 2.6 (45 development
flights); of 0.03 to 1, angles were best at 0.15-0.5 in the sun's shadow and at 1 under grass and leaves."""
MELTING = 6
"""Power with which the variance of an edge grows by its width in cells. With 4 edges 0.7 of a cell wide, which
neighbours pull by 0.4 px, were taken for half as exact as they are (docs/lab/vision-fits.md, room)."""


@dataclass(frozen=True, slots=True, eq=False)
class FoundEdges:
    """Edges along the normals of samples.

    Attributes:
        offsets: from where the pose puts them, towards the bright side, without what light moves `(n,)` [px].
        found: whether an edge of the right sense was found `(n,)`.
        widths: half width of the edges that run the way of each: motion blurs one of two ways `(n,)` [px].
        trust: 1 where both sides of an edge are even and it is as clear as others, less where a shadow's rim or a leaf
            lies beside it or dims it, or light moves it; over the variance of the offset `(n,)`.
        room: what neighbours leave of each, against the one with most room; over the variance of the offset too. An
            edge without room says nothing for a pose and nothing against it `(n,)`.
        blown: share of the edges whose bright side is blown.
        light: unknowns of what light moves; none where it moves nothing.
    """

    offsets: Array
    found: Bools
    widths: Array
    trust: Array
    room: Array
    blown: float = 0.0
    light: Unknown | None = None

    @property
    def width(self) -> float:
        """Half width of the edges of this image [px]."""
        return float(self.widths.mean())

    @property
    def widest(self) -> float:
        """Half width of the edges that run the way of the wider ones [px]."""
        return float(self.widths.max())

    @property
    def toned(self) -> Array:
        """What a tone curve shifts each by over what it shifts all, as their blur `(n,)`."""
        blur = blur_of(self.widths / HALF_WIDTH)
        return np.asarray(blur / blur.mean())


def find_edges(pixels: Grey, samples: Samples, *, is_near: bool = True) -> FoundEdges:
    """Find each edge along its normal.

    The grey values along a normal are g(s), their slope g'(s) > 0 towards the bright side. The edge lies at the centre
    of gravity of the slope around its peak, s0 = sum(s w) / sum(w) with w = max(g'(s) - skirt * peak, 0): unbiased for
    every symmetric blur. Source: moment-based edge location, Lyvers et al., PAMI 11(12), 1989, in one dimension.
    """
    profile, along, spacing = _profiles(pixels, samples)
    # g'(s) by central differences, nothing beyond the reach and half a step more.
    place = along[1:-1].astype(np.float32)
    slope = profile[2:] - profile[:-2]
    either = np.abs(slope)
    np.maximum(slope, 0.0, out=slope)
    away = np.abs(place)[:, None]
    slope *= away <= samples.reach + STEP_PX / 2
    peak = slope.max(axis=0)
    # An edge is as steep as the steep ones of the image, up to a share, and steeper than noise.
    tenth = max(len(peak) // 10, 1)
    steep = peak > max(NOISE_GREY, LIMITS.read.least_contrast * float(np.partition(peak, -tenth)[-tenth]))
    sides = _sides(profile, along, samples.reach)
    are_white = sides >= LIMITS.read.saturated
    cut = steep & are_white[1]
    # Larger cells of either way tell width and light: in small ones a neighbour cuts an edge off.
    longest = [float(samples.reach.max(initial=0.0, where=kind)) for kind in (samples.upright, ~samples.upright)]
    large = samples.reach >= LARGE * np.where(samples.upright, *longest)
    # Width of an edge in this image: area of the slope over its peak.
    area = slope.sum(axis=0) * spacing / np.maximum(peak, 1e-3)
    widths = _widths(area, samples.upright, least_cut(sides[1] - sides[0], steep & large, cut & large)[0])
    centre = place[slope.argmax(axis=0)]
    for _ in range(2):
        # The peak of a wide edge is noise: a first centre of gravity puts the window where the edge is.
        centre = _centre(slope, place, centre, peak, widths)
    found = steep & (np.abs(centre) < samples.reach)
    trust, room = np.ones(len(found)), np.ones(len(found))
    if is_near:
        # A fit that is not yet near its place has other edges beside these.
        either *= (np.abs(place[:, None] - centre) > widths) & (away <= samples.reach + STEP_PX)
        trust = _trust(either.max(axis=0), peak, area * peak, found, cut)
        room /= 1.0 + (LIMITS.cells.melted_widths * widths / samples.cell_px) ** MELTING
        room /= room.max()
    light = light_shift(samples, sides, widths / HALF_WIDTH, found & large, found & cut, is_near=is_near)
    # An edge that was moved far is exact no more.
    trust /= 1.0 + (light.moved / (HALF * LIMITS.edges.located_px)) ** 2
    # What lies wholly in a highlight says nothing for a pose or against it. Where the paper itself is blown a missing
    # edge speaks against a pose as ever.
    is_paper_blown = np.count_nonzero(cut) > HALF * np.count_nonzero(steep)
    hidden = light.flooded if is_paper_blown else light.flooded | (are_white.all(axis=0) & ~steep)
    found &= ~hidden
    room *= ~hidden
    blown = float(np.count_nonzero(found & cut)) / max(int(np.count_nonzero(found)), 1)
    return FoundEdges(centre - light.moved, found, widths, trust, room, blown, light.unsure)


def _profiles(pixels: Grey, samples: Samples) -> tuple[Array32, npt.NDArray[np.floating], float]:
    """Grey values along the normals, a column a sample, the places along them, and from one place to the next [px].

    What is done with each sample runs along rows.
    """
    longest = float(samples.reach.max())
    spacing = max(STEP_PX, longest / STEPS)
    count = int(np.ceil((longest + 1.0) / spacing))
    along = np.arange(-count, count + 1) * spacing
    x = (samples.pixels[:, 0] + along[:, None] * samples.normals[:, 0]).astype(np.float32)
    y = (samples.pixels[:, 1] + along[:, None] * samples.normals[:, 1]).astype(np.float32)
    profile = cv2.remap(pixels, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE).astype(np.float32)
    return profile, along, spacing


def _sides(profile: Array32, along: npt.NDArray[np.floating], reach: Array) -> Array:
    """Grey values at both ends of the profiles, dark and bright `(2, n)`, at their reach `(n,)` [px]."""
    end = np.searchsorted(along, reach, side="right") - 1
    columns = np.arange(profile.shape[1])
    return np.stack([profile[len(along) - 1 - end, columns], profile[end, columns]]).astype(np.float64)


def kinds_of(found: Bools, upright: Bools) -> tuple[Numbers, Numbers]:
    """What was found of the two ways that edges run; all, twice, where one has too few."""
    kinds = np.flatnonzero(found & upright), np.flatnonzero(found & ~upright)
    if min(len(kinds[0]), len(kinds[1])) >= LEAST_OF_A_KIND:
        return kinds
    every = np.flatnonzero(found)
    return every, every


def _widths(area: Array32, upright: Bools, telling: Bools) -> Array:
    """Half width of the edges that run the way of each `(n,)` [px], by their area of the slope over its peak [px]."""
    kinds = kinds_of(telling if bool(telling.any()) else np.ones_like(telling), upright)
    areas = WIDTH_FACTOR * np.where(upright, *(median(area[kind]) for kind in kinds))
    return np.maximum(areas, LIMITS.blur.sharp_px)


def _trust(beside: Array32, peak: Array32, contrast: Array32, found: Bools, cut: Bools) -> Array:
    """Trust in edges `(n,)`.

    A shadow's rim beside an edge is as likely to lie on it, unseen: the variance grows by 1 + (slope / usual)^4. What
    noise moves an edge by grows as its contrast falls, and what dims an edge lies near it; what is cut off is not dim.

    Args:
        beside: largest slope beside each edge `(n,)` [grey].
        peak: of its own slope `(n,)` [grey].
        contrast: of it `(n,)` [grey].
        found: which edges were found `(n,)`.
        cut: which of them are blown `(n,)`.
    """
    usual = found if bool(found.any()) else np.ones_like(found)
    share = (beside / np.maximum(peak, 1e-3)).astype(np.float64)
    uneven = share / (UNEVEN * max(SKIRT, quantile(share[usual], QUARTER)))
    dimmed = np.maximum(quantile(contrast[usual], CLEAR) / np.maximum(contrast, 1e-3), 1.0).astype(np.float64)
    dimmed[cut] = 1.0
    return np.asarray(1.0 / ((1.0 + uneven**4) * (1.0 + OF_NOISE * (dimmed**2 - 1.0))))


def _centre(slope: Array32, place: Array32, around: Array32, peak: Array32, widths: Array) -> Array32:
    """Centre of gravity of each slope, a column, within its width of a place `(n,)` [px]."""
    body = slope - SKIRT * peak
    np.maximum(body, 0.0, out=body)
    body *= np.abs(place[:, None] - around) <= widths
    moment, mass = np.stack([place, np.ones_like(place)]) @ body
    found: Array32 = moment / np.maximum(mass, 1e-6)
    return found
