"""The prints of a target, and what they look like from a pose: each pixel looks up where its ray meets the print.

Tags beside each other are a print each; a tag inside a larger one belongs to that. A print is drawn once and blurred to
a row of levels. A pixel sees it through a point spread: that of the lens and of the pixel, which a slanted print makes
longer one way, and the even streak of a motion. What is round of it is a level, what is longer one way are places
beside each other that are looked up and added. From the level to the right blur leads the heat equation: a blur whose
covariance grows by D adds (D_xx m_xx + 2 D_xy m_xy + D_yy m_yy) / 2.

Source: mip maps, Williams, SIGGRAPH 1983, with a Gaussian in place of the box; long footprints by several round ones,
McCormack et al., "Feline", SIGGRAPH 1999.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from math import acos, atan2, ceil, cos, floor, hypot, log2, sin, sqrt
from typing import Final

import cv2
import numpy as np

from mkdaemon.vision.arrays import Array, Array32, Bools, Grey, UnknownsEstimate
from mkdaemon.vision.limits import HALF, LIMITS
from mkdaemon.vision.pose.pose import Pose, correlation, refined
from mkdaemon.vision.pose.projection import NEAR_M, Projection
from mkdaemon.vision.pose.rolling import skew
from mkdaemon.vision.tags.tagfamily import QUIET_ZONE_CELLS
from mkdaemon.vision.tags.tagmap import ONE_PLANE, Tag, Target, covered

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
"""That a slant, or a streak, is looked up at."""
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
MOST: Final = 8
"""Prints that a fit to grey values takes: eight take five times as long as one, 16 leave 0.7 of the deviation."""
SHOWN: Final = 0.3
"""Share of a print's width and of its height that lies in the image, where it is fitted."""
SPREAD: Final = np.eye(2)
"""Of the point spread with which prints are looked for [px^2]."""
REACH: Final = 0.6
"""How far from its place a print is looked for, of its size in the image."""

RISES: Final = 3
"""Unknowns a, b, c of a sheet."""
OF_A_CYLINDER: Final = np.array([[0.375, 0.0, 0.125], [0.0, 0.5, 0.0], [0.125, 0.0, 0.375]])
"""Covariance of (a, b, c) over the variance of the rise, for a cylinder about any axis: (cos^2, 2 cos sin, sin^2)."""
PLANE: Final = 0.3
"""Deviation of the mean height over the print's own deviation: the effect of a margin of a tenth of the side."""


class Sheet:
    """The sheet of one print: how it bends is an unknown of a fit, known to a share of its side.

    Over the plane of a print paper lies at the height z = s (a X^2 + b X Y + c Y^2) - z0, where X and Y are places in
    halves of the side s, and z0 makes the mean over the print zero. A bend moves points along the normal. Near by,
    edges tell that from a tilt; from afar they do not, where the print is seen at a slant.

    Paper does not stretch: with Q the matrix of z = p^T Q p a point p of the flat sheet comes to lie at
    p - 2/3 (p^T Q p) Q p, to third order, which is the chord of its arc.

    Args:
        tag: the largest tag of the print.
        rise: deviation of the rise at the middle of a side over the centre, as a share of the side.

    Attributes:
        prior: what is known before any image.
        normal: of the print `(3,)` [target].
    """

    def __init__(self, tag: Tag, rise: float) -> None:
        self.prior = UnknownsEstimate(np.zeros(RISES), rise**2 * OF_A_CYLINDER)
        self.normal = tag.rotation[:, 2]
        self._origin, self._axes = tag.position, tag.rotation[:, :2]
        self._scale = 4.0 / tag.size
        mean = (tag.paper / tag.size) ** 2 / 3.0
        self._mean = tag.size * np.array([mean, 0.0, mean])

    def heights(self, x: Array, y: Array) -> Array:
        """Derivative `(3, n)` [m] of the height over the plane by the rise, at places `(n,)` along the axes [m]."""
        heights: Array = self._scale * np.array([x * x, x * y, y * y]) - self._mean[:, None]
        return heights

    def terms(self, points: Array) -> Array:
        """Terms of the place of points `(n, 3)` on the bent print `(7, n)`: their heights, then cubes [m^3]."""
        x, y = ((points - self._origin) @ self._axes).T
        return np.concatenate([self.heights(x, y), np.stack([x**3, x * x * y, x * y * y, y**3])])

    def bent(self, points: Array, terms: Array, rise: Array) -> Array:
        """Places of points `(n, 3)` [m; target] of the flat print, with their terms, on a print with a rise `(3,)`."""
        # (a x^2 + b x y + c y^2) (a x + b y / 2, b x / 2 + c y), sorted by x^3, x^2 y, x y^2, y^3.
        a, b, c = rise * self._scale
        along_x = [a * a, 1.5 * a * b, a * c + b * b / 2, b * c / 2]
        along_y = [a * b / 2, a * c + b * b / 2, 1.5 * b * c, c * c]
        chord = (-2.0 / 3.0) * self._axes @ np.array([along_x, along_y])
        bent: Array = points + (np.hstack([np.outer(self.normal, rise), chord]) @ terms).T
        return bent

    def plane_covariance(self, rotation: Array, bend: UnknownsEstimate) -> Array:
        """Covariance `(3, 3)` [m^2; camera] of where the print's plane lies along its normal, seen by a rotation."""
        square = bend.covariance + np.outer(bend.mean, bend.mean)
        normal = rotation @ self.normal
        return float(PLANE**2 * self._mean @ square @ self._mean) * np.outer(normal, normal)


@dataclass(frozen=True, slots=True, eq=False)
class PrintSamples:
    """A print's pixels: model and image.

    Attributes:
        value: of the model, 0 black to 1 white `(n,)`.
        steep: its squared slope in the image `(n,)` [1/px^2].
        by_spread: derivative by the point spread's xx, xy and yy `(3, n)` [1/px^2].
        by_point: by the points of the print as they are exposed `(3, n)` [1/m; camera].
        arm: from the target's origin to where the pixels see the print `(3, n)` [m; camera].
        place: on the print `(2, n)` [cells from the middle].
        row: of the image `(n,)`.
        grey: of the image `(n,)`.
        left: first column of the window that the print is in.
        top: its first row.
        used: which pixels of the window these are `(rows, columns)`.
    """

    value: Array
    steep: Array
    by_spread: Array
    by_point: Array
    arm: Array
    place: Array
    row: Array
    grey: Array
    left: int
    top: int
    used: Bools

    def kept(self, keep: Bools) -> PrintSamples:
        """Some of these pixels."""
        used = self.used.copy()
        used[used] = keep
        rows = ("value", "steep", "by_spread", "by_point", "arm", "place", "row", "grey")
        return replace(self, used=used, **{name: getattr(self, name)[..., keep] for name in rows})


def principal(covariance: Array) -> tuple[float, float, Array]:
    """Least and largest variance of a covariance `(2, 2)`, and the unit vector `(2,)` along the larger one."""
    (xx, xy), (_, yy) = covariance.tolist()
    mean, more, angle = (xx + yy) / 2.0, hypot((xx - yy) / 2.0, xy), atan2(2.0 * xy, xx - yy) / 2.0
    return mean - more, mean + more, np.array([cos(angle), sin(angle)])


@dataclass(frozen=True, slots=True, eq=False)
class Footprint:
    """Area of a plane that a pixel covers.

    Attributes:
        narrow: variance of the round part, with the pixel [px^2].
        streak: motion `(2,)` [px]; none where the point spread is round.
        spread: covariance of what is looked up at one place `(2, 2)`.
        places: that are looked up about the pixel's own `(2, k)`.
        weights: of these, one together; and times where each is in the streak, -1/2 to 1/2 `(2, k)`.
    """

    narrow: float
    streak: Array | None
    spread: Array
    places: Array
    weights: Array

    @classmethod
    def of(cls, spread: Array, plane: Array) -> Footprint:
        """Of a point spread `(2, 2)` [px^2] through the derivative of the plane by the pixel `(2, 2)`.

        What is longer one way is a streak [px]; the rest, with the pixel, is round until the plane slants it.
        """
        # A streak of length L along one way adds the variance L^2 / 12 to that way: L^2 = 12 (most - least).
        least, most, way = principal(spread)
        length = sqrt(BOX * (most - least))
        streak = None if length < LEAST_STREAK_PX else length * way
        narrow = ((least + most) / 2.0 if streak is None else least) + 1.0 / BOX
        # Through the derivative P of the plane by the pixel a covariance C becomes P C P^T [cells^2].
        round_part = narrow * plane @ plane.T
        least, most, way = principal(round_part)
        more, least = most - least, max(least, TINY)
        places, weights, sums = np.zeros((2, 1)), np.ones(1), np.array([[1.0], [0.0]])
        if more > ROUND * least:
            at, weights = _along(sqrt(more), sqrt(least))
            places, round_part = way[:, None] * at, least * np.eye(2)
        if streak is not None:
            way = plane @ streak
            apart, most_places = APART * sqrt(least), max(MOST_PLACES // len(weights), 2)
            count = min(max(ceil(hypot(*way.tolist()) / apart), 2), most_places)
            # The middles of even parts, a little farther apart, so that they have the variance of the streak.
            even = ((np.arange(count) + 0.5) / count - 0.5) / sqrt(1.0 - 1.0 / count**2)
            places = (places[:, :, None] + way[:, None, None] * even).reshape(2, -1)
            sums = np.array([np.full(count, 1.0 / count), even / count])
        return cls(narrow, streak, round_part, places, (weights[:, None] * sums[:, None]).reshape(2, -1))


def _along(deviation: float, blur: float) -> tuple[Array, Array]:
    """Places of a Gaussian and their weights, `(k,)` each, none farther from the next than blur allows."""
    reach = min(ceil(WIDE * deviation / (APART * blur)), MOST_PLACES // 4 - 1)
    at = np.arange(-reach, reach + 1) * (WIDE * deviation / reach)
    weights: Array = np.exp(-0.5 * (at / deviation) ** 2)
    weights /= weights.sum()
    return np.asarray(at * (deviation / sqrt(float(weights @ at**2))), np.float64), weights


class PrintTexture:
    """A drawn print, 0 black to 1 white, and its softer levels, each made when it is first asked for.

    Args:
        first: the largest tag of the print.
        tags: all of it with their quiet zones, a later one on those before.
    """

    def __init__(self, first: Tag, tags: Sequence[Tag]) -> None:
        self._cells = first.family.black_cells + 2 * QUIET_ZONE_CELLS
        self._levels: dict[int, Array32] = {}
        if len(tags) == 1:
            cells = np.pad(first.bitmap, QUIET_ZONE_CELLS, constant_values=255).astype(np.float32) / np.float32(255)
            self._drawn = cells.repeat(TEXELS, axis=0).repeat(TEXELS, axis=1)
            return
        # Cells of a smaller tag end within a texel, which is their mean.
        fine = TEXELS * TEXEL_PARTS
        drawn = np.full((self._cells * fine,) * 2, 255, dtype=np.uint8)
        down = np.array([1.0, -1.0])
        for tag in tags:
            cells = np.pad(tag.bitmap, QUIET_ZONE_CELLS, constant_values=255)
            corners = first.local(tag.place(SQUARE * tag.paper / 2))[:3, :2] / first.module
            at = (corners * down + self._cells / 2) * fine - HALF, (SQUARE[:3] * down + 1.0) * len(cells) / 2 - HALF
            cell_of = cv2.getAffineTransform(*(corner.astype(np.float32) for corner in at))
            nearest = cv2.INTER_NEAREST | cv2.WARP_INVERSE_MAP
            cv2.warpAffine(cells, cell_of, drawn.shape, drawn, nearest, cv2.BORDER_TRANSPARENT)
        small = cv2.resize(drawn.astype(np.float32), (self._cells * TEXELS,) * 2, interpolation=cv2.INTER_AREA)
        self._drawn = small / np.float32(255)

    def _level(self, number: int) -> Array32:
        """Value, its slopes by x and y, and its second derivatives by xx, xy, yy `(side, side, 6)`."""
        if number not in self._levels:
            blur = SHARPEST * 2.0 ** (number / PER_OCTAVE / 2)
            side = min(ceil(self._cells / (STEP * blur)), len(self._drawn))
            # Averaging over a step and linear interpolation blur, too: step^2 / 12 + step^2 / 6 = step^2 / 4. Variances
            # of blurs in sequence add, so the Gaussian gets the rest.
            step = self._cells / side
            variance = blur**2 - step**2 / 4.0
            soft = cv2.GaussianBlur(self._drawn, (0, 0), sqrt(variance) * TEXELS, borderType=cv2.BORDER_REPLICATE)
            down, right = (slope * TEXELS for slope in np.gradient(soft))
            cross, along = (slope * TEXELS for slope in np.gradient(right))
            across = np.gradient(down, axis=0) * TEXELS
            planes = [soft, right, -down], [along, -cross, across]
            small = [cv2.resize(cv2.merge(p), (side, side), interpolation=cv2.INTER_AREA) for p in planes]
            self._levels[number] = np.concatenate(small, axis=2, dtype=np.float32)
        return self._levels[number]

    def at(self, place: Array, footprint: Footprint) -> tuple[Array, float]:
        """Grey values at places of the print `(2, n)` [cells from the middle], with the blur of a level.

        Returns:
            Value, slopes by x and y, second derivatives by xx, xy, yy `(6, n)`, and these by where in a streak they
            are, together `(2, 6, n)`; and the variance of the blur [cells^2].
        """
        # The level with the nearest variance; from one level to the next it grows by 2^(1 / PER_OCTAVE).
        mean = float(np.trace(footprint.spread)) / 2.0
        most = 2 * PER_OCTAVE * log2(SOFTEST / SHARPEST)
        number = round(min(max(PER_OCTAVE * log2(mean / SHARPEST**2), 0.0), most))
        image = self._level(number)
        scale = np.array([[1.0], [-1.0]]) * (len(image) / self._cells)
        middles = (place * scale + (len(image) - 1) / 2).astype(np.float32)
        column, row = middles[:, None] + (footprint.places * scale).astype(np.float32)[:, :, None]
        seen = cv2.remap(image, column, row, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        found = (footprint.weights.astype(np.float32) @ seen.reshape(len(seen), -1)).reshape(2, -1, 6)
        return found.transpose(0, 2, 1).astype(np.float64, order="C"), SHARPEST**2 * 2.0 ** (number / PER_OCTAVE)


_texture: Final = lru_cache(maxsize=64)(PrintTexture)
"""Drawn and blurred once for all cameras and scales: a level takes a millisecond, a drawing ten."""


class PrintModel:
    """One print of a target: a tag on its paper, with what lies on that.

    Args:
        target: with all its tags.
        first: the largest tag of the print.
        projection: of the lens.

    Attributes:
        tag: that tag.
        corners: of its paper `(4, 3)` [m; target].
    """

    def __init__(self, target: Target, first: Tag, projection: Projection) -> None:
        self._projection = projection
        self.tag = first
        tags = tuple(
            tag
            for tag in target.tags
            if float(tag.rotation[:, 2] @ first.rotation[:, 2]) > ONE_PLANE
            and abs(float(first.rotation[:, 2] @ (tag.position - first.position))) < first.module
        )
        # One quiet zone around the tag is surely white; other tags count where they lie inside it.
        self.corners = first.place(SQUARE * (first.paper / 2))
        self._target_from_plane = np.column_stack([first.module * first.rotation[:, :2], first.position])
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
        plane = rotation @ self._target_from_plane
        plane[:, 2] += position
        half = self.tag.paper / 2 / self.tag.module - LIMITS.photo.margin_cells
        window = self._window(pixels.shape, half * SQUARE @ plane[:, :2].T + plane[:, 2], motion)
        in_plane = abs(float(rotation @ self.tag.rotation[:, 2] @ plane[:, 2])) < TINY  # the camera is
        if window is None or in_plane:
            return None
        left, top, width, height = window
        cam_from_plane = plane[None]
        row = np.arange(height)
        if motion is not None:
            # A row is exposed at one time t: the plane M is then at A M with A = (I - t [w]) and t s e beside it.
            times = self._projection.row_times(np.arange(top, top + height, dtype=np.float64))
            cam_from_plane = cam_from_plane - times[:, None, None] * (skew(motion[:3]) @ cam_from_plane)
            cam_from_plane[:, 2, 2] += times * motion[3]
        # A pixel with the ray r sees the plane at p = (h_x, h_y) / h_z with h = M^-1 r, linear in column and row.
        # Source: R. Hartley, A. Zisserman, Multiple View Geometry, 2003, section 8.1.
        inverse = np.asarray(np.linalg.inv(cam_from_plane), np.float64)
        h = (inverse @ self._ray_from_pixel(left, top, width, height)).transpose(1, 2, 0)
        plane_from_cam = inverse.transpose(1, 2, 0)
        seen = h[:, 0, :, None] * np.arange(width) + (h[:, 1] * row + h[:, 2])[:, :, None]
        inside = np.abs(seen[:2]) < half * seen[2]
        used = inside[0] & inside[1]
        index = np.flatnonzero(used)
        if not index.size:
            return None
        row, seen = index // width, seen.reshape(3, -1).take(index, axis=1)
        place = seen[:2] / seen[2]
        if motion is not None:
            plane_from_cam, h = plane_from_cam[:, :, row], h[:, :, row]
        # Along a row, whose time stays, and by the row as all rows are exposed when this one is [cells/px].
        # dp = (dh - p dh_z) / h_z, the derivative of a quotient.
        by_pixel = (h[:2, :2] - h[2, :2] * place[:, None]) / seen[2]
        value, slope, steep, by_spread = self._seen(place, by_pixel, spread)
        # The print moves by d at a point, and its place there by (p w - W d), with w the third of W d: all on its ray.
        by_x, by_y, by_scale = plane_from_cam
        by_point = by_scale * (slope * place).sum(axis=0) - by_x * slope[0] - by_y * slope[1]
        arm = plane[:, :2] @ place + (rotation @ self.tag.position)[:, None]
        grey = pixels[top : top + height, left : left + width][used].astype(np.float64)
        image_row = (row + top).astype(np.float64)
        return PrintSamples(value, steep, by_spread, by_point, arm, place, image_row, grey, left, top, used)

    def offset(self, pixels: Grey, start: Pose) -> Array | None:
        """Offset of the print from its place `(2,)` [px]; zero if it is near, None if it is not found.

        Source: normalised cross-correlation; J. P. Lewis, "Fast normalized cross-correlation", 1995.
        """
        seen = self.samples(pixels, start.rotation, start.position, SPREAD)
        if seen is None or seen.grey.size < LIMITS.photo.min_window_px**2:
            return None
        if correlation(seen.grey, seen.value) >= LIMITS.likeness.clear:
            return np.zeros(2)
        left, top, (height, width) = seen.left, seen.top, seen.used.shape
        template = np.ones(seen.used.shape, dtype=np.float32)
        template[seen.used] = seen.value
        reach = int(np.ceil(REACH * max(width, height)))
        x0, y0 = max(left - reach, 0), max(top - reach, 0)
        around = pixels[y0 : top + height + reach, x0 : left + width + reach].astype(np.float32)
        score = cv2.matchTemplate(around, template, cv2.TM_CCOEFF_NORMED, mask=seen.used.astype(np.float32))
        score = np.where(np.isfinite(score), score, -1.0)
        row, column = np.unravel_index(int(np.argmax(score)), score.shape)
        if score[row, column] < LIMITS.likeness.clear:
            return None
        return np.array([float(column + x0 - left), float(row + y0 - top)])

    def depth(self, rotation: Array, position: Array) -> float:
        """Distance of the print's middle along the optical axis [m]."""
        return float((rotation @ self.tag.position + position)[2])

    def _seen(self, place: Array, plane: Array, spread: Array) -> tuple[Array, Array, Array, Array]:
        """Value `(n,)`, its slope by the place `(2, n)`, that in the image, squared, and derivative by the spread.

        `plane` is the derivative of the place by column and row `(2, 2, n)` [cells/px].
        """
        # Blur by a covariance B adds tr(B H) / 2, H the second derivatives: the heat equation, dI/dB = H / 2.
        # The level has the variance v I, the footprint the rest; see `Footprint`.
        middle = plane.mean(axis=2)
        footprint = Footprint.of(spread, middle)
        seen, variance = self._texture.at(place, footprint)
        by_pixel = plane[0] * seen[:, 1, None] + plane[1] * seen[:, 2, None]
        xx, xy, yy = seen[0, 3:]
        by_x, by_y = xx * plane[0] + xy * plane[1], xy * plane[0] + yy * plane[1]
        own = HALF * (plane[0] * by_x + plane[1] * by_y)
        narrower = own[0] + own[1]
        # A slanted print is seen through a larger footprint where it is farther.
        more = HALF * (footprint.spread - footprint.narrow * middle @ middle.T - variance * np.eye(2))
        value = seen[0, 0] + more.ravel() @ seen[0, [3, 4, 4, 5]] + footprint.narrow * narrower
        if footprint.streak is None:
            by_spread = np.array([own[0], plane[0, 0] * by_x[1] + plane[1, 0] * by_y[1], own[1]])
        else:
            # B = l I + s s^T / 12: what is seen changes by l, as heat spreads, and by both ways of the streak s.
            s0, s1 = 2.0 * footprint.streak / BOX
            grown = np.array([[1.0, 0.0, 1.0], [s0, s1 / 2.0, 0.0], [0.0, s0 / 2.0, s1]])
            by_spread = np.asarray(np.linalg.inv(grown) @ np.array([narrower, *by_pixel[1]]), np.float64)
        return value, seen[0, 1:3], (by_pixel[0] ** 2).sum(axis=0), by_spread

    def _window(self, shape: tuple[int, ...], corners: Array, motion: Array | None) -> tuple[int, int, int, int] | None:
        """Column, row, width and height of a print; none where it is not in full view, too small or too large."""
        seen, visible = self._projection.project(corners, motion)
        if not bool(visible.all()):
            return None
        left, top = (max(floor(least), 0) for least in seen.min(axis=0))
        right, bottom = (ceil(most) + 1 for most in seen.max(axis=0))
        width, height = min(right, shape[1]) - left, min(bottom, shape[0]) - top
        low, high = LIMITS.photo.min_window_px, LIMITS.photo.max_window_px
        return (left, top, width, height) if low <= width <= high and low <= height <= high else None

    def _ray_from_pixel(self, left: int, top: int, width: int, height: int) -> Array:
        """Homography from the pixels of a window to rays at unit depth; the lens is taken as locally projective."""
        if not self._projection.is_distorted:
            (fx, fy), (cx, cy) = self._projection.focal, self._projection.centre
            return np.array([[1 / fx, 0.0, (left - cx) / fx], [0.0, 1 / fy, (top - cy) / fy], [0.0, 0.0, 1.0]])
        size = np.array([width, height]) / 2
        local = size + LENS_PATCH * size * SQUARE
        rays = self._projection.undistort(local + np.array([left, top]))
        return np.asarray(cv2.getPerspectiveTransform(local.astype(np.float32), rays.astype(np.float32)), np.float64)


def roots(target: Target) -> tuple[Tag, ...]:
    """Tags that lie on no larger one's paper, largest first."""
    tags = target.tags
    return tuple(tag for k, tag in enumerate(tags) if not any(covered(tag.position[None], other) for other in tags[:k]))


def sheet_of(target: Target) -> Sheet | None:
    """The sheet of a target that is one print; none where it cannot bend, or has several prints.

    Prints beside each other fix the pose by their places, which do not show how a sheet bends.
    """
    found = roots(target)
    return Sheet(found[0], target.bend) if len(found) == 1 and target.bend > 0.0 else None


class Prints:
    """The prints of one target, and which of them an image shows.

    Attributes:
        all: the prints, largest first.
        sheet: of a target's only print; none where it does not bend.
    """

    def __init__(self, target: Target, projection: Projection) -> None:
        self._projection = projection
        self.sheet = sheet_of(target)
        self.all = tuple(PrintModel(target, tag, projection) for tag in roots(target))

    def seen(self, rotation: Array, position: Array) -> tuple[PrintModel, ...]:
        """Prints of which a pose puts enough into the image, the largest there first.

        Args:
            rotation: camera from target `(3, 3)`.
            position: of the target `(3,)` [m; RDF].
        """
        shown = [model for model in self.all if self._is_shown(model, rotation, position)]
        return tuple(sorted(shown, key=lambda model: model.depth(rotation, position) / model.tag.module)[:MOST])

    def gathered(self, pixels: Grey, start: Pose) -> Pose:
        """A start, moved to where the prints are found; as it is where all are in their place, or one is found alone.

        A tag of 27 px knows its tilt to a degree or two; at the next tag, two metres away, these are more pixels than a
        cell has, and no fit would get there.
        """
        if len(self.all) < 2:
            return start
        looked = [(model, model.offset(pixels, start)) for model in self.seen(start.rotation, start.position)]
        found = [(model.corners, offset) for model, offset in looked if offset is not None]
        if len(found) < 2 or not any(offset.any() for _, offset in found):
            return start
        points = np.concatenate([corners for corners, _ in found])
        seen = self._projection.project(points @ start.rotation.T + start.position)[0]
        rays = self._projection.undistort(seen + np.repeat([offset for _, offset in found], len(SQUARE), axis=0))
        rotation, position = refined(points, rays, start.rotation, start.position)
        if not np.isfinite(position).all() or position[2] < NEAR_M:
            return start
        return replace(start, rotation=rotation, position=position)

    def cell_px(self, pose: Pose) -> float:
        """Side of a cell of the print that is looked at [px]."""
        model = self._looked_at(pose)
        depth = max(model.depth(pose.rotation, pose.position), NEAR_M)
        return float(self._projection.focal[0]) * model.tag.module / depth

    def looked_at(self, pose: Pose) -> tuple[Array, Array, float]:
        """The largest print that is seen, the first where none is: its middle, the way to the camera, its tilt.

        Returns:
            The middle `(3,)` [m; target], the direction from there to the camera `(3,)`, and the angle between that and
            the normal [rad].
        """
        model = self._looked_at(pose)
        middle = pose.rotation @ model.tag.position + pose.position
        toward: Array = -middle / max(float(np.linalg.norm(middle)), NEAR_M)
        normal = pose.rotation @ model.tag.rotation[:, 2]
        return model.tag.position, toward, acos(min(max(float(normal @ toward), -1.0), 1.0))

    def _looked_at(self, pose: Pose) -> PrintModel:
        """The largest print that is seen; the first where none is."""
        if len(self.all) == 1:
            return self.all[0]
        return next(iter(self.seen(pose.rotation, pose.position)), self.all[0])

    def _is_shown(self, model: PrintModel, rotation: Array, position: Array) -> bool:
        seen, visible = self._projection.project(model.corners @ rotation.T + position)
        lens = self._projection.intrinsics
        shown = np.clip(seen, 0.0, np.array([lens.width, lens.height]) - 1.0)
        return bool(visible.all() and (np.ptp(shown, axis=0) >= SHOWN * np.ptp(seen, axis=0)).all())
