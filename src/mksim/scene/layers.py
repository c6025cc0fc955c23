"""A printed target as flat layers that can be sampled without aliasing and without moving an edge.

A layer is a grid of equal cells. Its texture holds a whole number of texels per cell, so bilinear sampling turns each
edge between cells into a linear ramp of one texel centred exactly on the edge. Picking the texture whose texel is
about one sample wide therefore integrates over the sample's area and keeps the edge where it belongs, at any scale.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import cv2
import numpy as np
import numpy.typing as npt

from mkdaemon.vision.tags.tagfamily import QUIET_ZONE_CELLS
from mkdaemon.vision.tags.tagmap import Tag, Target

Image32 = npt.NDArray[np.float32]
Array = npt.NDArray[np.float64]

INK = 0.05
"""Share of the light black laser print reflects (measured prints: 0.04-0.07)."""
PAPER = 0.85
"""Share of the light matte paper reflects."""
TEXTURE_MAX_PX = 2048
"""Largest texture side kept [texel]."""
PAD = 2
"""Transparent texels around each texture."""


@dataclass(eq=False)
class Layer:
    """A rectangle of equal cells in the print plane.

    Attributes:
        cells: `(rows, columns)` reflectance, first row at the top.
        width: along the layer's x [m].
        height: along the layer's y [m].
        position: middle of the layer `(3,)` [m; target].
        rotation: target from layer `(3, 3)`; layer axes are x right, y up, z towards the reader.
    """

    cells: Image32
    width: float
    height: float
    position: Array = field(default_factory=lambda: np.zeros(3))
    rotation: Array = field(default_factory=lambda: np.eye(3))
    _textures: dict[tuple[float, int | None], Image32] = field(default_factory=dict, repr=False)

    def outline(self, steps: int = 1) -> Array:
        """Points along the edge `(4 * steps, 3)` [m; target]: from top-left by top-right, bottom-right, bottom-left."""
        corners = np.array([[-0.5, 0.5], [0.5, 0.5], [0.5, -0.5], [-0.5, -0.5]]) * (self.width, self.height)
        along = np.linspace(0.0, 1.0, steps, endpoint=False)[:, None]
        flat = np.concatenate([a + along * (b - a) for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True)])
        placed: Array = flat @ self.rotation[:, :2].T + self.position
        return placed

    def cells_from_plane(self) -> Array:
        """Matrix `(3, 3)`: layer plane `(x, y, 1)` [m] to cell coordinates (column, row, 1), (0, 0) at the top-left."""
        rows, columns = self.cells.shape
        return np.array(
            [[columns / self.width, 0.0, columns / 2], [0.0, -rows / self.height, rows / 2], [0.0, 0.0, 1.0]]
        )

    def texels_per_cell(self, wanted: float) -> float:
        """The finest density not above `wanted` among 2^k and 3*2^k, so that texels are 1 to 1.5 samples wide."""
        limit = TEXTURE_MAX_PX / max(self.cells.shape)
        wanted = float(np.clip(wanted, 0.25, limit))
        power = 2.0 ** np.floor(np.log2(wanted))
        return float(1.5 * power if 1.5 * power <= wanted and power >= 2 else power)

    @property
    def shade(self) -> float | None:
        """The reflectance where all cells share one, as on a blank sheet; None otherwise."""
        first = float(self.cells.flat[0])
        return first if bool((self.cells == first).all()) else None

    def texture(self, density: float, channel: int | None = None) -> Image32:
        """Texture with `density` texels per cell and `PAD` clear texels around.

        Args:
            density: one that `texels_per_cell` gave.
            channel: 0 for reflectance times coverage `(h, w)`, 1 for coverage `(h, w)`, None for both `(h, w, 2)`.
        """
        found = self._textures.get((density, channel))
        if found is None:
            if density >= 1:
                found = self._magnified(int(density), channel)
            else:
                both = self._reduced(density)
                found = both if channel is None else np.ascontiguousarray(both[..., channel])
            self._textures[density, channel] = found
        return found

    def _magnified(self, density: int, channel: int | None) -> Image32:
        """Texture with a whole number of texels per cell."""
        height, width = (density * size for size in self.cells.shape)
        inside = slice(PAD, PAD + height), slice(PAD, PAD + width)
        texture = np.zeros((height + 2 * PAD, width + 2 * PAD, *([2] if channel is None else [])), dtype=np.float32)
        reflected = self.cells.repeat(density, axis=0).repeat(density, axis=1) if channel != 1 else 1.0
        texture[(*inside, 0) if channel is None else inside] = reflected
        if channel is None:
            texture[(*inside, 1)] = 1.0
        return texture

    def _reduced(self, density: float) -> Image32:
        """Texture with several cells per texel, both channels."""
        block = round(1 / density)
        rows, columns = (-size % block for size in self.cells.shape)
        texture = np.pad(np.dstack([self.cells, np.ones_like(self.cells)]), ((0, rows), (0, columns), (0, 0)))
        size = (texture.shape[1] // block, texture.shape[0] // block)
        texture = cv2.resize(texture, size, interpolation=cv2.INTER_AREA)
        return np.ascontiguousarray(np.pad(texture, ((PAD, PAD), (PAD, PAD), (0, 0))), dtype=np.float32)


def tag_layer(tag: Tag, quiet: int = QUIET_ZONE_CELLS) -> Layer:
    """A tag in its place on the target, with `quiet` white modules around its black square."""
    bitmap = tag.bitmap
    cells = np.pad(np.where(bitmap > 0, PAPER, INK), quiet, constant_values=PAPER).astype(np.float32)
    side = tag.module * cells.shape[0]
    return Layer(cells, side, side, tag.position, tag.rotation)


def sheet_layer(width: float, height: float, position: Array | None = None) -> Layer:
    """A blank sheet of paper [m], middle at `position` [m; target]; several cells, so that its outline stays sharp."""
    return Layer(np.full((8, 8), PAPER, np.float32), width, height, np.zeros(3) if position is None else position)


def board_layer(image: npt.NDArray[np.uint8], width: float, height: float) -> Layer:
    """A board drawn with a whole number of pixels per edge: `image` is spread over `width` x `height` [m]."""
    return Layer((INK + (PAPER - INK) * (image.astype(np.float32) / 255.0)), width, height)


def print_target(target: Target, margin: float = 1.0) -> tuple[Layer, ...]:
    """Every tag of a target, largest first; a board lies on a sheet `margin` modules wider than its quiet zone."""
    layers = [tag_layer(tag) for tag in target.tags]
    if target.is_planar and not target.is_map and np.allclose(target.tags[0].rotation[:, 2], (0.0, 0.0, 1.0)):
        corners = np.concatenate([tag.corners for tag in target.tags])[:, :2]
        white = (1.0 + margin) * target.tags[0].module
        low, high = corners.min(axis=0) - white, corners.max(axis=0) + white
        middle = np.array([*(low + high) / 2, target.tags[0].position[2]])
        layers.insert(0, sheet_layer(float(high[0] - low[0]), float(high[1] - low[1]), middle))
    return tuple(layers)
