"""What a known print looks like in the image from a pose: its texture warped, blurred, and averaged over pixels.

The model lives in the image, so perspective and the round point spread are right at any tilt.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from mkdaemon.vision.limits import Limits
from mkdaemon.vision.pose.projection import NEAR_M, Projection
from mkdaemon.vision.tags.tagmap import ONE_PLANE, Target

Array = npt.NDArray[np.float64]
Image32 = npt.NDArray[np.float32]
Grey = npt.NDArray[np.uint8]

FINE = 3
"""Sub-samples a pixel, each way; odd, so that one of them is its centre."""
TEXELS_PER_CELL = 12
SMALLEST_LEVEL = 12
"""Texels across the coarsest level of the texture."""
BLUR_REACH = 3
"""Deviations of the point spread that are rendered around the print."""
LENS_PATCH = 0.7
"""Share of the window at whose corners the lens is taken: the error of an affine lens is least in the middle."""


@dataclass(frozen=True, slots=True, eq=False)
class _Window:
    """Pixels of one fit, with a rim for the blur: place and size in the image."""

    x0: int
    y0: int
    width: int
    height: int


class PrintModel:
    """The print of one target; uses the tags in the plane of the largest one.

    Attributes:
        origin: centre of the largest tag `(3,)` [m; target].
        axes: target from that tag `(3, 3)`.
        half: half the side of its paper [m].
        cell: side of its cells [m].
    """

    def __init__(self, target: Target, projection: Projection, limits: Limits) -> None:
        self._projection = projection
        self._limits = limits.photo
        first = target.tags[0]
        self.origin, self.axes = first.position, first.rotation
        tags = [
            tag
            for tag in target.tags
            if float(tag.rotation[:, 2] @ first.rotation[:, 2]) > ONE_PLANE
            and abs(float(first.rotation[:, 2] @ (tag.position - first.position))) < first.module
        ]
        # One quiet zone around the largest tag is surely white; other tags count where they lie inside it.
        self.half = first.paper / 2
        self.cell = first.module
        side = (first.family.black_cells + 2) * TEXELS_PER_CELL
        self._texel = first.paper / side
        grid = (np.arange(side) + 0.5) * self._texel - self.half
        x, y = np.meshgrid(grid, -grid)
        texture = np.ones((side, side), dtype=np.float32)
        for tag in tags:
            plane = (tag.position - first.position) @ first.rotation
            turned = first.rotation.T @ tag.rotation
            local = np.stack([x - plane[0], y - plane[1]], axis=-1) @ turned[:2, :2]
            cells = np.pad(tag.bitmap, 1, constant_values=255)
            n = len(cells)
            column = np.floor(local[..., 0] / tag.module + n / 2).astype(int)
            row = np.floor(n / 2 - local[..., 1] / tag.module).astype(int)
            inside = (row >= 0) & (row < n) & (column >= 0) & (column < n)
            texture[inside] = cells[row[inside], column[inside]] / np.float32(255)
        self._levels: list[Image32] = [texture]
        while len(self._levels[-1]) >= 2 * SMALLEST_LEVEL:
            size = len(self._levels[-1]) // 2
            self._levels.append(
                np.asarray(cv2.resize(texture, (size, size), interpolation=cv2.INTER_AREA), dtype=np.float32)
            )

    def render(self, shape: tuple[int, ...], rotation: Array, position: Array, blur: float) -> RenderedPrint | None:
        """What the print looks like from a pose; none where it is not in full view, too small or too large.

        Args:
            shape: of the image.
            rotation: camera from target `(3, 3)`.
            position: of the target `(3,)` [m; RDF].
            blur: deviation of the point spread [px].
        """
        half = self.half - self._limits.margin_cells * self.cell
        corners = np.array([[-half, half], [half, half], [half, -half], [-half, -half]])
        seen = (corners @ self.axes[:, :2].T + self.origin) @ rotation.T + position
        uv, visible = self._projection.project(seen)
        if not bool(visible.all()):
            return None
        pad = int(np.ceil(BLUR_REACH * blur)) + 2
        x0, y0 = np.maximum(np.floor(uv.min(axis=0)).astype(int), pad)
        x1, y1 = np.minimum(np.ceil(uv.max(axis=0)).astype(int) + 1, [shape[1] - pad, shape[0] - pad])
        width, height = int(x1 - x0), int(y1 - y0)
        low, high = self._limits.min_window_px, self._limits.max_window_px
        if not (low <= width <= high and low <= height <= high):
            return None
        window = _Window(int(x0) - pad, int(y0) - pad, width + 2 * pad, height + 2 * pad)
        plane_from_pixel = self._plane_from_pixel(window, rotation, position)
        if plane_from_pixel is None:
            return None
        fine = self._warp(window, plane_from_pixel, rotation, position)
        fine = np.asarray(cv2.GaussianBlur(fine, (0, 0), blur * FINE), dtype=np.float32)
        fine = np.asarray(cv2.blur(fine, (FINE, FINE)), dtype=np.float32)
        return RenderedPrint(fine, window, pad, plane_from_pixel, self.half, half, blur)

    def _plane_from_pixel(self, window: _Window, rotation: Array, position: Array) -> Array | None:
        """Homography from window pixels to the print plane; the lens is taken as locally affine.

        A point (u, v, 1) of the print is seen along M (u, v, 1) with M = [R e1, R e2, R o + t], so that
        H = M^-1 K^-1; with a distorted lens K^-1 is the homography through the true rays of four pixels.
        """
        u, v = window.width / 2, window.height / 2
        local = np.array([[-u, -v], [u, -v], [u, v], [-u, v]]) * LENS_PATCH + np.array([u, v])
        rays = self._projection.undistort(local + np.array([window.x0, window.y0]))
        cam_from_plane = rotation @ self.axes
        origin = rotation @ self.origin + position
        matrix = np.column_stack([cam_from_plane[:, 0], cam_from_plane[:, 1], origin])
        if self._projection.is_distorted:
            ray_from_pixel = np.asarray(
                cv2.getPerspectiveTransform(local.astype(np.float32), rays.astype(np.float32)), dtype=np.float64
            )
        else:
            focal, centre = self._projection.focal, self._projection.centre
            ray_from_pixel = np.array(
                [
                    [1 / focal[0], 0.0, (window.x0 - centre[0]) / focal[0]],
                    [0.0, 1 / focal[1], (window.y0 - centre[1]) / focal[1]],
                    [0.0, 0.0, 1.0],
                ]
            )
        try:
            found: Array = np.linalg.inv(matrix) @ ray_from_pixel
        except np.linalg.LinAlgError:
            return None
        return found

    def _warp(self, window: _Window, plane_from_pixel: Array, rotation: Array, position: Array) -> Image32:
        """The print on the fine grid of the window, from the level whose texels are about a sub-sample wide.

        Source: mip maps, Williams, SIGGRAPH 1983.
        """
        size_px = float(self._projection.focal[0]) * self._texel / max(float(position[2]), NEAR_M)
        wanted = 1.0 / max(size_px * FINE, 1e-6)
        level = int(np.clip(np.floor(np.log2(max(wanted, 1.0))), 0, len(self._levels) - 1))
        texture = self._levels[level]
        side = len(texture)
        scale = side / (2 * self.half)
        texel_from_plane = np.array([[scale, 0, side / 2 - 0.5], [0, -scale, side / 2 - 0.5], [0, 0, 1.0]])
        offset = (1.0 / FINE - 1.0) / 2
        pixel_from_fine = np.array([[1 / FINE, 0, offset], [0, 1 / FINE, offset], [0, 0, 1.0]])
        return np.asarray(
            cv2.warpPerspective(
                texture,
                texel_from_plane @ plane_from_pixel @ pixel_from_fine,
                (window.width * FINE, window.height * FINE),
                flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
                borderMode=cv2.BORDER_CONSTANT,
                borderValue=1.0,
            ),
            dtype=np.float32,
        )


@dataclass(frozen=True, slots=True, eq=False)
class PrintSamples:
    """The model at each pixel that is used, and what the image shows there, `(n,)` each.

    Attributes:
        value: model, 0 black to 1 white.
        dx: its gradient along x [1/px].
        dy: and along y [1/px].
        laplace: its Laplacian [1/px^2].
        u: place in the print, along its x [m].
        v: along its y [m].
        grey: the image [grey].
    """

    value: Array
    dx: Array
    dy: Array
    laplace: Array
    u: Array
    v: Array
    grey: Array


@dataclass(frozen=True, slots=True, eq=False)
class RenderedPrint:
    """The print rendered for one pose on its fine grid."""

    fine: Image32
    window: _Window
    pad: int
    plane_from_pixel: Array
    half: float
    used: float
    blur: float

    def samples(self, pixels: Grey) -> PrintSamples:
        """Model and image where the print is; differences are taken between neighbouring sub-samples."""
        pad, window = self.pad, self.window
        height, width = window.height - 2 * pad, window.width - 2 * pad
        first = FINE * pad + FINE // 2

        def shifted(down: int, right: int) -> Image32:
            r, c = first + down, first + right
            return self.fine[r : r + FINE * height : FINE, c : c + FINE * width : FINE]

        centre, left, right = shifted(0, 0), shifted(0, -1), shifted(0, 1)
        up, down = shifted(-1, 0), shifted(1, 0)
        x, y = np.arange(pad, pad + width, dtype=np.float64), np.arange(pad, pad + height, dtype=np.float64)[:, None]
        m = self.plane_from_pixel
        w = m[2, 0] * x + (m[2, 1] * y + m[2, 2])
        u = (m[0, 0] * x + (m[0, 1] * y + m[0, 2])) / w
        v = (m[1, 0] * x + (m[1, 1] * y + m[1, 2])) / w
        used = (np.abs(u) < self.used) & (np.abs(v) < self.used)
        top, start = window.y0 + pad, window.x0 + pad
        grey = pixels[top : top + height, start : start + width]
        return PrintSamples(
            centre[used].astype(np.float64),
            ((right - left) * (FINE / 2))[used].astype(np.float64),
            ((down - up) * (FINE / 2))[used].astype(np.float64),
            ((left + right + up + down - 4 * centre) * FINE**2)[used].astype(np.float64),
            u[used],
            v[used],
            grey[used].astype(np.float64),
        )
