"""Finding the edges of an image along the normals of projected samples, to a fraction of a pixel.

Light moves edges. Grey values on both sides of all edges are a quadratic in the image each.

Where the contrast of an edge grows along its normal by a share c for each pixel, its bright side slopes, and the centre
of gravity of the slope moves by c sigma^2 times a factor, with sigma the deviation of the slope. Edges that the light
does not explain, as across a hard shadow, are left alone.

Where the bright side is blown, clipping moves the edge. A blurred edge rises from the grey value d by the contrast c as
d + c Phi(s / sigma). What lies above the largest grey value is cut off, a share 1 - q with q = (top - d) / c, and the
centre of gravity of the slope that is left lies at -sigma lambda(z), with lambda = phi / Phi, z = Phi^-1(q). Dark sides
say how much is cut off; blur and contrast are known nearly and fitted with the pose.

Source: mean of a truncated normal distribution, Johnson and Kotz, Continuous Univariate Distributions, 13.10.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import erf, pi, sqrt

import cv2
import numpy as np

from mkdaemon.vision.arrays import Array, Array32, Bools, Grey, Numbers
from mkdaemon.vision.camera.image import BRIGHTEST
from mkdaemon.vision.limits import HALF, LIMITS, NOISE_GREY
from mkdaemon.vision.pose.edgemodel import Samples
from mkdaemon.vision.pose.pose import median, quantile
from mkdaemon.vision.pose.unknowns import UnknownRow

STEP_PX = 0.5
"""Distance of the grey values along a normal [px]; more while the reach is long."""
STEPS = 12.0
"""Number of steps of a long reach."""
WIDTH_FACTOR = 0.9
"""Half width of the window in which an edge's centre is taken, over the width of its slope."""
HALF_WIDTH = WIDTH_FACTOR * sqrt(2.0 * pi)
"""The same over the deviation of a Gaussian point spread."""
SKIRT = 0.15
"""Share of the peak slope that is taken off before a centre is computed: texture and noise have no say in it."""
LEAST_OF_A_KIND = 10
"""Least number of edges of one direction for a separate median."""
LARGE = 0.7
"""Reach over the longest of one direction, of edges that tell how wide they are."""
QUARTER = 0.25
"""Of the edges, the flattest ones, have nothing but noise beside them."""
UNEVEN = 2.0
"""Slope beside an edge, over what the skirt takes off or the flattest quarter of the edges has, from which something
else than noise is there: edges beside more were off by 0.3 px, beside less by 0.05 (leaf shadows, 3,150 edges)."""
CLEAR = 0.75
"""Share of the edges that have less than the usual contrast: half of a print may lie in the shade."""
OF_NOISE = 0.5
"""Of the variance of an edge of usual contrast, what grows with the square of the contrast that others lack. Of 0.03 to
1, angles were best at 0.15-0.5 in the sun's shadow and at 1 under grass and leaves (45 development flights)."""
MELTING = 6
"""Power with which the variance of an edge grows by its width in cells (docs/lab/vision-fits.md, room)."""
PLACES = np.linspace(-3.0, 2.0, 201)
"""At which the two functions below are tabled [sigma]: shares of 0.1 to 98 %."""
BELOW = np.array([(1.0 + erf(z / sqrt(2.0))) / 2.0 for z in PLACES])
"""Share q of an edge below each place."""
DENSITY = np.exp(-(PLACES**2) / 2.0) / sqrt(2.0 * pi)
MOVED = DENSITY / BELOW
"""The mean's distance lambda(z) [sigma]."""
BY_CONTRAST = BELOW * MOVED * (PLACES + MOVED) / DENSITY
"""Derivative of lambda by the logarithm of the contrast."""
LOOKED = 0.25
"""Variance that looking at the slope adds to the blur: linear interpolation and differences over a pixel [px^2]."""
LEAST_BLUR = 0.3
"""Variance of the sharpest blur, and of the pixel itself [px^2]."""
ENOUGH = 20
"""Edges that show contrast and blur of this image."""
AHEAD = 2.0
"""Where the dark side's light grows along the normal, the slope is cut this far beyond the edge, in widths of the slope
(1.4 to 2.4 for edges rendered at 1 and 2 grey/px)."""
ROUNDS = 3
"""Of weights and light, where that is not even at a first look."""
LEAST_CUT = 0.8
"""Quantile of the contrast from which edges are taken for the clearest, where every bright side is blown."""
BEYOND = 1.2
"""Their whole contrast over what is seen of it."""
GROWTH_MOVES = 1.9
"""Share of sigma^2 c that an edge moves: edges drawn with a point spread of 0.5 to 1.5 px, 1.7 to 2.1."""
UNSURE = 0.5
"""Share of what the light moves that is unsure, and by which it may move edges another way: NEES 1.2-1.4 behind dirt
and 0.8-1.0 under a shadow's rim."""
EVEN_PX = 0.003
"""What the light may move edges without being asked, root mean square [px]: below a third of `systematic_px`."""
ENOUGH_FOR_LIGHT = 60
"""Edges that show how the light changes."""
RIDGE = 1e-6


@dataclass(frozen=True, slots=True, eq=False)
class FoundEdges:
    """Edges along the normals of samples.

    Attributes:
        offsets: from where the pose puts them, towards the bright side, without what light moves `(n,)` [px].
        found: whether an edge of the right sense was found `(n,)`.
        widths: half width of the edges that run the way of each: motion blurs one of two ways `(n,)` [px].
        trust: 1 where both sides of an edge are even and it is as clear as others, less elsewhere; over the variance of
            the offset `(n,)`.
        room: what neighbours leave of each, against the one with most room; over the variance of the offset too
            `(n,)`. An edge without room says nothing for a pose or against it.
        blown: share of the edges whose bright side is blown.
        light: unknowns of what light moves; none where it moves nothing.
    """

    offsets: Array
    found: Bools
    widths: Array
    trust: Array
    room: Array
    blown: float = 0.0
    light: UnknownRow | None = None

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
        """Shift of each edge by a tone curve over the common shift, by their blur `(n,)`."""
        blur = _blur_of(self.widths / HALF_WIDTH)
        return np.asarray(blur / blur.mean())


def find_edges(pixels: Grey, samples: Samples) -> FoundEdges:
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
    longest = [float((samples.reach * kind).max()) for kind in (samples.upright, ~samples.upright)]
    of_longest = samples.reach / np.where(samples.upright, *longest)
    large = of_longest >= LARGE
    # Width of an edge in this image: area of the slope over its peak.
    area = slope.sum(axis=0) * spacing / np.maximum(peak, 1e-3)
    widths = _widths(area, samples.upright, _least_cut(sides[1] - sides[0], steep & large, cut)[0])
    centre = place[slope.argmax(axis=0)]
    body = slope - SKIRT * peak
    np.maximum(body, 0.0, out=body)
    for _ in range(2):
        # The peak of a wide edge is noise: a first centre of gravity puts the window where the edge is.
        centre = _centre(body, place, centre, widths)
    found = steep & (np.abs(centre) < samples.reach)
    # Where a pose is off by more than a small cell reaches, the edge that is found there is another one.
    trust, room = of_longest**2, np.ones(len(found))
    if samples.are_near:
        either *= (np.abs(place[:, None] - centre) > widths) & (away <= samples.reach + STEP_PX)
        trust = _trust(either.max(axis=0), peak, area * peak, found, cut)
        room /= 1.0 + (LIMITS.cells.melted_widths * widths / samples.cell_px) ** MELTING
        room /= room.max()
    blown, slope_sd = found & cut, widths / HALF_WIDTH
    moved, light, flooded = np.zeros(len(found)), None, np.zeros_like(found)
    if bool(blown.any()):
        moved, light, flooded = _blown(samples, sides, slope_sd, found, blown)
    elif samples.are_near and np.count_nonzero(found & large) >= ENOUGH_FOR_LIGHT:
        # Sides are seen at their plain grey values once places are nearly known.
        moved, light = _grown(samples, sides, slope_sd, found & large)
    # An edge that was moved far is exact no more.
    trust /= 1.0 + (moved / (HALF * LIMITS.edges.located_px)) ** 2
    # What lies wholly in a highlight says nothing for a pose or against it. Where the paper itself is blown a missing
    # edge speaks against a pose as ever.
    if np.count_nonzero(cut) <= HALF * np.count_nonzero(steep):
        flooded |= are_white.all(axis=0) & ~steep
    found &= ~flooded
    room *= ~flooded
    share = float(np.count_nonzero(found & cut)) / max(int(np.count_nonzero(found)), 1)
    return FoundEdges(centre - moved, found, widths, trust, room, share, light)


def _profiles(pixels: Grey, samples: Samples) -> tuple[Array32, Array, float]:
    """Grey values along the normals, a column a sample, the places along them, and from one place to the next [px]."""
    longest = float(samples.reach.max())
    spacing = max(STEP_PX, longest / STEPS)
    count = int(np.ceil((longest + 1.0) / spacing))
    along = np.asarray(np.arange(-count, count + 1) * spacing, np.float64)
    x = (samples.pixels[:, 0] + along[:, None] * samples.normals[:, 0]).astype(np.float32)
    y = (samples.pixels[:, 1] + along[:, None] * samples.normals[:, 1]).astype(np.float32)
    profile = cv2.remap(pixels, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE).astype(np.float32)
    return profile, along, spacing


def _sides(profile: Array32, along: Array, reach: Array) -> Array:
    """Grey values at both ends of the profiles, dark and bright `(2, n)`, at their reach `(n,)` [px]."""
    end = np.searchsorted(along, reach, side="right") - 1
    columns = np.arange(profile.shape[1])
    return np.array([profile[len(along) - 1 - end, columns], profile[end, columns]]).astype(np.float64)


def kinds_of(found: Bools, upright: Bools) -> list[Numbers]:
    """Edges of each of the two directions; all together, if one has too few."""
    every = found.nonzero()[0]
    kinds = ((found & kind).nonzero()[0] for kind in (upright, ~upright))
    return [kind if len(kind) >= LEAST_OF_A_KIND else every for kind in kinds]


def _widths(area: Array32, upright: Bools, telling: Bools) -> Array:
    """Half width of the edges that run the way of each `(n,)` [px], by their area of the slope over its peak [px]."""
    kinds = kinds_of(telling if bool(telling.any()) else np.ones_like(telling), upright)
    areas = WIDTH_FACTOR * np.where(upright, *(median(area[kind]) for kind in kinds))
    return np.maximum(areas, LIMITS.blur.sharp_px)


def _trust(beside: Array32, peak: Array32, contrast: Array32, found: Bools, cut: Bools) -> Array:
    """Trust in edges `(n,)`, by the largest slope beside each, its own peak, and its contrast [grey].

    A shadow's rim beside an edge is as likely to lie on it, unseen: the variance grows by 1 + (slope / usual)^4. What
    noise moves an edge by grows as its contrast falls; what is cut off is not dim.
    """
    usual = found if bool(found.any()) else np.ones_like(found)
    share = (beside / np.maximum(peak, 1e-3)).astype(np.float64)
    uneven = share / (UNEVEN * max(SKIRT, quantile(share[usual], QUARTER)))
    dimmed = np.maximum(quantile(contrast[usual], CLEAR) / np.maximum(contrast, 1e-3), 1.0).astype(np.float64)
    dimmed[cut] = 1.0
    return np.asarray(1.0 / ((1.0 + uneven**4) * (1.0 + OF_NOISE * (dimmed**2 - 1.0))))


def _centre(body: Array32, place: Array32, around: Array32, widths: Array) -> Array32:
    """Centre of gravity of each body of a slope, a column, within its width of a place `(n,)` [px]."""
    moment, mass = np.array([place, np.ones_like(place)]) @ (body * (np.abs(place[:, None] - around) <= widths))
    found: Array32 = moment / np.maximum(mass, 1e-6)
    return found


class _Light:
    """Grey values of the paper, or the ink, beside edges, as quadratics in the image, by a robust fit.

    Attributes:
        place: of the edges in the part of the image that these take, -1 to 1 `(n, 2)`.
        grey: of each side that is asked for, at each edge `(k, n)`.
        rise: slope of that along its normal `(k, n)` [grey/px].
        scatter: of the sides around it, of the one with most [grey].
    """

    def __init__(self, samples: Samples, sides: Array, telling: Bools, rounds: int = ROUNDS) -> None:
        middle = samples.pixels.mean(axis=0)
        size = max(float(np.abs(samples.pixels - middle).max()), 1.0)
        self.place = (samples.pixels - middle) / size
        x, y = self.place.T
        across, down = samples.normals.T / size
        # grey = a + b x + c y + d x^2 + e x y + f y^2, and its derivative along the normal, both linear in a..f.
        powers = np.array([np.ones_like(x), x, y, x * x, x * y, y * y])
        slopes = np.array([np.zeros_like(x), across, down, 2.0 * x * across, y * across + x * down, 2.0 * y * down])
        weights, ridge = telling.astype(np.float64), RIDGE * np.eye(len(powers))
        for _ in range(rounds):
            weighted = powers * weights
            terms = np.linalg.solve(weighted @ powers.T + ridge, weighted @ sides.T).T
            self.grey = terms @ powers
            residual = np.abs(sides - self.grey).max(axis=0)
            self.scatter = max(median(residual[telling]), 1.0)
            # The weights of Cauchy's distribution: what a shadow or a reflection changes counts little.
            weights = telling / (1.0 + (residual / self.scatter) ** 2)
        self.rise = terms @ slopes


def _grown(samples: Samples, sides: Array, slope_sd: Array, whole: Bools) -> tuple[Array, UnknownRow | None]:
    """How far light that grows over a print moves edges `(n,)` [px], and what of that is unsure; none where it is even.

    Unsure are a share of that, and shifts in proportion that grow evenly over the print, e = n . (a + B x).
    """
    for rounds in (1, ROUNDS):
        light = _Light(samples, sides, whole, rounds)
        contrast = np.maximum(light.grey[1] - light.grey[0], light.scatter)
        # Beside a step blurred by s the sides rise by g0 and g1 along the normal: the steepest place moves by
        # s^2 (g1 - g0) / contrast, times a factor that drawn edges gave.
        moved: Array = GROWTH_MOVES * slope_sd**2 * (light.rise[1] - light.rise[0]) / contrast
        if rounds == ROUNDS:
            # Where light does not explain the sides it says nothing of the edges.
            beside = np.maximum(np.abs(sides - light.grey).max(axis=0), light.scatter)
            moved /= 1.0 + (beside / (LIMITS.read.faint * contrast)) ** 4
        size = float(np.sqrt(np.mean(moved**2)))
        if size < EVEN_PX:
            return np.zeros_like(moved), None
    (x, y), (across, down) = light.place.T, samples.normals.T
    even = size * np.array([across, down, across * x, across * y, down * x, down * y])
    rows = UNSURE * np.array([moved, *even])
    return moved, UnknownRow("grown", rows, np.ones(len(rows)))


def _blown(
    samples: Samples, sides: Array, slope_sd: Array, found: Bools, cut: Bools
) -> tuple[Array, UnknownRow, Bools]:
    """The same by clipping where edges are `cut`, and edges whose ink is blown, too: a highlight shows nothing there.

    Unsure are, as shares, the blur of the edges that run either way and the contrast. A flooded edge is no missing one,
    as long as enough others are left to be missed.
    """
    contrast, blur = sides[1] - sides[0], _blur_of(slope_sd)
    clearest, beyond = _least_cut(contrast, found, cut)
    usual = beyond * median(contrast[clearest])
    light = _Light(samples, sides[:1], found)
    dark = sides[0] + (samples.reach + AHEAD * slope_sd) * light.rise[0]
    # Where the whole step would be cut by 255, as a share of it.
    place = np.interp((BRIGHTEST - dark) / max(usual, 1.0), BELOW, PLACES)
    moved = -blur * np.interp(place, PLACES, MOVED) * cut
    by_contrast = -blur * np.interp(place, PLACES, BY_CONTRAST) * cut
    rows = np.array([samples.upright * moved, ~samples.upright * moved, by_contrast])
    flooded = light.grey[0] >= LIMITS.read.saturated - LIMITS.read.nearly_blown
    if float(flooded.mean()) >= HALF:
        flooded = np.zeros_like(flooded)
    return moved, UnknownRow("blown", rows, np.full(len(rows), LIMITS.edges.clipped_sd**-2)), flooded


def _least_cut(contrast: Array, telling: Bools, cut: Bools) -> tuple[Bools, float]:
    """Of some edges those that come nearest to whole ones `(n,)`, and their whole contrast over what is seen of it."""
    whole = telling & ~cut
    if int(whole.sum()) >= ENOUGH or not bool((telling & cut).any()):
        return whole, 1.0
    return telling & (contrast >= quantile(contrast[telling], LEAST_CUT)), BEYOND


def _blur_of(width: Array) -> Array:
    """Deviation of the blur of edges, by that of their slopes `(n,)` [px]."""
    return np.asarray(np.sqrt(np.maximum(width**2 - LOOKED, LEAST_BLUR)))
