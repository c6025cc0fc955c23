"""Bundle adjustment: the places of tags and of the camera in each image that explain best where corners are seen.

Unknown are the pose of the camera in each image (6), and the pose and side of each tag (7). Images have no unknown in
common, so they are eliminated one by one, and what remains is a system of the tags alone. Source: B. Triggs et al.,
"Bundle Adjustment, a Modern Synthesis" (2000), chapters 4 (robust costs), 6.1 (elimination) and 9 (gauge).
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import cv2
import numpy as np
import numpy.typing as npt

from mkdaemon.vision.arrays import Array
from mkdaemon.vision.pose.projection import Projection

Indices = npt.NDArray[np.int64]

CORNERS: Final[Array] = np.array([[-0.5, 0.5, 0.0], [0.5, 0.5, 0.0], [0.5, -0.5, 0.0], [-0.5, -0.5, 0.0]])
"""Of a tag of side one, in the order of a detection `(4, 3)`."""
SIZE_SD: Final = 0.003
"""Doubt about the side of a print, as a share: a printer's scale, paper, a ruler."""
LEAST_SD_PX: Final = 0.005
"""Deviation of a corner at least [px]."""
LARGE: Final = 3.0
"""Residual from which a sighting counts less [deviations of a corner]."""
COARSE_PX: Final = 8.0
"""Deviation of a corner that is assumed first [px], halved as soon as the bundle has settled: a cost that doubts large
residuals from the beginning ends in a map that is bent, with good sightings among those that count for nothing."""
SETTLED: Final = 0.01
"""Change of the cost at which the bundle has settled, as a share."""
STEPS: Final = 80
"""Of the adjustment at most; twenty to thirty do."""
ENOUGH: Final = 1e-6
"""Change of the cost at which it is found, as a share."""
LARGEST_DAMPING: Final = 1e8
UNDAMPED: Final = 1e-12
IMAGE, TAG = 6, 7
"""Unknowns of an image, and of a tag: place, turn and logarithm of the side."""


@dataclass(frozen=True, slots=True, eq=False)
class Sightings:
    """Which tag was seen where in which image, by images in their order.

    Attributes:
        images: index of the image `(n,)`, never falling.
        tags: index of the tag `(n,)`.
        corners: in the order of a detection `(n, 4, 2)` [px].
    """

    images: Indices
    tags: Indices
    corners: Array


@dataclass(frozen=True, eq=False)
class Bundle:
    """Places of tags and cameras.

    Attributes:
        turns: map from tag `(t, 3, 3)`.
        places: of the middles of tags `(t, 3)` [m; map].
        sides: of tags `(t,)` [m].
        eye_turns: camera from map, of each image `(i, 3, 3)`.
        eye_places: of the map's origin in the camera `(i, 3)` [m; RDF].
    """

    turns: Array
    places: Array
    sides: Array
    eye_turns: Array
    eye_places: Array

    @cached_property
    def centres(self) -> Array:
        """Where the camera was `(i, 3)` [m; map]."""
        return np.asarray(-np.einsum("nji,nj->ni", self.eye_turns, self.eye_places))


@dataclass(frozen=True, eq=False)
class Adjusted:
    """A bundle that explains the sightings best.

    Attributes:
        bundle: the places.
        covariance: of place [m], turn [rad; map] and share of the side, one tag after the other `(7 t, 7 t)`; 0 for the
            pose of the origin.
        residuals: observed less expected `(n, 4, 2)` [px].
        corner_sd: deviation of a corner that the residuals show [px].
    """

    bundle: Bundle
    covariance: Array
    residuals: Array
    corner_sd: float

    @cached_property
    def sizes(self) -> Array:
        """Root mean square of each sighting's residuals `(n,)` [deviations of a corner]."""
        return np.asarray(np.sqrt((self.residuals**2).mean(axis=(1, 2))) / self.corner_sd)


@dataclass(frozen=True, slots=True, eq=False)
class _Rows:
    """Residuals of the sightings and their derivatives."""

    residuals: Array
    by_image: Array
    by_tag: Array


def adjust(
    start: Bundle,
    seen: Sightings,
    given: Array,
    projection: Projection,
    origin: int,
    progress: Callable[[float], None] = lambda share: None,
) -> Adjusted:
    """Find the bundle that explains the sightings, from a start that is near; Levenberg and Marquardt's way.

    Args:
        start: near enough that corners are in front of the camera.
        seen: what it explains.
        given: sides of the tags `(t,)` [m], each known to `SIZE_SD` and fewer of them wrong.
        projection: of the camera.
        origin: the tag that stays where it is.
        progress: takes the share of the work that is done.
    """
    bundle, damping, coarse = start, 1e-3, COARSE_PX
    rows = _rows(bundle, seen, projection)
    for step in range(STEPS):
        fine = _corner_sd(rows.residuals)
        sd = max(fine, coarse)
        cost = _cost(rows, bundle, given, sd)
        system = _System(rows, seen, bundle, given, sd, origin)
        gained = 0.0
        while damping < LARGEST_DAMPING:
            moved = _moved(bundle, *system.step(damping))
            tried = _rows(moved, seen, projection)
            gained = 1.0 - _cost(tried, moved, given, sd) / cost
            if gained > 0.0:
                bundle, rows, damping = moved, tried, max(damping / 8.0, 1e-9)
                break
            damping *= 8.0
        progress((step + 1) / STEPS)
        if gained < (ENOUGH if coarse < fine else SETTLED):
            if coarse < fine:
                break
            coarse, damping = coarse / 2.0, min(damping, 1e-3)
    progress(1.0)
    sd = _corner_sd(rows.residuals)
    system = _System(rows, seen, bundle, given, sd, origin)
    return Adjusted(bundle, system.covariance(), rows.residuals, sd)


def _rows(bundle: Bundle, seen: Sightings, projection: Projection) -> _Rows:
    """Residuals `(n, 4, 2)` and derivatives of what is expected `(n, 8, 6)`, `(n, 8, 7)`."""
    n = len(seen.tags)
    arms = np.einsum("nij,kj->nki", bundle.turns[seen.tags] * bundle.sides[seen.tags, None, None], CORNERS)
    points = arms + bundle.places[seen.tags, None]
    eye = bundle.eye_turns[seen.images]
    turned = np.einsum("nij,nkj->nki", eye, points)
    in_eye = (turned + bundle.eye_places[seen.images, None]).reshape(-1, 3)
    pixels, is_seen = projection.project(in_eye)
    by_point = projection.jacobian(np.where(is_seen[:, None], in_eye, (0.0, 0.0, 1.0))).reshape(n, 4, 2, 3)
    residuals = seen.corners - pixels.reshape(n, 4, 2)
    # A corner behind the camera says nothing of where it should be, but it costs.
    residuals[~is_seen.reshape(n, 4)] = 1e3
    # A turn w moves a point at the arm q by w x q: the row of w is q x J.
    by_image = np.concatenate([by_point, np.cross(turned[:, :, None], by_point)], axis=3)
    by_map = by_point @ eye[:, None]
    by_tag = np.concatenate(
        [by_map, np.cross(arms[:, :, None], by_map), (by_map * arms[:, :, None]).sum(axis=3, keepdims=True)], axis=3
    )
    return _Rows(residuals, by_image.reshape(n, 8, IMAGE), by_tag.reshape(n, 8, TAG))


def _corner_sd(residuals: Array) -> float:
    """Deviation of a coordinate of a corner, by the median over sightings that outliers do not move [px]."""
    # The mean square of eight normal numbers has its median at 0.918 (chi-squared with 8 degrees of freedom: 7.344).
    return max(LEAST_SD_PX, float(np.sqrt(np.median((residuals**2).mean(axis=(1, 2))) / 0.918)))


def _off(bundle: Bundle, given: Array) -> Array:
    """Logarithm of each side over the one that was given, in deviations `(t,)`."""
    return np.asarray(np.log(bundle.sides / given) / SIZE_SD)


def _cost(rows: _Rows, bundle: Bundle, given: Array, sd: float) -> float:
    """What is minimised: the logarithmic cost of Cauchy, for sightings and for sides."""
    squares = (rows.residuals**2).sum(axis=(1, 2)) / sd**2
    lost = np.log1p(squares / (8.0 * LARGE**2)).sum() * 8.0 * LARGE**2
    return float(lost + np.log1p(_off(bundle, given) ** 2 / LARGE**2).sum() * LARGE**2)


def _slopes(squares: Array, of: float) -> Array:
    """Derivative of Cauchy's cost by the squares."""
    return np.asarray(1.0 / (1.0 + squares / (of * LARGE**2)))


class _System:
    """The normal equations at a bundle, images eliminated."""

    def __init__(self, rows: _Rows, seen: Sightings, bundle: Bundle, given: Array, sd: float, origin: int) -> None:
        self._seen, count = seen, len(bundle.sides)
        weight = _slopes((rows.residuals**2).sum(axis=(1, 2)) / sd**2, 8.0) / sd**2
        right = rows.residuals.reshape(-1, 8)
        weighted = rows.by_image * weight[:, None, None]
        self._ii, self._ri = np.zeros((len(bundle.eye_turns), IMAGE, IMAGE)), np.zeros((len(bundle.eye_turns), IMAGE))
        np.add.at(self._ii, seen.images, weighted.swapaxes(1, 2) @ rows.by_image)
        np.add.at(self._ri, seen.images, np.einsum("nki,nk->ni", weighted, right))
        self._it = weighted.swapaxes(1, 2) @ rows.by_tag
        weighted = rows.by_tag * weight[:, None, None]
        self._tt, self._rt = np.zeros((count, TAG, TAG)), np.zeros((count, TAG))
        np.add.at(self._tt, seen.tags, weighted.swapaxes(1, 2) @ rows.by_tag)
        np.add.at(self._rt, seen.tags, np.einsum("nki,nk->ni", weighted, right))
        off = _off(bundle, given)
        slope = _slopes(off**2, 1.0) / SIZE_SD
        self._tt[:, 6, 6] += slope / SIZE_SD
        self._rt[:, 6] -= slope * off
        # The origin's pose is the map's: nothing moves it.
        self._free = np.ones(count * TAG, dtype=bool)
        self._free[origin * TAG : origin * TAG + 6] = False

    def step(self, damping: float) -> tuple[Array, Array]:
        """Steps of the images `(i, 6)` and of the tags `(t, 7)`."""
        inverses = _inverted(self._ii, damping)
        matrix, right = self._reduced(inverses, damping)
        by_tag = np.zeros(len(right))
        by_tag[self._free] = np.linalg.solve(matrix[np.ix_(self._free, self._free)], right[self._free])
        tags = by_tag.reshape(-1, TAG)
        left = self._ri.copy()
        np.subtract.at(left, self._seen.images, np.einsum("nij,nj->ni", self._it, tags[self._seen.tags]))
        return np.einsum("nij,nj->ni", inverses, left), tags

    def _reduced(self, inverses: Array, damping: float) -> tuple[Array, Array]:
        """The system of the tags `(7 t, 7 t)`, `(7 t,)`: S = T - sum of W' I^-1 W over the images."""
        count = len(self._tt)
        blocks = np.zeros((count, TAG, count, TAG))
        blocks[np.arange(count), :, np.arange(count)] = _damped(self._tt, damping)
        matrix, right, images = blocks.reshape(count * TAG, -1), self._rt.reshape(-1).copy(), self._seen.images
        rows = (self._seen.tags[:, None] * TAG + np.arange(TAG)).reshape(-1)
        between = self._it.swapaxes(1, 2).reshape(-1, IMAGE)
        firsts = np.flatnonzero(np.diff(images, prepend=-1, append=images[-1] + 1))
        for first, last in itertools.pairwise(firsts.tolist()):
            own, of_image = slice(first * TAG, last * TAG), images[first]
            carried = between[own] @ inverses[of_image]
            matrix[rows[own, None], rows[own]] -= carried @ between[own].T
            right[rows[own]] -= carried @ self._ri[of_image]
        return matrix, right

    def covariance(self) -> Array:
        """Of the tags `(7 t, 7 t)`: the inverse of the reduced system."""
        matrix, _ = self._reduced(_inverted(self._ii, UNDAMPED), UNDAMPED)
        whole = np.zeros_like(matrix)
        whole[np.ix_(self._free, self._free)] = np.linalg.inv(matrix[np.ix_(self._free, self._free)])
        return whole


def _damped(blocks: Array, damping: float) -> Array:
    """Normal blocks `(k, m, m)` with their diagonals raised."""
    found: Array = blocks.copy()
    diagonal = np.arange(blocks.shape[-1])
    found[:, diagonal, diagonal] *= 1.0 + damping
    found[:, diagonal, diagonal] += 1e-9
    return found


def _inverted(blocks: Array, damping: float) -> Array:
    """Inverses of damped normal blocks `(k, m, m)`."""
    return np.asarray(np.linalg.inv(_damped(blocks, damping)), np.float64)


def _moved(bundle: Bundle, images: Array, tags: Array) -> Bundle:
    """The bundle after steps of images `(i, 6)` and tags `(t, 7)`."""
    return Bundle(
        _turned(bundle.turns, tags[:, 3:6]),
        bundle.places + tags[:, :3],
        bundle.sides * np.exp(np.clip(tags[:, 6], -0.5, 0.5)),
        _turned(bundle.eye_turns, images[:, 3:]),
        bundle.eye_places + images[:, :3],
    )


def _turned(turns: Array, by: Array) -> Array:
    """Rotations `(k, 3, 3)` multiplied from the left by those of rotation vectors `(k, 3)` [rad]."""
    return np.array([cv2.Rodrigues(each)[0] @ turn for turn, each in zip(turns, by, strict=True)])
