"""Projection of points into the image with its derivatives: the one place of the estimator that knows the lens."""

from __future__ import annotations

from typing import Final

import cv2
import numpy as np

from mkdaemon.vision.arrays import Array, Bools
from mkdaemon.vision.camera.calibration_file import Intrinsics
from mkdaemon.vision.pose.rolling import Shutter, skew

WIDEST: Final = 1.5
"""Angle from the axis up to which a fisheye is inverted [rad]; at a right angle there is no point at unit depth."""
FARTHEST: Final = 4.0
"""Radius at unit depth up to which a pinhole is looked at."""
AXIS: Final = 1e-8
"""Radius below which a point is on the axis."""
NEWTON: Final = 20
"""Steps at most to invert a fisheye; four do."""
ROUNDS: Final = 2
"""A point's row says when it is exposed, and that where it is: number of iterations."""
NEAR_M: Final = 0.02
"""Points closer to the camera plane than this are not projected [m]."""


class Lens:
    """Projection of a lens: directions d = (x, y) at unit depth go to d R(t) / r + 2 (p . d) d + r^2 p, with r = |d|.

    R(t) = t (1 + k1 t^2 + k2 t^4 + k3 t^6 + k4 t^8) is the radius in the image of t, which is r for a pinhole and the
    angle from the axis, atan r, for a fisheye; p = (p2, p1) is zero there. Sources: Brown, Photogrammetric Engineering
    37(8), 1971; Kannala and Brandt, PAMI 28(8), 2006; both as in OpenCV.

    Attributes:
        r2_limit: squared radius of directions up to which the image grows; beyond, points would fold back into it.
    """

    def __init__(self, intrinsics: Intrinsics) -> None:
        self._k, self._is_fisheye = intrinsics, intrinsics.model == "fisheye"
        self._tangential = np.array([intrinsics.p2, intrinsics.p1])
        t = np.linspace(0.0, WIDEST if self._is_fisheye else FARTHEST, 400)
        falling = t[:-1][np.diff(self._radius(t)[0]) <= 0.0]
        r = np.tan(falling) if self._is_fisheye else falling
        self.r2_limit = float(r[0] ** 2) if r.size else np.inf

    def bend(self, d: Array) -> Array:
        """Normalised image points `(2, n)` of directions `(2, n)`."""
        r, t = self._off_axis(d)
        bent: Array = d * (self._radius(t)[0] / r + 2.0 * self._tangential @ d) + r * r * self._tangential[:, None]
        return bent

    def slope(self, d: Array) -> Array:
        """Derivative of `bend` `(2, 2, n)`."""
        r, t = self._off_axis(d)
        radius, growth = self._radius(t)
        # R / r grows by (R' dt/dr - R / r) / r along d, with dt/dr = 1 or 1 / (1 + r^2).
        along = ((growth / (1.0 + r * r) if self._is_fisheye else growth) - radius / r) / (r * r)
        twice = 2.0 * self._tangential
        slope: Array = d[:, None] * (along * d + twice[:, None]) + twice[:, None, None] * d
        slope[[0, 1], [0, 1]] += radius / r + twice @ d
        return slope

    def by_k1(self, d: Array) -> Array:
        """Derivative of `bend` by `k1` `(2, n)`."""
        r, t = self._off_axis(d)
        return np.asarray(d * (t**3 / r))

    def straighten(self, bent: Array) -> Array:
        """Directions `(n, 2)` of normalised image points `(n, 2)`; outside the field of a fisheye those of its rim."""
        if not self._is_fisheye:
            criteria = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 40, 1e-9)
            points = np.ascontiguousarray(bent, dtype=np.float64)[:, None]
            found = cv2.undistortPointsIter(points, np.eye(3), self._k.distortion, np.eye(3), np.eye(3), criteria)
            return np.asarray(found, dtype=np.float64).reshape(-1, 2)
        radius = np.linalg.norm(bent, axis=1)
        angle = np.minimum(radius, WIDEST)
        for _ in range(NEWTON):
            at, growth = self._radius(angle)
            angle = np.clip(angle - (at - radius) / growth, 0.0, WIDEST)
        return np.asarray(bent * (np.tan(angle) / np.maximum(radius, AXIS))[:, None])

    def _off_axis(self, d: Array) -> tuple[Array, Array]:
        """Radii r and t of directions `(2, n)`, `(n,)` each."""
        r = np.maximum(np.sqrt((d * d).sum(axis=0)), AXIS)
        return r, np.arctan(r) if self._is_fisheye else r

    def _radius(self, t: Array) -> tuple[Array, Array]:
        """Radius R in the image `(n,)`, and its derivative by t."""
        # R = t (1 + k1 t^2 + k2 t^4 + k3 t^6 + k4 t^8), with t = r (perspective) or t = atan r, the angle (fisheye).
        # Source: OpenCV, calib3d, "Camera calibration" and "Fisheye camera model".
        k, t2 = self._k, t * t
        radius = t * (1.0 + t2 * (k.k1 + t2 * (k.k2 + t2 * (k.k3 + t2 * k.k4))))
        return radius, 1.0 + t2 * (3 * k.k1 + t2 * (5 * k.k2 + t2 * (7 * k.k3 + t2 * 9 * k.k4)))


class Projection:
    """A camera: its lens, then focal lengths and principal point. Source: OpenCV camera model.

    Args:
        intrinsics: its calibration.
        shutter: that learns; what the calibration says where absent, a global one where that says nothing: stills.
        rows: rows of the sensor that make up one of the image.
        aspect_sd: deviation of the ratio of its focal lengths, as a share.

    Attributes:
        intrinsics: its calibration.
        focal: focal lengths `(2,)` [px].
        centre: principal point `(2,)` [px].
        is_distorted: whether the lens bends directions.
        shutter: what is known of its line time.
        aspect_sd: see above.
    """

    def __init__(
        self, intrinsics: Intrinsics, shutter: Shutter | None = None, rows: int = 1, aspect_sd: float = 0.0
    ) -> None:
        self.intrinsics = intrinsics
        self.focal = np.array([intrinsics.fx, intrinsics.fy])
        self.centre = np.array([intrinsics.cx, intrinsics.cy])
        self.is_distorted = intrinsics.model == "fisheye" or bool(np.any(intrinsics.distortion != 0.0))
        self.shutter = shutter or Shutter(intrinsics.line_time or 0.0)
        self._rows, self.aspect_sd = rows, aspect_sd
        self._lens = Lens(intrinsics)

    @property
    def line_time(self) -> float:
        """From a row of the image to the next [s]."""
        return self._rows * self.shutter.line_time

    def row_times(self, rows: Array) -> Array:
        """Exposure times of rows `(n,)` of an image, after the middle one `(n,)` [s]."""
        return np.asarray((rows - (self.intrinsics.height - 1) / 2) * self.line_time, np.float64)

    def exposed(self, points: Array, motion: Array | None) -> tuple[Array, Array]:
        """Points `(n, 3)` [m; RDF] as they are when their rows are exposed, and when that is `(n,)` [s].

        Args:
            points: when the middle row is exposed.
            motion: `(4,)`, angular rate [rad/s] and speed along the axis [m/s]; none under a global shutter.
        """
        moved, times = points, np.zeros(len(points))
        if motion is None:
            return moved, times
        for _ in range(ROUNDS):
            rows = self.project(moved)[0][:, 1]
            times = self.row_times(np.clip(rows, 0.0, self.intrinsics.height - 1.0))
            moved = points - times[:, None] * (points @ skew(motion[:3]).T)
            moved[:, 2] += times * motion[3]
        return moved, times

    def halved(self) -> Projection:
        """The same camera with images of half the width and height, each pixel the mean of four."""
        i = self.intrinsics
        size = {"width": i.width // 2, "height": i.height // 2, "fx": i.fx / 2, "fy": i.fy / 2}
        middle = {"cx": (i.cx - 0.5) / 2, "cy": (i.cy - 0.5) / 2}
        return Projection(i.model_copy(update={**size, **middle}), self.shutter, 2 * self._rows, self.aspect_sd)

    def project(self, points_cam: Array, motion: Array | None = None) -> tuple[Array, Bools]:
        """Project `(n, 3)` [m; RDF], as their rows see them where a motion is given; see `exposed`.

        Returns:
            Pixels `(n, 2)` [px, centres at integers] and whether each point is in front of the camera and inside the
            field where the lens's polynomial holds; pixels of the others mean nothing.
        """
        if motion is not None:
            points_cam = self.exposed(points_cam, motion)[0]
        z = points_cam[:, 2]
        visible = z > NEAR_M
        seen = points_cam[:, :2].T / np.where(visible, z, 1.0)
        if self.is_distorted:
            visible &= (seen * seen).sum(axis=0) < self._lens.r2_limit
            seen = self._lens.bend(seen)
        return seen.T * self.focal + self.centre, visible

    def jacobian(self, points_cam: Array) -> Array:
        """Derivative of the pixel with respect to the point `(n, 2, 3)` [px/m]; points must be in front."""
        d, iz = points_cam[:, :2].T / points_cam[:, 2], 1.0 / points_cam[:, 2]
        slope = self._lens.slope(d) if self.is_distorted else np.eye(2)[:, :, None]
        # Columns that lie together in memory are multiplied faster than rows of three.
        jacobian = np.empty((2, 3, len(iz)))
        jacobian[:, :2] = self.focal[:, None, None] * iz * slope
        jacobian[:, 2] = -(jacobian[:, :2] * d).sum(axis=1)
        return jacobian.transpose(2, 0, 1)

    def undistort(self, pixels: Array) -> Array:
        """Turn pixels `(n, 2)` into directions `(n, 2)` at unit depth."""
        bent: Array = (pixels - self.centre) / self.focal
        return self._lens.straighten(bent) if self.is_distorted else bent

    def k1_jacobian(self, points_cam: Array) -> Array:
        """Derivative of the pixel with respect to the first distortion coefficient `(n, 2)` [px]."""
        found: Array = self._lens.by_k1(points_cam[:, :2].T / points_cam[:, 2]).T * self.focal
        return found
