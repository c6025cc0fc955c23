"""What a known print looks like in the image from a pose: each pixel looks up where its ray meets the print.

The print is drawn once and blurred to a row of levels. A pixel sees it through a point spread: that of the lens and of
the pixel, which a slanted print makes longer one way, and the even streak of a motion. What is round of it is a level,
what is longer one way are places beside each other that are looked up and added. From the level to the right blur leads
the heat equation: a blur whose covariance grows by D adds (D_xx m_xx + 2 D_xy m_xy + D_yy m_yy) / 2.

Source: mip maps, Williams, SIGGRAPH 1983, with a Gaussian in place of the box; long footprints by several round ones,
McCormack et al., "Feline", SIGGRAPH 1999.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from math import ceil, log2, sqrt
from typing import Final

import cv2
import numpy as np
import numpy.typing as npt

from mkdaemon.vision.arrays import Array, Bools, Grey
from mkdaemon.vision.limits import HALF, LIMITS
from mkdaemon.vision.pose.bend import Sheet
from mkdaemon.vision.pose.projection import Projection
from mkdaemon.vision.pose.rolling import exposed, skew
from mkdaemon.vision.tags.tagmap import ONE_PLANE, Tag, Target

Image32 = npt.NDArray[np.float32]

TEXELS: Final = 24
"""Of a cell, each way, of a drawn print."""
TEXEL_PARTS: Final = 8
"""Sub-samples of a texel, each way, where cells of a smaller tag end within it."""
SHARPEST, SOFTEST = 0.05, 2.0
"""Deviation of the blur of the first level, and of the last [cells]."""
PER_OCTAVE: Final = 4
"""Levels from a variance to twice as much: the heat equation is then right to 0.1 % of the contrast."""
STEP: Final = 0.4
"""From a texel to the next, of the blur of a level: interpolated to 0.5 % of the contrast."""
APART: Final = 1.3
"""From a place that is looked up to the next one, over the blur: together they are even to 0.1 %."""
WIDE: Final = 2.5
"""Deviations of what is longer one way that are looked up."""
MOST_PLACES: Final = 48
"""That a slant, or a streak, is looked up at: a print seen from its edge has no end of them."""
ROUND: Final = 0.25
"""Share of the variance by which a point spread may be longer one way and still be looked up at one place."""
TINY: Final = 1e-9
"""Least variance of what is seen of a plane [cells^2], and least distance of the camera from it [m]."""
BOX: Final = 12.0
"""Square of a box's length over its variance: what motion blur adds is a box, and so is a pixel."""
LEAST_STREAK_PX: Final = 0.3
"""Shorter streaks are taken for round [px]."""
LENS_PATCH: Final = 0.7
"""Share of the window at whose corners the lens is taken: the error of an affine lens is least in the middle."""
SQUARE: Final = np.array([[-1.0, 1.0], [1.0, 1.0], [1.0, -1.0], [-1.0, -1.0]])
"""Corners of a print, in halves of its side."""


@dataclass(frozen=True, slots=True, eq=False)
class PrintSamples:
    """A print's pixels: model and image.

    Attributes:
        value: of the model, 0 black to 1 white `(n,)`.
        dx: its slope by the column of the image `(n,)` [1/px]; along a row, whose time under a rolling shutter stays.
        dy: by the row, as all rows are exposed when this one is.
        by_spread: derivative by the point spread's xx, xy and yy `(3, n)` [1/px^2].
        u: place on the print, along its x axis `(n,)` [m].
        v: along its y axis.
        row: of the image `(n,)`.
        grey: of the image `(n,)`.
        used: which pixels of the window these are `(rows, columns)`.
    """

    value: Array
    dx: Array
    dy: Array
    by_spread: Array
    u: Array
    v: Array
    row: Array
    grey: Array
    used: Bools

    @property
    def steep(self) -> Array:
        """Squared slope of the model `(n,)` [1/px^2]."""
        return self.dx**2 + self.dy**2


@dataclass(frozen=True, slots=True, eq=False)
class _Window:
    """The part of an image that a print is in.

    Attributes:
        left: its first column.
        top: its first row.
        used: which of its pixels are of the print `(rows, columns)`.
        u: place on the print of these `(n,)` [m].
        v: the other way.
        row: of the image `(n,)`.
        plane: derivative of the place by the pixel, two rows `(2, 2, n)` [m/px].
        middle: the same in the middle of the print `(2, 2)` [m/px].
    """

    left: int
    top: int
    used: Bools
    u: Array
    v: Array
    row: npt.NDArray[np.intp]
    plane: Array
    middle: Array


@dataclass(frozen=True, slots=True, eq=False)
class Footprint:
    """What a pixel sees of a plane.

    Attributes:
        narrow: variance of the round part, with the pixel [px^2].
        streak: length of the motion [px]; none where the point spread is round.
        axes: across the streak and along it, unit, a column each `(2, 2)` [image].
        spread: covariance of what is looked up at one place `(2, 2)`.
        places: that are looked up about the pixel's own `(2, k)`.
        weights: of these `(k,)`, one together.
        along: where each is in the streak, -1/2 to 1/2 `(k,)`.
    """

    narrow: float
    streak: float
    axes: Array
    spread: Array
    places: Array
    weights: Array
    along: Array

    @classmethod
    def of(cls, spread: Array, plane: Array) -> Footprint:
        """Of a point spread `(2, 2)` [px^2] through the derivative of the plane by the pixel `(2, 2)`.

        What is longer one way is a streak [px]; the rest, with the pixel, is round until the plane slants it.
        """
        values, axes = np.linalg.eigh(spread)
        streak = sqrt(BOX * float(values[1] - values[0]))
        if streak < LEAST_STREAK_PX:
            streak = 0.0
        narrow = float(values[0] if streak else values.mean()) + 1.0 / BOX
        sizes, ways = np.linalg.eigh(narrow * plane @ plane.T)
        least, more = max(float(sizes[0]), TINY), float(sizes[1] - sizes[0])
        places, weights, round_part = np.zeros((2, 1)), np.ones(1), narrow * plane @ plane.T
        along = np.zeros(1)
        if more > ROUND * least:
            at, weights = _along(sqrt(more), sqrt(least))
            places, round_part = ways[:, 1:] * at, least * np.eye(2)
        if streak:
            way = streak * plane @ axes[:, 1]
            count = min(
                max(ceil(float(np.hypot(*way)) / (APART * sqrt(least))), 2), max(MOST_PLACES // len(weights), 2)
            )
            # The middles of even parts, a little farther apart, so that they have the variance of the streak.
            even = ((np.arange(count) + 0.5) / count - 0.5) / sqrt(1.0 - 1.0 / count**2)
            places = (places[:, :, None] + way[:, None, None] * even).reshape(2, -1)
            along = np.tile(even, len(weights))
            weights = np.repeat(weights, count) / count
        return cls(narrow, streak, axes, round_part, places, weights, along)

    def by_spread(self, narrower: Array, by_way: Array) -> Array:
        """Derivative `(3, n)` of what is seen by xx, xy, yy of the point spread.

        A round blur obeys the heat equation. The variances l1 across and l2 along the streak are those of B, so that
        its length is sqrt(12 (l2 - l1)), and an angle turns by u^T dB v / (l2 - l1) with the axes u and v.

        Args:
            narrower: derivative by the variance of the round part `(n,)` [1/px^2].
            by_way: by the streak as a vector `(2, n)` [1/px; image].
        """
        (u0, v0), (u1, v1) = self.axes
        across = np.array([u0 * u0, 2.0 * u0 * u1, u1 * u1])[:, None]
        along = np.array([v0 * v0, 2.0 * v0 * v1, v1 * v1])[:, None]
        turns = np.array([u0 * v0, u0 * v1 + u1 * v0, u1 * v1])[:, None]
        longer = (v0 * by_way[0] + v1 * by_way[1]) * (BOX / (2.0 * self.streak))
        turned = (u0 * by_way[0] + u1 * by_way[1]) * (BOX / self.streak)
        return np.asarray(across * (narrower - longer) + along * longer + turns * turned, np.float64)


def _along(deviation: float, blur: float) -> tuple[Array, Array]:
    """Places of a Gaussian and their weights, `(k,)` each, none farther from the next than blur allows."""
    reach = min(ceil(WIDE * deviation / (APART * blur)), MOST_PLACES // 4 - 1)
    at = np.arange(-reach, reach + 1) * (WIDE * deviation / reach)
    weights: Array = np.exp(-0.5 * (at / deviation) ** 2)
    weights /= weights.sum()
    return np.asarray(at * (deviation / sqrt(float(weights @ at**2))), np.float64), weights


class PrintTexture:
    """A drawn print and its softer levels, each made when it is first asked for.

    Args:
        drawn: `(side, side)`, 0 black to 1 white, `TEXELS` a cell.
    """

    def __init__(self, drawn: Image32) -> None:
        self._drawn = drawn
        self._cells = len(drawn) / TEXELS
        self._levels: dict[int, tuple[Image32, Image32]] = {}

    def _level(self, number: int) -> tuple[Image32, Image32]:
        """Value and its slopes, then the second derivatives, `(side, side, 3)` each."""
        if number not in self._levels:
            blur = SHARPEST * 2.0 ** (number / PER_OCTAVE / 2)
            side = min(ceil(self._cells / (STEP * blur)), len(self._drawn))
            # Texels that are averaged and interpolated blur, too.
            step = self._cells / side
            variance = blur**2 - step**2 / 4.0
            soft = cv2.GaussianBlur(self._drawn, (0, 0), sqrt(variance) * TEXELS, borderType=cv2.BORDER_REPLICATE)
            down, right = (slope * TEXELS for slope in np.gradient(soft))
            cross, along = (slope * TEXELS for slope in np.gradient(right))
            across = np.gradient(down, axis=0) * TEXELS
            planes = [soft, right, -down], [along, -cross, across]
            first, second = (cv2.resize(cv2.merge(p), (side, side), interpolation=cv2.INTER_AREA) for p in planes)
            self._levels[number] = np.asarray(first, np.float32), np.asarray(second, np.float32)
        return self._levels[number]

    def at(self, x: Array, y: Array, footprint: Footprint, more: Array) -> Array:
        """What is seen at places of the print `(8, n)`.

        Value, slopes by x and y, second derivatives by xx, xy, yy, and the slopes by where in a streak they are.

        Args:
            x: `(n,)` [cells from the middle].
            y: `(n,)`, up.
            footprint: of all places.
            more: what the covariance of each has beyond that, by xx, xy, yy `(3, n)` [cells^2].
        """
        mean = float(np.trace(footprint.spread)) / 2.0
        most = 2 * PER_OCTAVE * log2(SOFTEST / SHARPEST)
        number = round(min(max(PER_OCTAVE * log2(mean / SHARPEST**2), 0.0), most))
        seen_x, seen_y = (
            (at + place[:, None]).astype(np.float32) for at, place in zip((x, y), footprint.places, strict=True)
        )
        found = np.zeros((8, len(x)))
        weights, along = (part.astype(np.float32) for part in (footprint.weights, footprint.weights * footprint.along))
        for k, image in enumerate(self._level(number)):
            scale = np.float32(len(image) / self._cells)
            column = (seen_x + np.float32(self._cells / 2)) * scale - np.float32(0.5)
            row = (np.float32(self._cells / 2) - seen_y) * scale - np.float32(0.5)
            seen = cv2.remap(image, column, row, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
            found[3 * k : 3 * k + 3] = np.tensordot(weights, seen, 1).T
            if k == 0 and footprint.streak:
                found[6:] = np.tensordot(along, seen[:, :, 1:], 1).T
        variance = SHARPEST**2 * 2.0 ** (number / PER_OCTAVE)
        (xx, xy), (_, yy) = np.clip(footprint.spread - variance * np.eye(2), -HALF * variance, HALF * variance)
        found[0] += (0.5 * (more[0] + xx)) * found[3] + (more[1] + xy) * found[4] + (0.5 * (more[2] + yy)) * found[5]
        return found


@lru_cache(maxsize=64)
def _texture(first: Tag, tags: tuple[Tag, ...]) -> PrintTexture:
    """Drawn and blurred once for all cameras and scales: a level takes a millisecond, a drawing ten."""
    return PrintTexture(_drawn(first, tags))


class PrintModel:
    """One print of a target: a tag on its paper, with what lies on that.

    Args:
        target: with all its tags.
        first: the largest tag of the print.
        projection: of the lens.
        sheet: that it is printed on; none where it does not bend.

    Attributes:
        origin: centre of that tag `(3,)` [m; target].
        axes: target from that tag `(3, 3)`.
        half: half the side of its paper [m].
        cell: side of its cells [m].
    """

    def __init__(self, target: Target, first: Tag, projection: Projection, sheet: Sheet | None = None) -> None:
        self.sheet = sheet
        self._projection = projection
        self.origin, self.axes = first.position, first.rotation
        tags = tuple(
            tag
            for tag in target.tags
            if float(tag.rotation[:, 2] @ first.rotation[:, 2]) > ONE_PLANE
            and abs(float(first.rotation[:, 2] @ (tag.position - first.position))) < first.module
        )
        # One quiet zone around the tag is surely white; other tags count where they lie inside it.
        self.half = first.paper / 2
        self.cell = first.module
        self._texture = _texture(first, tags)

    def samples(
        self, pixels: Grey, rotation: Array, position: Array, spread: Array, motion: Array | None = None
    ) -> PrintSamples | None:
        """Model and image where a pose puts the print; none where it is not in full view, too small or too large.

        Args:
            pixels: `(h, w)` uint8.
            rotation: camera from target `(3, 3)`.
            position: of the target `(3,)` [m; RDF].
            spread: covariance of the point spread `(2, 2)` [px^2]; what is longer one way is motion blur.
            motion: of the camera under a rolling shutter `(4,)`; see `rolling`.
        """
        window = self._window(pixels.shape, rotation, position, motion)
        if window is None:
            return None
        footprint = Footprint.of(spread, window.middle / self.cell)
        value, by_x, by_y, xx, xy, yy, along_x, along_y = self._seen(window, footprint)
        (a, b), (c, d) = window.plane / self.cell
        dxx, dyy = xx * a * a + 2.0 * xy * a * c + yy * c * c, xx * b * b + 2.0 * xy * b * d + yy * d * d
        if footprint.streak:
            by_way = np.stack([along_x * a + along_y * c, along_x * b + along_y * d])
            by_spread = footprint.by_spread((dxx + dyy) / 2.0, by_way)
        else:
            by_spread = np.stack([dxx / 2.0, xx * a * b + xy * (a * d + b * c) + yy * c * d, dyy / 2.0])
        height, width = window.used.shape
        grey = pixels[window.top : window.top + height, window.left : window.left + width]
        return PrintSamples(
            value,
            by_x * a + by_y * c,
            by_x * b + by_y * d,
            by_spread,
            window.u,
            window.v,
            window.row.astype(np.float64),
            grey[window.used].astype(np.float64),
            window.used,
        )

    def template(
        self, shape: tuple[int, ...], rotation: Array, position: Array, spread: Array
    ) -> tuple[Image32, Bools, int, int] | None:
        """The print at whole pixels `(h, w)`, which of them are of it, and the column and row where they begin."""
        window = self._window(shape, rotation, position, None)
        if window is None:
            return None
        image = np.ones(window.used.shape, dtype=np.float32)
        image[window.used] = self._seen(window, Footprint.of(spread, window.middle / self.cell))[0]
        return image, window.used, window.left, window.top

    def corners(self, half: float) -> Array:
        """Corners `(4, 3)` [m; target] of the part within half a side of its middle."""
        return np.asarray(SQUARE * half @ self.axes[:, :2].T + self.origin, np.float64)

    def depth(self, rotation: Array, position: Array) -> float:
        """How far the middle of the print is along the optical axis [m]."""
        return float((rotation @ self.origin + position)[2])

    def _seen(self, window: _Window, footprint: Footprint) -> Array:
        middle = window.middle / self.cell
        # A slanted print is seen through a larger footprint where it is farther.
        (a, b), (c, d) = window.plane / self.cell
        (xx, xy), (_, yy) = middle @ middle.T
        more = footprint.narrow * np.stack([a * a + b * b - xx, a * c + b * d - xy, c * c + d * d - yy])
        return self._texture.at(window.u / self.cell, window.v / self.cell, footprint, more)

    def _window(self, shape: tuple[int, ...], rotation: Array, position: Array, motion: Array | None) -> _Window | None:
        """Where the print is in the image; none where it is not in full view, too small or too large."""
        half = self.half - LIMITS.photo.margin_cells * self.cell
        placed = self.corners(half) @ rotation.T + position
        uv, visible = self._projection.project(exposed(placed, motion, self._projection)[0])
        if not bool(visible.all()):
            return None
        x0, y0 = np.maximum(np.floor(uv.min(axis=0)).astype(int), 0)
        x1, y1 = np.minimum(np.ceil(uv.max(axis=0)).astype(int) + 1, [shape[1], shape[0]])
        width, height = int(x1 - x0), int(y1 - y0)
        low, high = LIMITS.photo.min_window_px, LIMITS.photo.max_window_px
        if not (low <= width <= high and low <= height <= high):
            return None
        cam_from_plane = np.column_stack([rotation @ self.axes[:, :2], rotation @ self.origin + position])
        if abs(float(np.linalg.det(cam_from_plane))) < TINY:  # the camera is in the plane of the print
            return None
        ray_from_pixel = self._ray_from_pixel(int(x0), int(y0), width, height)
        row = np.arange(height)
        if motion is None:
            by_row = (np.linalg.inv(cam_from_plane) @ ray_from_pixel)[:, :, None]
        else:
            # A row is exposed at one time t: the plane M is then at A M with A = (I - t [w]) and t s e beside it.
            middle = (self._projection.intrinsics.height - 1) / 2
            times = (row + y0 - middle) * self._projection.line_time
            moved = cam_from_plane - times[:, None, None] * (skew(motion[:3]) @ cam_from_plane)
            moved[:, 2, 2] += times * motion[3]
            by_row = np.moveaxis(np.linalg.inv(moved) @ ray_from_pixel, 0, 2)
        h = by_row[:, :, :, None]
        column = np.arange(width, dtype=np.float64)
        u, v, w = h[:, 0] * column + h[:, 1] * row[:, None] + h[:, 2]
        u, v = u / w, v / w
        used = (np.abs(u) < half) & (np.abs(v) < half)
        if not bool(used.any()):
            return None
        u, v, rows = u[used], v[used], np.nonzero(used)[0]
        inverse = 1.0 / w[used]
        at = by_row[:, :, rows] if motion is not None else by_row
        plane = np.stack([(at[0, :2] - at[2, :2] * u) * inverse, (at[1, :2] - at[2, :2] * v) * inverse])
        return _Window(int(x0), int(y0), used, u, v, rows + int(y0), plane, plane.mean(axis=2))

    def _ray_from_pixel(self, left: int, top: int, width: int, height: int) -> Array:
        """Homography from the pixels of a window to rays at unit depth; the lens is taken as locally projective."""
        if not self._projection.is_distorted:
            (fx, fy), (cx, cy) = self._projection.focal, self._projection.centre
            return np.array([[1 / fx, 0.0, (left - cx) / fx], [0.0, 1 / fy, (top - cy) / fy], [0.0, 0.0, 1.0]])
        size = np.array([width, height]) / 2
        local = size + LENS_PATCH * size * SQUARE
        rays = self._projection.undistort(local + np.array([left, top]))
        return np.asarray(cv2.getPerspectiveTransform(local.astype(np.float32), rays.astype(np.float32)), np.float64)


def _drawn(first: Tag, tags: Sequence[Tag]) -> Image32:
    """Tags with their quiet zones over the print of the first; a texel that several cells share is their mean.

    The cells of the first tag are whole texels. Those of the inner tag of `nested.toml` are 1.9 texels wide: drawn by
    the middles of texels it had 26 % too little white, which shows in every image from afar.
    """
    half, texel = first.paper / 2, first.module / TEXELS
    drawn = np.ones(((first.family.black_cells + 2) * TEXELS,) * 2, dtype=np.float32)
    for tag in tags:
        parts = 1 if tag is first else TEXEL_PARTS
        turned = (first.rotation.T @ tag.rotation)[:2, :2]
        place = ((tag.position - first.position) @ first.rotation)[:2]
        middle = half + place * (1.0, -1.0)
        reach = np.abs(turned).sum(axis=1) * (tag.paper / 2)
        left, top = np.clip(np.floor((middle - reach) / texel).astype(int), 0, len(drawn))
        right, bottom = np.clip(np.ceil((middle + reach) / texel).astype(int), 0, len(drawn))
        if right <= left or bottom <= top:
            continue
        step = texel / parts
        x, y = np.meshgrid(
            (np.arange(left * parts, right * parts) + 0.5) * step - half,
            half - (np.arange(top * parts, bottom * parts) + 0.5) * step,
        )
        local = (np.stack([x, y], axis=-1) - place) @ turned
        cells = np.pad(tag.bitmap, 1, constant_values=255)
        n = len(cells)
        column = np.floor(local[..., 0] / tag.module + n / 2).astype(int)
        row = np.floor(n / 2 - local[..., 1] / tag.module).astype(int)
        inside = (row >= 0) & (row < n) & (column >= 0) & (column < n)
        part = drawn[top:bottom, left:right]
        fine = part.repeat(parts, axis=0).repeat(parts, axis=1)
        fine[inside] = cells[row[inside], column[inside]] / np.float32(255)
        part[...] = fine.reshape(bottom - top, parts, right - left, parts).mean(axis=(1, 3))
    return drawn
