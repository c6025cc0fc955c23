"""The black-white edges of a target, sampled, in the target's frame."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from mkdaemon.vision.arrays import Array, Bools, Numbers
from mkdaemon.vision.tags.tagmap import Target, covered

SAMPLED = (0.15, 0.7)
"""Where the samples of an edge begin, and the length they are spread over [cells]: corners are rounded by blur."""
BESIDE_CELLS = 0.5
"""An edge is ignored if a tag hides a point at this distance beside it [cells]: from far away the paper's rim merges
with it."""

ON_EDGE = 1e-6
"""Rounding errors of a point on an edge, at most [cells]."""
STEP = 0.1
"""Length of the steps along and across an edge that give its direction in the image [cells]."""


@dataclass(frozen=True, slots=True, eq=False)
class EdgeModel:
    """Samples on the edges of a target.

    Attributes:
        points: `(n, 3)` [m; target].
        normals: towards the brighter side, unit `(n, 3)` [target].
        tangents: along the edges, unit `(n, 3)` [target].
        cell: side of the cell at each sample `(n,)` [m].
        tag: index of the tag of each sample `(n,)`.
        square: number of the square of the print whose rim each sample is on; a cell is one `(n,)`.
        line: number of the straight line of the print each sample is on `(n,)`.
        smaller: whether each sample is on a tag of a smaller size, for the second size and those after it `(k, n)`.
        upright: whether a move along x of the largest tag, rather than along its y, shifts the edge `(n,)`.
    """

    points: Array
    normals: Array
    tangents: Array
    cell: Array
    tag: Numbers
    square: Numbers
    line: Numbers
    smaller: Bools
    upright: Bools

    @classmethod
    def of(cls, target: Target, per_cell: int = 3) -> EdgeModel:
        """Sample every visible edge of a target `per_cell` times a cell."""
        tags = target.tags
        parts = [_tag_edges(target, k, per_cell) for k in range(len(tags))]
        points, normals, tangents, cells, lines = (np.concatenate(part) for part in zip(*parts, strict=True))
        tag = np.repeat(np.arange(len(tags)), [len(part[0]) for part in parts])
        cell = np.array([one.module for one in tags])[tag]
        square, line = (
            np.unique(np.column_stack([tag, places]), axis=0, return_inverse=True)[1].reshape(-1)
            for places in (cells, lines)
        )
        sizes = sorted({one.module for one in tags}, reverse=True)
        smaller = np.array(sizes[1:])[:, None] == cell
        by_axis = np.abs(normals @ tags[0].rotation[:, :2])
        return cls(points, normals, tangents, cell, tag, square, line, smaller, by_axis[:, 0] > by_axis[:, 1])

    @property
    def sides(self) -> Array:
        """Middles of the cells on the black and on the white side of each sample `(2, n, 3)` [m; target]."""
        half = self.cell[:, None] / 2 * self.normals
        return np.stack([self.points - half, self.points + half])

    @property
    def stepped(self) -> Array:
        """The samples, then a step from each across its edge, then one along it `(3 n, 3)` [m; target]."""
        step = (STEP * self.cell)[:, None]
        return np.concatenate([self.points, self.points + step * self.normals, self.points + step * self.tangents])


@dataclass(frozen=True, slots=True, eq=False)
class Samples:
    """Samples of an edge model, projected.

    Attributes:
        index: which of the model `(n,)`.
        pixels: where a pose puts them `(n, 2)` [px].
        normals: towards the brighter side, unit `(n, 2)`.
        reach: how far along the normal the edge may be `(n,)` [px].
        cell_px: side of its cells along the normal `(n,)` [px].
        upright: whether a move along x of the target shifts it `(n,)`, rather than one along y.
        are_near: whether they are about in their place.
    """

    index: Numbers
    pixels: Array
    normals: Array
    reach: Array
    cell_px: Array
    upright: Bools
    are_near: bool = True


def seen_across(pixels: Array) -> tuple[Array, Array]:
    """Directions of edges and cells in the image, from the image of `EdgeModel.stepped` `(3 n, 2)` [px].

    The normal of an edge in the image is not the image of its normal on the print: in a steep view onto a corner these
    are 40 degrees apart.

    Returns:
        Normals towards the brighter side, unit `(n, 2)`, and the side of the cells along them `(n,)` [px].
    """
    at, across, along = pixels.reshape(3, -1, 2)
    run, rise = along - at, across - at
    normals = np.array([-run[:, 1], run[:, 0]]).T
    length = np.sqrt((run * run).sum(axis=1))
    normals /= np.maximum(length, ON_EDGE)[:, None]
    height = (rise * normals).sum(axis=1)
    normals *= np.where(height < 0.0, -1.0, 1.0)[:, None]
    return normals, np.abs(height) / STEP


def _tag_edges(target: Target, k: int, per_cell: int) -> tuple[npt.NDArray[Any], ...]:
    """Points, normals, tangents `(n, 3)`, cells `(n, 2)` and lines `(n,)` of the samples on one tag of a target."""
    tag = target.tags[k]
    bright = np.pad((tag.bitmap > 0).astype(int), 1, constant_values=1)
    along = SAMPLED[0] + SAMPLED[1] * (np.arange(per_cell) + 0.5) / per_cell
    places: list[Array] = []
    ways: list[Array] = []
    lines: list[Numbers] = []
    # Across x and, on the transposed grid, across y; row 0 is the top, where y is positive.
    for grid, xy in ((bright, (0, 1)), (bright.T, (1, 0))):
        rise = np.diff(grid[1:-1], axis=1)
        line, place = (np.repeat(index, per_cell) for index in np.nonzero(rise))
        across = line + np.tile(along, len(line) // per_cell)
        places.append(np.stack([place, across], axis=1)[:, xy])
        lines.append(place + xy[0] * len(bright))
        ways.append(np.stack([rise[line, place], np.zeros_like(line)], axis=1)[:, xy])
    # From cells (column, row from the top left) to the tag's plane: p = (c - n / 2) * (1, -1) * cell, y upwards.
    down = np.array([1.0, -1.0])
    cells = np.concatenate(places)
    points = tag.place((cells - tag.family.black_cells / 2) * down * tag.module)
    normals = np.concatenate(ways) * down @ tag.rotation[:, :2].T
    beside = BESIDE_CELLS * tag.module * normals
    keep = np.ones(len(points), dtype=bool)
    for smaller in target.tags[k + 1 :]:
        keep &= ~(covered(points - beside, smaller) | covered(points + beside, smaller))
    # Samples belong to the cell right of and below their edge.
    square = np.floor(cells + ON_EDGE).astype(np.intp)
    found = points, normals, np.cross(tag.rotation[:, 2], normals), square, np.concatenate(lines)
    return tuple(part[keep] for part in found)
