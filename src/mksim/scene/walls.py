"""Walls of a scene, and the order in which upright and raised surfaces are drawn.

All surfaces are flat, and none reaches below the ground, so the ground and what lies on it are behind everything else.
The rest is drawn from the back to the front. A surface can hide another one only if a part of that lies beyond its
plane; where both could, they would have to cross each other.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
import numpy.typing as npt

from mksim.config import WallConfig
from mksim.scene.ground import SIDE_TEXELS, TEXEL_M, GroundKind, ground_texture
from mksim.scene.layers import Layer
from mksim.scene.view import CameraView, ViewPose, project

Array = npt.NDArray[np.float64]
Image32 = npt.NDArray[np.float32]

CELL_M: Final = 0.01
"""Texels of a wall's surface [m], coarser where it is longer than `MOST_CELLS` of them."""
MOST_CELLS: Final = 1024
BEYOND: Final = 0.005
"""A surface this far beyond the plane of another one, or less, lies on it [m]."""
ON_GROUND: Final = 0.02
"""What is no higher lies on the ground [m]."""


@dataclass(frozen=True, eq=False)
class Surface:
    """A flat surface that stands on the ground or above it.

    Attributes:
        layer: what it looks like; its position and rotation are those in the body of `pose`.
        pose: of that body in the world.
        is_wall: it can hide what is behind it; what hangs on it does not reach beyond it.
    """

    layer: Layer
    pose: ViewPose
    is_wall: bool = False

    @property
    def plane(self) -> ViewPose:
        """Of its xy plane in the world."""
        rotation, place = self.layer.rotation, self.layer.position
        return ViewPose(self.pose.enu_from_body @ rotation, self.pose.points(place[None])[0])

    @property
    def corners(self) -> Array:
        """`(4, 3)` [m; ENU]."""
        return self.pose.points(self.layer.outline())

    @property
    def is_raised(self) -> bool:
        """Whether it does not lie on the ground."""
        return bool(self.corners[:, 2].max() > ON_GROUND)


WORLD: Final = ViewPose(np.eye(3), np.zeros(3))


def wall_surfaces(walls: Sequence[WallConfig], seed: int) -> tuple[Surface, ...]:
    """Return both faces of each wall."""
    found: list[Surface] = []
    for number, wall in enumerate(walls):
        (x, y), (to_x, to_y) = wall.start, wall.end
        length = math.dist(wall.start, wall.end)
        right, up = np.array([to_x - x, to_y - y, 0.0]) / length, np.array([0.0, 0.0, 1.0])
        middle = np.array([(x + to_x) / 2.0, (y + to_y) / 2.0, wall.bottom + wall.height / 2.0])
        cells = _texture(wall.surface, seed, number, length, wall.height)
        for side in (right, -right):
            rotation = np.column_stack([side, up, np.cross(side, up)])
            found.append(Surface(Layer(cells, length, wall.height, middle, rotation), WORLD, is_wall=True))
    return tuple(found)


def _texture(kind: GroundKind, seed: int, number: int, width: float, height: float) -> Image32:
    """Reflectance of a wall: a piece of the ground of that kind, each wall another one."""
    ground = ground_texture(kind, seed)
    texels = max(round(CELL_M / TEXEL_M), math.ceil(max(width, height) / (TEXEL_M * MOST_CELLS)))
    rows, columns = (max(1, round(side / (texels * TEXEL_M))) for side in (height, width))
    first = np.random.default_rng([seed, number, 0x3A11]).integers(0, SIDE_TEXELS, 2)
    down, across = (np.arange(size * texels) + start for size, start in zip((rows, columns), first, strict=True))
    piece = ground[np.ix_(down % SIDE_TEXELS, across % SIDE_TEXELS)]
    return np.asarray(cv2.resize(piece, (columns, rows), interpolation=cv2.INTER_AREA), dtype=np.float32)


def back_to_front(surfaces: Sequence[Surface], eye: Array) -> list[Surface]:
    """Return surfaces in the order in which they are drawn for an eye at a place (3,) [m; ENU].

    Others than walls hide no wall, and each other in the order in which they are given.
    """
    left = list(range(len(surfaces)))
    corners = np.array([surface.corners for surface in surfaces]).reshape(len(surfaces), 4, 3)
    beyond = np.zeros((len(surfaces), len(surfaces)), dtype=bool)  # [a, b]: a can hide b
    for number, surface in enumerate(surfaces):
        if surface.is_wall:
            plane = surface.plane
            normal = plane.enu_from_body[:, 2]
            side = (eye - plane.position_enu) @ normal
            beyond[number] = (((corners - plane.position_enu) @ normal) * np.sign(side) < -BEYOND).any(axis=1)
    walls = np.array([surface.is_wall for surface in surfaces], dtype=bool)
    # `later[a, b]`: a is drawn after b. A wall is behind everything on its near side that is no wall.
    later = beyond & ~beyond.T
    later |= (~walls[:, None] & walls[None, :]) & ~beyond.T
    order: list[Surface] = []
    while left:
        ready = next((n for n in left if not later[n, left].any()), left[0])
        left.remove(ready)
        order.append(surfaces[ready])
    return order


def flow_of(surfaces: Sequence[Surface], view: CameraView) -> float:
    """Longest way in the image of a point on a surface during the exposure [px]; zero where none is in view."""
    points = np.concatenate([surface.pose.points(surface.layer.outline(8)) for surface in surfaces])
    ends = [
        project(view.moved(along * view.exposure_time).camera_points(points), view.intrinsics) for along in (-0.5, 0.5)
    ]
    size = view.intrinsics.width, view.intrinsics.height
    in_view = ((ends[0] >= 0.0) & (ends[0] <= size)).all(axis=1)
    moved = np.linalg.norm(ends[1] - ends[0], axis=1)[in_view]
    return float(np.nan_to_num(moved).max(initial=0.0))
