"""The black-white edges of a target, sampled, in the target's frame."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from mkdaemon.vision.arrays import Array
from mkdaemon.vision.tags.cover import covered
from mkdaemon.vision.tags.tagmap import Tag, Target

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
        parts = [_tag_edges(tag, per_cell) for tag in target.tags]
        points = np.concatenate([tag.place(part[0]) for tag, part in zip(target.tags, parts, strict=True)])
        normals = np.concatenate(
            [part[1] @ tag.rotation[:, :2].T for tag, part in zip(target.tags, parts, strict=True)]
        )
        index = np.concatenate([np.full(len(part[0]), k) for k, part in enumerate(parts)])
        tangents = np.cross(np.array([tag.rotation[:, 2] for tag in target.tags])[index], normals)
        cell = np.array([tag.module for tag in target.tags])[index]
        side = np.concatenate([part[2] for part in parts])
        keep = np.ones(len(points), dtype=bool)
        beside = (BESIDE_CELLS * cell)[:, None] * normals
        for k, tag in enumerate(target.tags):
            hidden = covered(points, tag) | covered(points - beside, tag) | covered(points + beside, tag)
            keep &= ~((index < k) & hidden)
        squares = [_squares(tag, part[0], k) for k, (tag, part) in enumerate(zip(target.tags, parts, strict=True))]
        square = np.unique(np.concatenate(squares)[keep], axis=0, return_inverse=True)[1].reshape(-1)
        by_axis = np.abs(normals @ target.tags[0].rotation[:, :2])
        upright = by_axis[:, 0] > by_axis[:, 1]
        smaller = cell[keep, None] == sorted({tag.module for tag in target.tags}, reverse=True)[1:]
        return cls(
            points[keep],
            normals[keep],
            tangents[keep],
            cell[keep],
            index[keep],
            side[keep],
            square,
            smaller,
            upright[keep],
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


def _squares(tag: Tag, plane: Array, k: int) -> npt.NDArray[np.intp]:
    """Tag, column and row `(n, 3)` of the cells whose left and lower edges points `(n, 2)` of its plane lie on."""
    place = np.floor(plane / tag.module + tag.family.black_cells / 2 + ON_EDGE).astype(np.intp)
    return np.column_stack([np.full(len(plane), k, dtype=np.intp), place])


def _tag_edges(tag: Tag, per_cell: int) -> tuple[Array, Array, npt.NDArray[np.intp]]:
    """Points, normals `(n, 2)` in the tag's plane and border sides `(n,)`."""
    n = tag.family.black_cells
    bright = np.pad((tag.bitmap > 0).astype(np.int8), 1, constant_values=1)
    along = SAMPLED[0] + SAMPLED[1] * (np.arange(per_cell) + 0.5) / per_cell
    points: list[Array] = []
    normals: list[Array] = []
    sides: list[npt.NDArray[np.intp]] = []
    for axis in (0, 1):
        # Differences along x (axis 0) and, on the transposed grid, along y; row 0 is the top, where y is positive.
        grid = bright if axis == 0 else bright.T
        rise = grid[1:-1, 1:].astype(int) - grid[1:-1, :-1]
        line, place = np.nonzero(rise)
        sign = rise[line, place].astype(np.float64)
        across = np.repeat(place.astype(np.float64), per_cell)
        run = (line[:, None] + along[None, :]).ravel()
        sign = np.repeat(sign, per_cell)
        side = np.where(across == 0, 3 if axis == 0 else 0, np.where(across == n, 1 if axis == 0 else 2, -1))
        if axis == 0:
            points.append(np.column_stack([across, run]))
            normals.append(np.column_stack([sign, np.zeros_like(sign)]))
        else:
            points.append(np.column_stack([run, across]))
            normals.append(np.column_stack([np.zeros_like(sign), -sign]))
        sides.append(side.astype(np.intp))
    cells_xy = np.concatenate(points)
    plane = np.column_stack([cells_xy[:, 0] - n / 2, n / 2 - cells_xy[:, 1]]) * tag.module
    return plane, np.concatenate(normals), np.concatenate(sides)
