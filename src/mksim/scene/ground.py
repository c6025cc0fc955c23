"""The ground under the aircraft: procedural, photo-like, repeating every ten metres without a seam."""

from __future__ import annotations

from functools import lru_cache
from typing import Literal

import cv2
import numpy as np
import numpy.typing as npt

from mksim.scene.view import CameraView, RayGrid

Image32 = npt.NDArray[np.float32]
Array = npt.NDArray[np.float64]
GroundKind = Literal["grass", "asphalt", "tiles", "clutter"]

SIDE_TEXELS = 2048
TEXEL_M = 0.005
SKY = 0.75
"""Brightness above the horizon, as a share of what white paper in the light would send."""
TILE_PX = 80
"""Oblique views choose their texture level per tile of this side [px]."""


@lru_cache(maxsize=4)
def ground_texture(kind: GroundKind, seed: int) -> Image32:
    """Reflectance `(2048, 2048)` of 10.24 m x 10.24 m, periodic in both directions.

    Args:
        kind: grass, asphalt, paving tiles, or clutter (tiles strewn with bright and dark rectangles and boards of
            squares, the things that look like tags and are none).
        seed: two seeds give two grounds.
    """
    rng = np.random.default_rng([seed, ("grass", "asphalt", "tiles", "clutter").index(kind)])
    if kind == "grass":
        ground = 0.22 + 0.10 * _cloud(rng, -1.6) + 0.09 * _blades(rng) + 0.03 * _cloud(rng, -0.4)
    elif kind == "asphalt":
        ground = 0.20 + 0.04 * _cloud(rng, -1.8) + 0.05 * _cloud(rng, -0.2) + 0.30 * _specks(rng, 0.01)
    else:
        ground = _paving(rng)
        if kind == "clutter":
            _add_stones(ground, rng)
    return np.asarray(np.clip(ground, 0.02, 0.95), dtype=np.float32)


@lru_cache(maxsize=6)
def _falloff(slope: float) -> Array:
    """Amplitude of each frequency of a cloud."""
    fy = np.fft.fftfreq(SIDE_TEXELS)[:, None]
    fx = np.fft.rfftfreq(SIDE_TEXELS)[None, :]
    frequency = np.hypot(fx, fy)
    frequency[0, 0] = 1.0
    return np.asarray(np.maximum(frequency, 4 / SIDE_TEXELS) ** slope)


def _cloud(rng: np.random.Generator, slope: float) -> Image32:
    """Periodic noise of unit variance whose amplitude falls as frequency to the power `slope`."""
    spectrum = np.fft.rfft2(rng.standard_normal((SIDE_TEXELS, SIDE_TEXELS)))
    spectrum *= _falloff(slope)
    spectrum[0, 0] = 0.0
    noise = np.fft.irfft2(spectrum, s=(SIDE_TEXELS, SIDE_TEXELS))
    return np.asarray(noise / noise.std(), dtype=np.float32)


def _blades(rng: np.random.Generator) -> Image32:
    """Short streaks in several directions, unit variance."""
    total = np.zeros((SIDE_TEXELS, SIDE_TEXELS), dtype=np.float32)
    for angle in rng.uniform(0.0, np.pi, 5):
        seeds = rng.standard_normal((SIDE_TEXELS, SIDE_TEXELS), dtype=np.float32)
        kernel = np.zeros((15, 15), dtype=np.float32)
        reach = 6 * np.array([np.cos(angle), np.sin(angle)])
        cv2.line(
            kernel, tuple(np.rint(7 - reach).astype(int)), tuple(np.rint(7 + reach).astype(int)), 1.0, 1, cv2.LINE_AA
        )
        total += cv2.filter2D(np.pad(seeds, 8, mode="wrap"), -1, kernel)[8:-8, 8:-8]
    return np.asarray(total / total.std(), dtype=np.float32)


def _specks(rng: np.random.Generator, share: float) -> Image32:
    """Single bright stones on `share` of the area."""
    stones = (rng.random((SIDE_TEXELS, SIDE_TEXELS)) < share).astype(np.float32)
    return np.asarray(cv2.GaussianBlur(stones, (3, 3), 0.7), dtype=np.float32)


def _paving(rng: np.random.Generator) -> Image32:
    """Concrete slabs of 0.32 m with dark joints, each slab its own shade."""
    step = 64
    count = SIDE_TEXELS // step
    shade = np.kron(rng.uniform(0.38, 0.55, (count, count)), np.ones((step, step)))
    is_edge = np.arange(SIDE_TEXELS) % step < 2
    joint = is_edge[:, None] | is_edge
    slabs = np.where(joint, 0.15, shade) + 0.03 * _cloud(rng, -1.4) + 0.02 * _cloud(rng, 0.0)
    return np.asarray(slabs, dtype=np.float32)


def _add_stones(ground: Image32, rng: np.random.Generator) -> None:
    """Lay rectangles and boards of random squares on the ground, none of them a tag."""
    for _ in range(260):
        centre = rng.uniform(0, SIDE_TEXELS, 2)
        box = cv2.boxPoints((tuple(centre), tuple(rng.uniform(8, 90, 2)), float(rng.uniform(0, 90))))
        low = np.clip(box.min(axis=0).astype(int) - 2, 0, SIDE_TEXELS)
        high = np.clip(box.max(axis=0).astype(int) + 3, 0, SIDE_TEXELS)
        mask = np.zeros((high - low)[::-1], dtype=np.uint8)
        cv2.fillPoly(mask, [np.rint((box - low) * 16).astype(np.int32)], 255, cv2.LINE_AA, shift=4)
        part = ground[low[1] : high[1], low[0] : high[0]]
        part += mask / np.float32(255) * (np.float32(rng.choice([0.05, 0.1, 0.7, 0.85])) - part)
    for _ in range(60):
        cells = int(rng.integers(4, 9))
        cell = int(rng.integers(2, 8))
        board = np.kron(rng.choice([0.06, 0.8], (cells, cells)), np.ones((cell, cell))).astype(np.float32)
        board = np.pad(board, cell, constant_values=float(rng.choice([0.06, 0.8])))
        turn = cv2.getRotationMatrix2D((board.shape[1] / 2, board.shape[0] / 2), float(rng.uniform(0, 360)), 1.0)
        size = 2 * max(board.shape)
        turn[:, 2] += size / 2 - board.shape[0] / 2
        turned = cv2.warpAffine(board, turn, (size, size), flags=cv2.INTER_LINEAR, borderValue=-1.0)
        y, x = rng.integers(0, SIDE_TEXELS - size, 2)
        patch = ground[y : y + size, x : x + size]
        np.copyto(patch, turned, where=turned >= 0.0)


@lru_cache(maxsize=1)
def _pyramid(kind: GroundKind, seed: int) -> tuple[list[Image32], list[Image32]]:
    """The texture at ever coarser levels, and each of them with a border that repeats it; read-only."""
    level = ground_texture(kind, seed)
    levels = [level]
    while level.shape[0] > 64:
        level = np.asarray(cv2.resize(level, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA), dtype=np.float32)
        levels.append(level)
    return levels, [np.pad(level, level.shape[0] // 2, mode="wrap") for level in levels]


class Ground:
    """The plane z = 0 [ENU] as the camera samples it, with coarser levels for farther ground."""

    def __init__(self, kind: GroundKind, seed: int) -> None:
        self._levels, self._padded = _pyramid(kind, seed)

    def render(self, view: CameraView, rays: RayGrid) -> Image32:
        """Reflectance `(height, width)` the camera sees; `SKY` above the horizon and below ground."""
        if view.position_enu[2] <= 0.0:
            return np.full(rays.x.shape, SKY, dtype=np.float32)
        r = view.enu_from_cam
        down = -(r[2, 0] * rays.x + r[2, 1] * rays.y + np.float32(r[2, 2]))
        down = down.astype(np.float32)
        steepest, flattest = float(down.max()), float(down.min())
        if flattest > 0.4 * steepest:
            return self._sample(view, rays, down, slice(None), slice(None))
        out: Image32 = np.empty_like(down)
        for top in range(0, down.shape[0], TILE_PX):
            for left in range(0, down.shape[1], TILE_PX):
                rows, columns = slice(top, top + TILE_PX), slice(left, left + TILE_PX)
                out[rows, columns] = self._sample(view, rays, down, rows, columns)
        return out

    def _sample(self, view: CameraView, rays: RayGrid, down: Image32, rows: slice, columns: slice) -> Image32:
        """One window at the texture level that fits its middle."""
        slope: Image32 = down[rows, columns]
        visible = slope > 1e-3
        if not visible.any():
            return np.full_like(slope, SKY)
        x, y = rays.x[rows, columns], rays.y[rows, columns]
        r, position = view.enu_from_cam, view.position_enu
        # A ray d from height z meets the ground after z / -d_z. At level log2(footprint / texel) a texel is as large as
        # a pixel there (a mipmap, L. Williams, SIGGRAPH 1983).
        reach = np.float32(position[2]) / np.maximum(slope, np.float32(1e-3))
        middle = float(reach[slope.shape[0] // 2, slope.shape[1] // 2])
        grazing = max(float(position[2]) / (middle * 1.2), 0.05)
        footprint = middle / view.intrinsics.fx / np.sqrt(grazing)
        index = int(np.clip(np.ceil(np.log2(max(footprint / TEXEL_M, 1e-9)) - 0.3), 0, len(self._levels) - 1))
        level, padded = self._levels[index], self._padded[index]
        side, texel = level.shape[0], TEXEL_M * 2.0**index
        middle_row, middle_column = slope.shape[0] // 2, slope.shape[1] // 2
        maps = []
        for axis, sign in ((0, 1.0), (1, -1.0)):
            direction = r[axis, 0] * x + r[axis, 1] * y + np.float32(r[axis, 2])
            along = (np.float32(sign / texel) * (direction * reach + np.float32(position[axis]))).astype(np.float32)
            shift = side * np.floor(float(along[middle_row, middle_column]) / side)
            along += np.float32(side // 2 - 0.5 - shift)
            maps.append(np.clip(along, -16000, 16000, out=along))
        sampled = cv2.remap(padded, maps[0], maps[1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP)
        if not visible.all():
            sampled[~visible] = SKY
        return np.asarray(sampled, dtype=np.float32)
