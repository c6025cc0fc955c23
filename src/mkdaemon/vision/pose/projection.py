"""Projection of points into the image with its derivatives: the one place of the estimator that knows the lens."""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt

from mkdaemon.vision.camera.intrinsics import Intrinsics

Array = npt.NDArray[np.float64]

NEAR_M = 0.02
"""Points closer to the camera plane than this are not projected [m]."""


class Projection:
    """Pinhole camera with Brown-Conrady distortion.

    Source: OpenCV camera model; Brown, Photogrammetric Engineering 37(8), 1971.
    """

    def __init__(self, intrinsics: Intrinsics) -> None:
        self.intrinsics = intrinsics
        self.focal = np.array([intrinsics.fx, intrinsics.fy])
        self.centre = np.array([intrinsics.cx, intrinsics.cy])
        self.is_distorted = bool(np.any(intrinsics.distortion != 0.0))
        self._r2_limit = _monotone_radius2(intrinsics) if self.is_distorted else np.inf

    def project(self, points_cam: Array) -> tuple[Array, npt.NDArray[np.bool_]]:
        """Project `(n, 3)` [m; RDF].

        Returns:
            Pixels `(n, 2)` [px, centres at integers] and whether each point is in front of the camera and inside the
            field where the distortion polynomial holds; pixels of the others mean nothing.
        """
        z = points_cam[:, 2]
        visible = z > NEAR_M
        xy = points_cam[:, :2] / np.where(visible, z, 1.0)[:, None]
        if self.is_distorted:
            visible = visible & ((xy * xy).sum(axis=1) < self._r2_limit)
            xy = self._distort(xy)
        return xy * self.focal + self.centre, visible

    def jacobian(self, points_cam: Array) -> Array:
        """Derivative of the pixel with respect to the point `(n, 2, 3)` [px/m]; points must be in front."""
        iz = 1.0 / points_cam[:, 2]
        x, y = points_cam[:, 0] * iz, points_cam[:, 1] * iz
        normalised = np.zeros((len(points_cam), 2, 3))
        normalised[:, 0, 0] = iz
        normalised[:, 1, 1] = iz
        normalised[:, 0, 2] = -x * iz
        normalised[:, 1, 2] = -y * iz
        if self.is_distorted:
            normalised = self._distort_jacobian(x, y) @ normalised
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
        if not self.is_distorted:
            directions: Array = (pixels - self.centre) / self.focal
            return directions
        criteria = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 40, 1e-9)
        found = cv2.undistortPointsIter(
            np.ascontiguousarray(pixels, dtype=np.float64).reshape(-1, 1, 2),
            self.intrinsics.matrix,
            self.intrinsics.distortion,
            np.eye(3),
            np.eye(3),
            criteria,
        )
        return np.asarray(found, dtype=np.float64).reshape(-1, 2)

    def _distort(self, xy: Array) -> Array:
        i = self.intrinsics
        x, y = xy[:, 0], xy[:, 1]
        r2 = x * x + y * y
        radial = 1.0 + r2 * (i.k1 + r2 * (i.k2 + r2 * i.k3))
        return np.column_stack(
            [
                x * radial + 2 * i.p1 * x * y + i.p2 * (r2 + 2 * x * x),
                y * radial + i.p1 * (r2 + 2 * y * y) + 2 * i.p2 * x * y,
            ]
        )

    def _distort_jacobian(self, x: Array, y: Array) -> Array:
        i = self.intrinsics
        r2 = x * x + y * y
        radial = 1.0 + r2 * (i.k1 + r2 * (i.k2 + r2 * i.k3))
        slope = 2 * (i.k1 + r2 * (2 * i.k2 + 3 * i.k3 * r2))
        out = np.empty((len(x), 2, 2))
        out[:, 0, 0] = radial + x * x * slope + 2 * i.p1 * y + 6 * i.p2 * x
        out[:, 0, 1] = x * y * slope + 2 * i.p1 * x + 2 * i.p2 * y
        out[:, 1, 0] = out[:, 0, 1]
        out[:, 1, 1] = radial + y * y * slope + 6 * i.p1 * y + 2 * i.p2 * x
        return out


def _monotone_radius2(intrinsics: Intrinsics) -> float:
    """Squared radius up to which the radial polynomial grows; beyond it points would fold back into the image."""
    r = np.linspace(0.0, 4.0, 400)
    r2 = r * r
    image_radius = r * (1 + r2 * (intrinsics.k1 + r2 * (intrinsics.k2 + r2 * intrinsics.k3)))
    falling = np.flatnonzero(np.diff(image_radius) <= 0)
    return float(r2[falling[0]]) if falling.size else np.inf
