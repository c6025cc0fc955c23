"""What a known print looks like in the image from a pose: its texture warped, blurred, and averaged over pixels.

The model lives in the image, so perspective and the round point spread are right at any tilt.

The texture of a print, soft enough for the sub-samples it is looked up at.

A sharp edge that is looked up at points lies where the nearest point is: an edge along a row of pixels was drawn up to
0.08 px beside its place, the whole of it alike. A blur that belongs to the point spread anyway takes that away.

Source: mip maps, Williams, SIGGRAPH 1983; a Gaussian in place of the box.
"""

from __future__ import annotations

from typing import Final

import cv2
import numpy as np
import numpy.typing as npt

from mkdaemon.vision.limits import LIMITS
from mkdaemon.vision.pose.bend import Sheet
from mkdaemon.vision.pose.pointspread import PointSpread
from mkdaemon.vision.pose.printimage import FINE, RenderedPrint, Window
from mkdaemon.vision.pose.projection import NEAR_M, Projection
from mkdaemon.vision.pose.rolling import exposed, skew
from mkdaemon.vision.tags.tagmap import ONE_PLANE, Tag, Target

Array = npt.NDArray[np.float64]
Image32 = npt.NDArray[np.float32]
Grey = npt.NDArray[np.uint8]

SOFT: Final = 0.5
"""Deviation of the blur [sub-samples]: 1 % is left of what repeats from one to the next."""
LEVELS_PER_OCTAVE: Final = 2
SMALLEST: Final = 24
"""Texels across the coarsest level."""


class PrintTexture:
    """A drawn print and its softer levels, each made when it is first asked for.

    Args:
        drawn: `(side, side)`, 0 black to 1 white.
    """

    def __init__(self, drawn: Image32) -> None:
        self._drawn = drawn
        self._levels: dict[int, Image32] = {}
        self._softest = LEVELS_PER_OCTAVE * int(np.log2(max(len(drawn) // SMALLEST, 1)))

    def level(self, step: float) -> tuple[Image32, float]:
        """The level for sub-samples some texels of the drawn print apart, and its blur [texels of the drawn print].

        Levels have at least two texels from one sub-sample to the next, as far as the drawn print has.

        Args:
            step: between neighbouring sub-samples, along the way in which it is longer [texels].
        """
        number = round(LEVELS_PER_OCTAVE * float(np.log2(max(step, 1e-6))))
        if number < 0:
            return self._drawn, 0.0
        number = min(number, self._softest)
        blur = SOFT * 2.0 ** (number / LEVELS_PER_OCTAVE)
        found = self._levels.get(number)
        if found is None:
            soft = cv2.GaussianBlur(self._drawn, (0, 0), blur, borderType=cv2.BORDER_REPLICATE)
            side = len(soft) // max(2 ** (number // LEVELS_PER_OCTAVE - 1), 1)
            found = np.asarray(cv2.resize(soft, (side, side), interpolation=cv2.INTER_AREA), dtype=np.float32)
            self._levels[number] = found
        return found, blur


TEXELS_PER_CELL = 24
TEXEL_PARTS = 8
"""Sub-samples of a texel, each way, where cells of a smaller tag end within it."""
SLANTED = 0.5
"""Cosine of the slant from which a texture gets no softer: it would be longer the other way than a point spread."""
LENS_PATCH = 0.7
"""Share of the window at whose corners the lens is taken: the error of an affine lens is least in the middle."""


SQUARE = np.array([[-1.0, 1.0], [1.0, 1.0], [1.0, -1.0], [-1.0, -1.0]])
"""Corners of a print, in halves of its side."""


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
        tags = [
            tag
            for tag in target.tags
            if float(tag.rotation[:, 2] @ first.rotation[:, 2]) > ONE_PLANE
            and abs(float(first.rotation[:, 2] @ (tag.position - first.position))) < first.module
        ]
        # One quiet zone around the tag is surely white; other tags count where they lie inside it.
        self.half = first.paper / 2
        self.cell = first.module
        side = (first.family.black_cells + 2) * TEXELS_PER_CELL
        self._texel = first.paper / side
        texture = np.ones((side, side), dtype=np.float32)
        for tag in tags:
            self._draw(texture, tag, first)
        self._texture = PrintTexture(texture)

    def _draw(self, texture: Image32, tag: Tag, first: Tag) -> None:
        """Draw a tag with its quiet zone over the texture of the print; a texel that several cells share is their mean.

        The cells of the first tag are whole texels. Those of the inner tag of `nested.toml` are 1.9 texels wide: drawn
        by the middles of texels it had 26 % too little white, which shows in every image from afar.
        """
        parts = 1 if tag is first else TEXEL_PARTS
        turned = (first.rotation.T @ tag.rotation)[:2, :2]
        place = ((tag.position - first.position) @ first.rotation)[:2]
        middle = self.half + place * (1.0, -1.0)
        reach = np.abs(turned).sum(axis=1) * (tag.paper / 2)
        left, top = np.clip(np.floor((middle - reach) / self._texel).astype(int), 0, len(texture))
        right, bottom = np.clip(np.ceil((middle + reach) / self._texel).astype(int), 0, len(texture))
        if right <= left or bottom <= top:
            return
        step = self._texel / parts
        x, y = np.meshgrid(
            (np.arange(left * parts, right * parts) + 0.5) * step - self.half,
            self.half - (np.arange(top * parts, bottom * parts) + 0.5) * step,
        )
        local = (np.stack([x, y], axis=-1) - place) @ turned
        cells = np.pad(tag.bitmap, 1, constant_values=255)
        n = len(cells)
        column = np.floor(local[..., 0] / tag.module + n / 2).astype(int)
        row = np.floor(n / 2 - local[..., 1] / tag.module).astype(int)
        inside = (row >= 0) & (row < n) & (column >= 0) & (column < n)
        part = texture[top:bottom, left:right]
        fine = part.repeat(parts, axis=0).repeat(parts, axis=1)
        fine[inside] = cells[row[inside], column[inside]] / np.float32(255)
        part[...] = fine.reshape(bottom - top, parts, right - left, parts).mean(axis=(1, 3))

    def render(
        self, shape: tuple[int, ...], rotation: Array, position: Array, spread: Array, motion: Array | None = None
    ) -> RenderedPrint | None:
        """What the print looks like from a pose; none where it is not in full view, too small or too large.

        Args:
            shape: of the image.
            rotation: camera from target `(3, 3)`.
            position: of the target `(3,)` [m; RDF].
            spread: covariance of the point spread `(2, 2)` [px^2]; what is longer one way is motion blur.
            motion: of the camera under a rolling shutter `(4,)`; see `rolling`.
        """
        half = self.half - LIMITS.photo.margin_cells * self.cell
        corners = self._in_camera(SQUARE * half, rotation, position)
        if motion is not None:
            corners, _ = exposed(corners, motion, self._projection)
        uv, visible = self._projection.project(corners)
        if not bool(visible.all()):
            return None
        point_spread = PointSpread.of(spread)
        pad = point_spread.pad
        x0, y0 = np.maximum(np.floor(uv.min(axis=0)).astype(int), pad)
        x1, y1 = np.minimum(np.ceil(uv.max(axis=0)).astype(int) + 1, [shape[1] - pad, shape[0] - pad])
        width, height = int(x1 - x0), int(y1 - y0)
        low, high = LIMITS.photo.min_window_px, LIMITS.photo.max_window_px
        if not (low <= width <= high and low <= height <= high):
            return None
        window = Window(int(x0) - pad, int(y0) - pad, width + 2 * pad, height + 2 * pad)
        plane_from_pixel = self._plane_from_pixel(window, rotation, position)
        if plane_from_pixel is None:
            return None
        texture, soft_px = self._soft_texture(rotation, position)
        fine = self._warp(texture, window, plane_from_pixel, rotation, position, motion)
        if motion is not None:
            plane_from_pixel = self._rolled(plane_from_pixel, window, rotation, position, motion)
        fine = point_spread.blurred(fine, soft_px)
        return RenderedPrint(fine, window, pad, plane_from_pixel, self.half, half)

    def _in_camera(self, plane: Array, rotation: Array, position: Array) -> Array:
        """Points `(n, 2)` of the print [m] in camera axes `(n, 3)` [m]."""
        placed: Array = (plane @ self.axes[:, :2].T + self.origin) @ rotation.T + position
        return placed

    def _rolled(
        self, plane_from_pixel: Array, window: Window, rotation: Array, position: Array, motion: Array
    ) -> Array:
        """About the homography under a rolling shutter, through four points of the print where their rows show them.

        It tells where on the print a pixel is; a camera that turns about its axis bends the print's lines beside it.
        """
        plane = SQUARE * self.half * LENS_PATCH
        seen, _ = exposed(self._in_camera(plane, rotation, position), motion, self._projection)
        pixels = self._projection.project(seen)[0] - (window.x0, window.y0)
        at_rest = np.column_stack([plane, np.ones(4)]) @ np.linalg.inv(plane_from_pixel).T
        before = at_rest[:, :2] / at_rest[:, 2:]
        moved = cv2.getPerspectiveTransform(pixels.astype(np.float32), before.astype(np.float32))
        rolled: Array = plane_from_pixel @ np.asarray(moved, dtype=np.float64)
        return rolled

    def _plane_from_pixel(self, window: Window, rotation: Array, position: Array) -> Array | None:
        """Homography from window pixels to the print plane; the lens is taken as locally affine.

        A point (u, v, 1) of the print is seen along M (u, v, 1) with M = [R e1, R e2, R o + t], so that
        H = M^-1 K^-1; with a distorted lens K^-1 is the homography through the true rays of four pixels.
        """
        u, v = window.width / 2, window.height / 2
        local = np.array([[-u, -v], [u, -v], [u, v], [-u, v]]) * LENS_PATCH + np.array([u, v])
        rays = self._projection.undistort(local + np.array([window.x0, window.y0]))
        matrix = self._cam_from_plane(rotation, position)
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

    def _warp(
        self,
        texture: Image32,
        window: Window,
        plane_from_pixel: Array,
        rotation: Array,
        position: Array,
        motion: Array | None,
    ) -> Image32:
        """The print on the fine grid of the window.

        Under a rolling shutter a row is exposed at one time t and has its own homography: a point M q of the print is
        then at A q with A = (I - t [w]) M + t s e (0 0 1), see `rolling`, so that q = A^-1 M H p for a pixel p and the
        homography H at rest.
        """
        side = len(texture)
        scale = side / (2 * self.half)
        texel_from_plane = np.array([[scale, 0, side / 2 - 0.5], [0, -scale, side / 2 - 0.5], [0, 0, 1.0]])
        column = (np.arange(window.width * FINE, dtype=np.float32) + 0.5) / FINE - 0.5
        row = (np.arange(window.height * FINE) + 0.5) / FINE - 0.5
        by_row = (texel_from_plane @ plane_from_pixel)[None]
        if motion is not None:
            intrinsics = self._projection.intrinsics
            shown = np.clip(row + window.y0, 0.0, intrinsics.height - 1.0)
            times = (shown - (intrinsics.height - 1) / 2) * self._projection.line_time
            at_rest = self._cam_from_plane(rotation, position)
            exposed_at = at_rest - times[:, None, None] * (skew(motion[:3]) @ at_rest)
            exposed_at[:, 2, 2] += times * motion[3]
            by_row = texel_from_plane @ np.linalg.solve(exposed_at, at_rest @ plane_from_pixel)
        right = by_row[:, :, 0].astype(np.float32)[:, :, None]
        start = (by_row[:, :, 1] * row[:, None] + by_row[:, :, 2]).astype(np.float32)[:, :, None]
        x, y, w = np.moveaxis(right * column + start, 1, 0)
        return np.asarray(
            cv2.remap(texture, x / w, y / w, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=1.0),
            dtype=np.float32,
        )

    def _cam_from_plane(self, rotation: Array, position: Array) -> Array:
        """The matrix M: a point (u, v, 1) of the print is at M (u, v, 1) in the camera [m]."""
        cam_from_plane = rotation @ self.axes
        return np.column_stack([cam_from_plane[:, 0], cam_from_plane[:, 1], rotation @ self.origin + position])

    def depth(self, rotation: Array, position: Array) -> float:
        """How far the middle of the print is along the optical axis [m]."""
        return float((rotation @ self.origin + position)[2])

    def _soft_texture(self, rotation: Array, position: Array) -> tuple[Image32, float]:
        """The texture for the sub-samples of a pose, and the deviation of the blur that is in it [px].

        It is one in the print: seen at a slant it is shorter one way; the blur is that of the mean variance.
        """
        place = rotation @ self.origin + position
        texel_px = float(self._projection.focal[0]) * self._texel / max(float(place[2]), NEAR_M)
        facing = abs(float(rotation @ self.axes[:, 2] @ place)) / max(float(np.linalg.norm(place)), NEAR_M)
        facing = max(facing, SLANTED)
        texture, blur = self._texture.level(1.0 / max(texel_px * facing * FINE, 1e-6))
        return texture, blur * texel_px * float(np.sqrt(facing))
