"""Pose refinement on every pixel of a small tag.

Below four pixels a cell edges melt into each other and a located edge means little. Here the known print is rendered
through pose, pixel area and point spread, and pose, light (gain, offset, plane) and blur are fitted to the grey values
at once. The model lives in the image, so perspective and the round point spread are right at any tilt.

Source: direct alignment, Lucas and Kanade, IJCAI 1981; Gauss-Newton with Levenberg damping.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np
import numpy.typing as npt

from mkdaemon.vision.pose.pose import Pose, correlation, median, turn
from mkdaemon.vision.pose.projection import NEAR_M, Projection
from mkdaemon.vision.tags.tagmap import Target

Array = npt.NDArray[np.float64]
Image32 = npt.NDArray[np.float32]
Grey = npt.NDArray[np.uint8]

FINE = 3
"""Sub-samples a pixel, each way; odd, so that one of them is its centre."""
TEXELS_PER_CELL = 12
MAX_WINDOW_PX = 160
START_BLUR_PX = 0.7
VARIANCE_FACTOR = 1.3
"""Interpolated grey values and an imperfect model make the plain covariance optimistic; NEES of development images."""
QUIET_GREY, LOST_GREY = 2.0, 60.0
"""Residuals are told apart between these bounds when rival poses are compared [grey]."""
MARGIN_CELLS = 0.3
"""Outermost part of the quiet zone that is left out: what lies beyond it blurs in."""
POLISH_BELOW_PX = 10.0
"""Larger cells have edges enough, and pixels that cost time [px]."""
POLISH_INLIERS = 0.9
"""Share of edges, and of pixels, that agree where nothing lies over the target."""
POLISH_MATCH = 0.95
"""Correlation of model and image where the model holds."""
SAME_MAHALANOBIS2 = 22.5
"""Two fits of one image farther apart than this contradict each other: chi-square of six, one in a thousand."""


@dataclass(frozen=True, slots=True, eq=False)
class _Window:
    """Pixels of one fit: their rays at unit depth and position in the image."""

    x0: int
    y0: int
    width: int
    height: int


class PhotoFit:
    """Fits the pose of one target to grey values; uses the tags in the plane of the largest one."""

    def __init__(self, target: Target, projection: Projection) -> None:
        self._projection = projection
        first = target.tags[0]
        self._origin, self._axes = first.position, first.rotation
        tags = [
            tag
            for tag in target.tags
            if float(tag.rotation[:, 2] @ first.rotation[:, 2]) > 1 - 1e-9
            and abs(float(first.rotation[:, 2] @ (tag.position - first.position))) < first.module
        ]
        # One quiet zone around the largest tag is surely white; other tags count where they lie inside it.
        self._half = first.paper / 2
        self._cell = first.module
        side = (first.family.black_cells + 2) * TEXELS_PER_CELL
        self._texel = first.paper / side
        grid = (np.arange(side) + 0.5) * self._texel - self._half
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
        while len(self._levels[-1]) >= 24:
            size = len(self._levels[-1]) // 2
            self._levels.append(
                np.asarray(cv2.resize(texture, (size, size), interpolation=cv2.INTER_AREA), dtype=np.float32)
            )

    def fit(self, pixels: Grey, start: Pose, iterations: int = 8) -> Pose | None:
        """Refine a pose.

        Args:
            pixels: `(h, w)` uint8.
            start: within about a cell of the truth.
            iterations: steps at most; converged fits stop earlier.

        Returns:
            The pose, `rms_px` being the residual over the contrast; none when the print is not in full view, too large
            for this method, or does not resemble the image.
        """
        rotation, position = start.rotation, start.position
        blur, damping, last = START_BLUR_PX, 1e-3, np.inf
        best: tuple[Array, Array, float] | None = None
        fitted: Pose | None = None
        for _ in range(iterations):
            model = self._render(pixels.shape, rotation, position, blur)
            if model is None:
                return None
            step, cost, pose, blur_step = self._step(pixels, model, rotation, position, damping)
            if cost < last:
                settled = last - cost < 3e-4 * cost
                best, last, fitted = (rotation, position, blur), cost, pose
                if settled:
                    break
                damping = max(damping * 0.3, 1e-7)
            else:
                if best is None or damping > 1e-2 or cost < last * 1.001:
                    break
                rotation, position, blur = best
                damping *= 30.0
                model = self._render(pixels.shape, rotation, position, blur)
                if model is None:
                    return None
                step, _, _, blur_step = self._step(pixels, model, rotation, position, damping)
            small = float(np.abs(step[3:]).max()) < 5e-5 and float(np.linalg.norm(step[:3])) < 2e-5 * position[2]
            if small and abs(blur_step) < 0.01:
                break
            rotation, position = turn(rotation, step[3:]), position + step[:3]
            blur = float(np.clip(blur * np.exp(np.clip(blur_step, -0.3, 0.3)), 0.35, 5.0))
            if not np.isfinite(position).all() or position[2] < NEAR_M:
                return None
            if np.linalg.norm(position - start.position) > 0.2 * start.range_m:
                return None
        return fitted

    def polish(self, pixels: Grey, pose: Pose) -> Pose:
        """Measure a pose from edges once more by the grey values, where these know more and do not object.

        Cells of five to ten pixels have sharp edges and still few of them: the pixels between tell as much again. The
        edges stay the evidence that gates and rivals are judged by; only place and covariance are taken over.

        Args:
            pixels: `(h, w)` uint8.
            pose: fitted to edges, whole target in view.

        Returns:
            The better pose, or `pose` itself.
        """
        cell_px = float(self._projection.focal[0]) * self._cell / max(float(pose.position[2]), NEAR_M)
        if pose.source != "edges" or cell_px > POLISH_BELOW_PX or pose.inliers < POLISH_INLIERS:
            return pose
        grey = self.fit(pixels, pose)
        if grey is None or grey.match is None or grey.match < POLISH_MATCH or grey.inliers < POLISH_INLIERS:
            return pose
        if float(np.linalg.det(grey.covariance)) >= float(np.linalg.det(pose.covariance)):
            return pose
        turned = np.asarray(cv2.Rodrigues(grey.rotation @ pose.rotation.T)[0], dtype=np.float64).ravel()
        apart = np.concatenate([grey.position - pose.position, turned])
        if float(apart @ np.linalg.solve(pose.covariance, apart)) > SAME_MAHALANOBIS2:
            return pose
        return replace(pose, rotation=grey.rotation, position=grey.position, covariance=grey.covariance)

    def _render(self, shape: tuple[int, ...], rotation: Array, position: Array, blur: float) -> _Model | None:
        """What the print looks like from a pose, with derivatives."""
        half = self._half - MARGIN_CELLS * self._cell
        corners = np.array([[-half, half], [half, half], [half, -half], [-half, -half]])
        seen = (corners @ self._axes[:, :2].T + self._origin) @ rotation.T + position
        uv, visible = self._projection.project(seen)
        if not bool(visible.all()):
            return None
        pad = int(np.ceil(3 * blur)) + 2
        x0, y0 = np.maximum(np.floor(uv.min(axis=0)).astype(int), pad)
        x1, y1 = np.minimum(np.ceil(uv.max(axis=0)).astype(int) + 1, [shape[1] - pad, shape[0] - pad])
        width, height = int(x1 - x0), int(y1 - y0)
        if not (6 <= width <= MAX_WINDOW_PX and 6 <= height <= MAX_WINDOW_PX):
            return None
        window = _Window(int(x0) - pad, int(y0) - pad, width + 2 * pad, height + 2 * pad)
        plane_from_pixel = self._plane_from_pixel(window, rotation, position)
        if plane_from_pixel is None:
            return None
        fine = self._warp(window, plane_from_pixel, rotation, position)
        fine = np.asarray(cv2.GaussianBlur(fine, (0, 0), blur * FINE), dtype=np.float32)
        fine = np.asarray(cv2.blur(fine, (FINE, FINE)), dtype=np.float32)
        return _Model(fine, window, pad, plane_from_pixel, self._half, half, blur)

    def _plane_from_pixel(self, window: _Window, rotation: Array, position: Array) -> Array | None:
        """Homography from window pixels to the print plane; the lens is taken as locally affine."""
        u, v = window.width / 2, window.height / 2
        local = np.array([[-u, -v], [u, -v], [u, v], [-u, v]]) * 0.7 + np.array([u, v])
        rays = self._projection.undistort(local + np.array([window.x0, window.y0]))
        cam_from_plane = rotation @ self._axes
        origin = rotation @ self._origin + position
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
        """The print on the fine grid of the window, from the level whose texels are about a sub-sample wide."""
        size_px = float(self._projection.focal[0]) * self._texel / max(float(position[2]), NEAR_M)
        wanted = 1.0 / max(size_px * FINE, 1e-6)
        level = int(np.clip(np.floor(np.log2(max(wanted, 1.0))), 0, len(self._levels) - 1))
        texture = self._levels[level]
        side = len(texture)
        scale = side / (2 * self._half)
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

    def _step(
        self, pixels: Grey, model: _Model, rotation: Array, position: Array, damping: float
    ) -> tuple[Array, float, Pose, float]:
        """One Gauss-Newton step: pose step `(6,)`, robust cost, the pose it was taken at, step of log blur."""
        value, dx, dy, laplace, u, v, image = model.samples(pixels)
        arm = np.column_stack([u, v]) @ (rotation @ self._axes[:, :2]).T + rotation @ self._origin
        point = self._projection.jacobian(arm + position)
        light = np.stack([value, np.ones_like(value), u / self._half, v / self._half])
        gain: Array = np.asarray(np.linalg.solve(light @ light.T + 1e-6 * np.eye(4), light @ image), dtype=np.float64)
        lit: Array = np.asarray(gain @ light, dtype=np.float64)
        residual = image - lit
        size = np.abs(residual)
        spread = max(1.4826 * median(size), 1.0)
        np.maximum(size, 1e-6, out=size)
        weights = np.where(size < 4 * spread, 1.0, (4 * spread / size) ** 2)
        cost = float(np.mean(np.minimum(size, 5 * spread) ** 2))
        # A print that moves by d shows at a pixel what was d before it: minus the gradient.
        jacobian = np.empty((11, len(value)))
        slope = (dx * -gain[0])[:, None] * point[:, 0] + (dy * -gain[0])[:, None] * point[:, 1]
        jacobian[:3] = slope.T
        jacobian[3] = arm[:, 1] * slope[:, 2] - arm[:, 2] * slope[:, 1]
        jacobian[4] = arm[:, 2] * slope[:, 0] - arm[:, 0] * slope[:, 2]
        jacobian[5] = arm[:, 0] * slope[:, 1] - arm[:, 1] * slope[:, 0]
        jacobian[6:10] = light
        jacobian[10] = laplace * (gain[0] * model.blur**2)
        unit = np.concatenate([np.full(3, position[2]), np.ones(3), np.full(4, 100.0), [1.0]])
        jacobian *= unit[:, None]
        weighted = jacobian * weights
        normal = weighted @ jacobian.T
        ridge = damping * np.diag(np.diag(normal)) + 1e-9 * np.eye(len(unit))
        solved = np.linalg.solve(normal + ridge, weighted @ residual) * unit
        inverse = np.linalg.inv(normal + 1e-9 * np.eye(len(unit)))[:6, :6] * np.outer(unit[:6], unit[:6])
        noise = float((weights * residual**2).sum() / max(weights.sum() - 11.0, 1.0))
        steepness = float(np.sqrt(np.mean(dx**2 + dy**2))) * abs(float(gain[0]))
        pose = Pose(
            rotation,
            position,
            VARIANCE_FACTOR * max(noise, 0.3) * (inverse + inverse.T) / 2,
            "photometric",
            int((weights > 0.5).sum()),
            float(np.sqrt(cost)) / max(steepness, 1e-3) if gain[0] > 0 else np.inf,
            float((weights > 0.5).mean()),
            float(np.linalg.norm(solved[:3])) / max(float(np.linalg.norm(position)), 1e-9),
            float(np.exp(np.mean(np.log(np.minimum(size, LOST_GREY) ** 2 + QUIET_GREY**2)))),
            correlation(image, lit) if gain[0] > 0 else -1.0,
            model.blur,
        )
        return solved[:6], cost, pose, float(solved[10])


@dataclass(frozen=True, slots=True, eq=False)
class _Model:
    """The rendered print of one pose on its fine grid."""

    fine: Image32
    window: _Window
    pad: int
    plane_from_pixel: Array
    half: float
    used: float
    blur: float

    def samples(self, pixels: Grey) -> tuple[Array, Array, Array, Array, Array, Array, Array]:
        """Model, x and y gradient [1/px], Laplacian [1/px^2], plane coordinates [m] and grey of each used pixel."""
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
        return (
            centre[used].astype(np.float64),
            ((right - left) * (FINE / 2))[used].astype(np.float64),
            ((down - up) * (FINE / 2))[used].astype(np.float64),
            ((left + right + up + down - 4 * centre) * FINE**2)[used].astype(np.float64),
            u[used],
            v[used],
            grey[used].astype(np.float64),
        )
