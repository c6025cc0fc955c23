"""The black-white edges of a target, sampled, in the target's frame."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from mkdaemon.vision.arrays import Array
from mkdaemon.vision.tags.tagmap import Tag, Target, covered

SAMPLED = (0.15, 0.7)
"""Where the samples of an edge begin, and the length they are spread over [cells]: corners are rounded by blur."""
BESIDE_CELLS = 0.5
"""An edge is left out where a tag hides a point so far beside it [cells]: the paper's rim is nearer than that, and far
away both are one (in fair light 9 of 210 edges of the nested target lay beside their place, its inner tag among 8 mm of
black)."""

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
        side: 0-3 for samples on the border (top, right, bottom, left), -1 inside `(n,)`.
        square: number of the square of the print whose rim each sample is on; a cell is one `(n,)`.
        smaller: whether each sample is on a tag of a smaller size, for the second size and those after it `(n, k)`.
        upright: whether a move along x of the largest tag, rather than along its y, shifts the edge `(n,)`.
    """

    points: Array
    normals: Array
    tangents: Array
    cell: Array
    tag: npt.NDArray[np.intp]
    side: npt.NDArray[np.intp]
    square: npt.NDArray[np.intp]
    smaller: npt.NDArray[np.bool_]
    upright: npt.NDArray[np.bool_]

    @classmethod
    def of(cls, target: Target, per_cell: int = 3) -> EdgeModel:
        """Sample every visible edge of a target `per_cell` times a cell."""
        planes, ways, sides = zip(*(_tag_edges(tag, per_cell) for tag in target.tags), strict=True)
        counts = [len(plane) for plane in planes]
        index = np.repeat(np.arange(len(target.tags)), counts)
        points = np.concatenate([tag.place(plane) for tag, plane in zip(target.tags, planes, strict=True)])
        normals = np.concatenate([way @ tag.rotation[:, :2].T for tag, way in zip(target.tags, ways, strict=True)])
        tangents = np.cross(np.array([tag.rotation[:, 2] for tag in target.tags])[index], normals)
        cell = np.array([tag.module for tag in target.tags])[index]
        keep = np.ones(len(points), dtype=bool)
        beside = (BESIDE_CELLS * cell)[:, None] * normals
        for k, tag in enumerate(target.tags):
            hidden = covered(points, tag) | covered(points - beside, tag) | covered(points + beside, tag)
            keep &= ~((index < k) & hidden)
        squares = np.concatenate([_squares(tag, plane) for tag, plane in zip(target.tags, planes, strict=True)])
        numbered = np.column_stack([index, squares])[keep]
        by_axis = np.abs(normals @ target.tags[0].rotation[:, :2])
        return cls(
            points[keep],
            normals[keep],
            tangents[keep],
            cell[keep],
            index[keep],
            np.concatenate(sides)[keep],
            np.unique(numbered, axis=0, return_inverse=True)[1].reshape(-1),
            cell[keep, None] == sorted({tag.module for tag in target.tags}, reverse=True)[1:],
            (by_axis[:, 0] > by_axis[:, 1])[keep],
        )

    @property
    def stepped(self) -> Array:
        """The samples, then a step from each across its edge, then one along it `(3 n, 3)` [m; target]."""
        step = (STEP * self.cell)[:, None]
        return np.concatenate([self.points, self.points + step * self.normals, self.points + step * self.tangents])


def seen_across(pixels: Array) -> tuple[Array, Array]:
    """How edges and their cells run in the image, from where `EdgeModel.stepped` is seen `(3 n, 2)` [px].

    The normal of an edge in the image is not the image of its normal on the print: in a steep view onto a corner these
    are 40 degrees apart.

    Returns:
        Normals towards the brighter side, unit `(n, 2)`, and the side of the cells along them `(n,)` [px].
    """
    at, across, along = pixels.reshape(3, -1, 2)
    run, rise = along - at, across - at
    normals = np.stack([-run[:, 1], run[:, 0]]).T
    length = np.sqrt((run * run).sum(axis=1))
    normals /= np.maximum(length, ON_EDGE)[:, None]
    height = (rise * normals).sum(axis=1)
    normals *= np.where(height < 0.0, -1.0, 1.0)[:, None]
    return normals, np.abs(height) / STEP


def rows_of(columns: Array, index: npt.NDArray[np.intp]) -> Array:
    """Some rows `(m, k)` of an array `(n, k)`, with columns that lie together in memory."""
    return columns.T[:, index].T


@lru_cache(maxsize=1024)
def spread_evenly(count: int, most: int) -> npt.NDArray[np.intp]:
    """`most` of the numbers below `count`."""
    return np.linspace(0, count - 1, most).astype(np.intp)


def _squares(tag: Tag, plane: Array) -> npt.NDArray[np.intp]:
    """Column and row `(n, 2)` of the cells whose left and lower edges points `(n, 2)` of its plane lie on."""
    return np.floor(plane / tag.module + tag.family.black_cells / 2 + ON_EDGE).astype(np.intp)


def _tag_edges(tag: Tag, per_cell: int) -> tuple[Array, Array, npt.NDArray[np.intp]]:
    """Points, normals `(n, 2)` in the tag's plane and border sides `(n,)`."""
    n = tag.family.black_cells
    bright = np.pad((tag.bitmap > 0).astype(int), 1, constant_values=1)
    along = SAMPLED[0] + SAMPLED[1] * (np.arange(per_cell) + 0.5) / per_cell
    points: list[Array] = []
    normals: list[Array] = []
    sides: list[npt.NDArray[np.intp]] = []
    # Across x and, on the transposed grid, across y; row 0 is the top, where y is positive.
    for axis, (grid, first, last) in enumerate(((bright, 3, 1), (bright.T, 0, 2))):
        rise = np.diff(grid[1:-1], axis=1)
        line, place = np.nonzero(rise)
        at = np.zeros((len(line), per_cell, 2))
        at[:, :, axis], at[:, :, 1 - axis] = place[:, None], line[:, None] + along
        way = np.zeros_like(at)
        way[:, :, axis] = rise[line, place][:, None]
        points.append(at.reshape(-1, 2))
        normals.append(way.reshape(-1, 2))
        side = np.where(place == 0, first, np.where(place == n, last, -1))
        sides.append(np.repeat(side, per_cell).astype(np.intp))
    down = np.array([1.0, -1.0])
    plane = (np.concatenate(points) - n / 2) * down * tag.module
    return plane, np.concatenate(normals) * down, np.concatenate(sides)
