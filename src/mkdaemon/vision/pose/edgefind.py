"""Finding the edges of an image along the normals of projected samples, to a fraction of a pixel."""

from __future__ import annotations

from dataclasses import dataclass, fields
from math import pi, sqrt

import cv2
import numpy as np
import numpy.typing as npt

from mkdaemon.vision.arrays import Array, Grey
from mkdaemon.vision.limits import HALF, LIMITS, NOISE_GREY
from mkdaemon.vision.pose.edgelight import SLOPE_WIDTH, Blown, EdgeSides, blown_edges, blur_of
from mkdaemon.vision.pose.pose import median, quantile

Array32 = npt.NDArray[np.float32]

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
WIDEST_PX = 8.0
"""Wider edges are taken for this wide [px]: the window would reach the neighbouring edge."""
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
class Samples:
    """Samples of an edge model, projected.

    Attributes:
        index: which of the model `(n,)`.
        pixels: where a pose puts them `(n, 2)` [px].
        normals: towards the brighter side, unit `(n, 2)`.
        reach: how far along the normal the edge may be `(n,)` [px].
        by_point: derivative of the position along the normal by the point of the print `(n, 3)` [px/m; camera].
        arm: from the target's origin to that point `(n, 3)` [m; camera].
        times: when each is exposed after the middle row, under a rolling shutter `(n,)` [s].
        cell_px: side of its cells along the normal `(n,)` [px].
        upright: whether a move along x of the target shifts it `(n,)`, rather than one along y.
    """

    index: npt.NDArray[np.intp]
    pixels: Array
    normals: Array
    reach: Array
    by_point: Array
    arm: Array
    times: Array
    cell_px: Array
    upright: npt.NDArray[np.bool_]


@dataclass(frozen=True, slots=True, eq=False)
class FoundEdges:
    """Edges along the normals of samples.

    Attributes:
        offsets: from where the pose puts them, towards the bright side `(n,)` [px].
        found: whether an edge of the right sense was found `(n,)`.
        width: half width of the edges of this image [px].
        widths: the same of those that run the way of each: motion blurs one of two ways `(n,)` [px].
        toned: what a tone curve shifts each by over what it shifts all, as their blur `(n,)`.
        trust: 1 where both sides of an edge are even and it is as clear as others, less where a shadow's rim or a leaf
            lies beside it or dims it; over the variance of the offset `(n,)`.
        room: what neighbours leave of each, against the one with most room; over the variance of the offset too. An
            edge without room says nothing for a pose and nothing against it `(n,)`.
        blown: what clipping does to the edges, already out of `offsets`; none where nothing is blown.
        sides: what lies beside the edges, where their places are nearly known.
        unsure: errors that they may have in common, each a deviation with its signs `(k, n)` [px].
    """

    offsets: Array
    found: npt.NDArray[np.bool_]
    width: float
    widths: Array
    toned: Array
    trust: Array
    room: Array
    blown: Blown | None = None
    sides: EdgeSides | None = None
    unsure: Array | None = None

    @property
    def widest(self) -> float:
        """Half width of the edges that run the way of the wider ones [px]."""
        return float(self.widths.max())


def without_glare(pixels: Grey, samples: Samples) -> Samples:
    """Leave out what lies wholly in a highlight: nothing is seen there, for a pose or against it.

    Where the paper itself is blown everything stays: a missing edge speaks against a pose then as ever.
    """
    near = samples.reach[:, None] * samples.normals
    columns, rows = np.rint(np.stack([samples.pixels - near, samples.pixels, samples.pixels + near])).astype(np.intp).T
    grey = pixels[rows, columns] >= LIMITS.read.saturated
    hidden = grey.all(axis=1)
    if not bool(hidden.any()) or bool(hidden.all()) or float(grey[~hidden, 2].mean()) > HALF:
        return samples
    return Samples(*(getattr(samples, part.name)[~hidden] for part in fields(samples)))


def find_edges(pixels: Grey, samples: Samples, *, is_blown: bool = False, is_near: bool = True) -> FoundEdges:
    """Find each edge along its normal.

    The grey values along a normal are g(s), their slope g'(s) > 0 towards the bright side. The edge lies at the centre
    of gravity of the slope around its peak, s0 = sum(s w) / sum(w) with w = max(g'(s) - skirt * peak, 0): unbiased for
    every symmetric blur. Source: moment-based edge location, Lyvers et al., PAMI 11(12), 1989, in one dimension.
    """
    blur = LIMITS.blur
    profile, along, spacing = _profiles(pixels, samples)
    # g'(s) by central differences, nothing beyond the reach and half a step more.
    place = along[1:-1].astype(np.float32)
    slope = profile[2:] - profile[:-2]
    either = np.abs(slope) if is_near else slope
    np.maximum(slope, 0.0, out=slope)
    away = np.abs(place)[:, None]
    slope *= away <= samples.reach + STEP_PX / 2
    centre = place[slope.argmax(axis=0)]
    peak = slope.max(axis=0)
    # Width of an edge in this image: area of the slope over its peak, median over the samples.
    area = slope.sum(axis=0) * spacing / np.maximum(peak, 1e-3)
    width = min(max(WIDTH_FACTOR * median(area), blur.sharp_px), WIDEST_PX)
    areas = _areas(area, samples)
    widths = np.maximum(WIDTH_FACTOR * areas, width).astype(np.float32)
    for _ in range(2 if width > blur.sharp_px else 1):
        # The peak of a wide edge is noise: a first centre of gravity puts the window where the edge is.
        centre = _centre(slope, place, centre, peak, widths)
    offsets = centre
    # An edge is as steep as the steep ones of the image, up to a share, and steeper than noise.
    tenth = max(len(peak) // 10, 1)
    enough = max(NOISE_GREY, LIMITS.read.least_contrast * float(np.partition(peak, -tenth)[-tenth]))
    found = (peak > enough) & (np.abs(offsets) < samples.reach)
    trust, toned, room = (np.ones(len(found)) for _ in range(3))
    sides: EdgeSides | None = None
    if is_near:
        toned = blur_of(areas / SLOPE_WIDTH)
        toned /= toned.mean()
        # A fit that is not yet near its place has other edges beside these.
        beside = np.abs(place[:, None] - offsets)
        either *= (beside > widths) & (away <= samples.reach + STEP_PX)
        trust = _trust(either.max(axis=0), peak, found)
        sides = _sides(profile, along, samples, area)
        room = 1.0 / (1.0 + (LIMITS.cells.melted_widths * widths / samples.cell_px) ** MELTING)
        room /= float(room.max())
    located = offsets.astype(np.float64)
    blown: Blown | None = None
    if is_blown:
        blown = blown_edges(sides or _sides(profile, along, samples, area), found, samples.upright)
    if is_near:
        clarity = _clarity(area * peak, found)
        # What is cut off is not dim: `clear` doubts it.
        trust *= clarity if blown is None else np.where(blown.clear < 1.0, 1.0, clarity)
    if blown is not None:
        located -= blown.moved
        if is_near and float(blown.shown.mean()) > HALF:
            # A flooded edge is no missing one, as long as enough others are left to be missed.
            found &= blown.shown
            room *= blown.shown
    return FoundEdges(located, found, width, widths.astype(np.float64), toned, trust, room, blown, sides)


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


def _areas(area: Array32, samples: Samples) -> Array:
    """Area of the slope over its peak, of those that run the way of each `(n,)` [px].

    Told by the larger cells: in small ones a neighbour cuts an edge off.
    """
    areas: Array = np.full(len(area), median(area))
    for kind in (samples.upright, ~samples.upright):
        if int(kind.sum()) >= LEAST_OF_A_KIND:
            areas[kind] = median(area[kind & (samples.reach >= LARGE * float(samples.reach[kind].max()))])
    return areas


def _sides(
    profile: Array32, along: npt.NDArray[np.floating], samples: Samples, area: npt.NDArray[np.floating]
) -> EdgeSides:
    """Both ends of the profiles, one a column, at their reach."""
    end = np.searchsorted(along, samples.reach, side="right") - 1
    columns = np.arange(profile.shape[1])
    dark, bright = profile[len(along) - 1 - end, columns], profile[end, columns]
    return EdgeSides(
        dark.astype(np.float64),
        bright.astype(np.float64),
        area,
        samples.pixels,
        samples.normals,
        along[end].astype(np.float64),
    )


def _trust(beside: Array32, peak: Array32, found: npt.NDArray[np.bool_]) -> Array:
    """Trust in edges with so much slope beside them and at their peak `(n,)`.

    A shadow's rim beside an edge is as likely to lie on it, unseen. The variance grows by 1 + (slope / usual)^4.
    """
    share = beside / np.maximum(peak, 1e-3)
    usual = SKIRT
    if bool(found.any()):
        usual = max(usual, quantile(share[found], QUARTER))
    trust: Array = 1.0 / (1.0 + (share.astype(np.float64) / (UNEVEN * usual)) ** 4)
    return trust


def _clarity(contrast: Array32, found: npt.NDArray[np.bool_]) -> Array:
    """Trust in edges of some contrast [grey], against those of the usual one `(n,)`.

    What noise moves an edge by grows as its contrast falls, and what dims an edge lies near it.
    """
    if not bool(found.any()):
        return np.ones(len(found))
    dimmed = np.maximum(quantile(contrast[found], CLEAR) / np.maximum(contrast, 1e-3), 1.0).astype(np.float64)
    clarity: Array = 1.0 / (1.0 + OF_NOISE * (dimmed**2 - 1.0))
    return clarity


def _centre(
    slope: npt.NDArray[np.float32],
    place: npt.NDArray[np.float32],
    around: npt.NDArray[np.float32],
    peak: npt.NDArray[np.float32],
    widths: Array32,
) -> npt.NDArray[np.float32]:
    """Centre of gravity of each slope, a column, within its width of a place `(n,)` [px]."""
    body = slope - SKIRT * peak
    np.maximum(body, 0.0, out=body)
    body *= np.abs(place[:, None] - around) <= widths
    moment, mass = np.stack([place, np.ones_like(place)]) @ body
    found: npt.NDArray[np.float32] = moment / np.maximum(mass, 1e-6)
    return found
