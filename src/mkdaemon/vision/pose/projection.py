"""Projection of points into the image with its derivatives: the one place of the estimator that knows the lens."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from mkdaemon.vision.camera.intrinsics import Intrinsics
from mkdaemon.vision.pose.lens import lens_of

Array = npt.NDArray[np.float64]

NEAR_M = 0.02
"""Points closer to the camera plane than this are not projected [m]."""


class Projection:
    """A camera: its lens (`lens.py`), then focal lengths and principal point. Source: OpenCV camera model."""

    def __init__(self, intrinsics: Intrinsics) -> None:
        self.intrinsics = intrinsics
        self.focal = np.array([intrinsics.fx, intrinsics.fy])
        self.centre = np.array([intrinsics.cx, intrinsics.cy])
        self.is_distorted = intrinsics.model == "fisheye" or bool(np.any(intrinsics.distortion != 0.0))
        self._lens = lens_of(intrinsics)
        self._r2_limit = self._lens.r2_limit if self.is_distorted else np.inf

    def project(self, points_cam: Array) -> tuple[Array, npt.NDArray[np.bool_]]:
        """Project `(n, 3)` [m; RDF].

        Returns:
            Pixels `(n, 2)` [px, centres at integers] and whether each point is in front of the camera and inside the
            field where the lens's polynomial holds; pixels of the others mean nothing.
        """
        z = points_cam[:, 2]
        visible = z > NEAR_M
        xy = points_cam[:, :2] / np.where(visible, z, 1.0)[:, None]
        if self.is_distorted:
            visible = visible & ((xy * xy).sum(axis=1) < self._r2_limit)
            xy = self._lens.bend(xy)
        return xy * self.focal + self.centre, visible

    def jacobian(self, points_cam: Array) -> Array:
        """Derivative of the pixel with respect to the point `(n, 2, 3)` [px/m]; points must be in front."""
        iz = 1.0 / points_cam[:, 2]
        x, y = points_cam[:, 0] * iz, points_cam[:, 1] * iz
        normalised = np.zeros((2, 3, len(points_cam))).transpose(2, 0, 1)
        normalised[:, 0, 0] = iz
        normalised[:, 1, 1] = iz
        normalised[:, 0, 2] = -x * iz
        normalised[:, 1, 2] = -y * iz
        if self.is_distorted:
            normalised = self._lens.slope(np.column_stack([x, y])) @ normalised
        scaled: Array = normalised * self.focal[:, None]
        return scaled

    def pose_jacobian(self, points_cam: Array, position: Array) -> Array:
        """Derivative of the pixel with respect to a pose `(n, 2, 6)`: position [px/m], then rotation [px/rad].

        The rotation is a left perturbation about the target's origin, `R <- exp(w) R`, camera axes.
        """
        point = self.jacobian(points_cam)
        arm = points_cam - position
        jacobian = np.empty((len(points_cam), 2, 6))
        jacobian[:, :, :3] = point
        # d(exp(w) arm)/dw = -[arm]x, so each row is arm x row; written out, numpy's cross is slow.
        ax, ay, az = arm[:, 0, None], arm[:, 1, None], arm[:, 2, None]
        px, py, pz = point[:, :, 0], point[:, :, 1], point[:, :, 2]
        jacobian[:, :, 3] = ay * pz - az * py
        jacobian[:, :, 4] = az * px - ax * pz
        jacobian[:, :, 5] = ax * py - ay * px
        return jacobian

    def stretch(self, stretch: float) -> Projection:
        """The same lens with another ratio of the focal lengths, their product kept; `stretch` is its logarithm."""
        i = self.intrinsics
        wide = float(np.exp(stretch / 2))
        return Projection(i.model_copy(update={"fx": i.fx * wide, "fy": i.fy / wide}))

    def stretch_jacobian(self, pixels: Array) -> Array:
        """Derivative of pixels `(n, 2)` with respect to `stretch` `(n, 2)` [px]."""
        moved: Array = (pixels - self.centre) * np.array([0.5, -0.5])
        return moved

    def undistort(self, pixels: Array) -> Array:
        """Turn pixels `(n, 2)` into directions `(n, 2)` at unit depth."""
        bent: Array = (pixels - self.centre) / self.focal
        return self._lens.straighten(bent) if self.is_distorted else bent

    def k1_jacobian(self, points_cam: Array) -> Array:
        """Derivative of the pixel with respect to the first distortion coefficient `(n, 2)` [px]."""
        found: Array = self._lens.by_k1(points_cam[:, :2] / points_cam[:, 2:]) * self.focal
        return found
