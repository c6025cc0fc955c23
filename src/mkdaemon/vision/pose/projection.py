"""Projection of points into the image with its derivatives: the one place of the estimator that knows the lens.

Lens models: how directions at unit depth are bent, with derivative and inverse.

The normalised image point of direction (x, y) is (x', y'); focal lengths and principal point come after.
"""

from __future__ import annotations

from typing import Final, Protocol

import cv2
import numpy as np
import numpy.typing as npt

from mkdaemon.vision.arrays import Array
from mkdaemon.vision.camera.intrinsics import Intrinsics
from mkdaemon.vision.pose.linetime import Shutter

WIDEST: Final = 1.5
"""Angle from the axis up to which a fisheye is inverted [rad]; at a right angle there is no point at unit depth."""
AXIS: Final = 1e-8
"""Radius below which a point is on the axis."""
NEWTON: Final = 20
"""Steps at most to invert a fisheye; four do."""


class Lens(Protocol):
    """One lens.

    Attributes:
        r2_limit: squared radius of directions up to which the image grows; beyond, points would fold back into it.
    """

    r2_limit: float

    def bend(self, xy: Array) -> Array:
        """Normalised image points `(n, 2)` of directions `(n, 2)`."""

    def slope(self, xy: Array) -> Array:
        """Derivative of `bend` `(n, 2, 2)`."""

    def by_k1(self, xy: Array) -> Array:
        """Derivative of `bend` by `k1` `(n, 2)`."""

    def straighten(self, bent: Array) -> Array:
        """Directions `(n, 2)` of normalised image points `(n, 2)`."""


class BrownConrady:
    """Radial and tangential distortion. Source: Brown, Photogrammetric Engineering 37(8), 1971, as in OpenCV."""

    def __init__(self, intrinsics: Intrinsics) -> None:
        self._k = intrinsics
        r = np.linspace(0.0, 4.0, 400)
        self.r2_limit = _grows_until(r, r * self._radial(r * r))

    def _radial(self, r2: Array) -> Array:
        found: Array = 1.0 + r2 * (self._k.k1 + r2 * (self._k.k2 + r2 * self._k.k3))
        return found

    def bend(self, xy: Array) -> Array:
        """See `Lens`."""
        k = self._k
        x, y = xy[:, 0], xy[:, 1]
        r2 = x * x + y * y
        radial = self._radial(r2)
        return np.column_stack(
            [
                x * radial + 2 * k.p1 * x * y + k.p2 * (r2 + 2 * x * x),
                y * radial + k.p1 * (r2 + 2 * y * y) + 2 * k.p2 * x * y,
            ]
        )

    def slope(self, xy: Array) -> Array:
        """See `Lens`."""
        k = self._k
        x, y = xy[:, 0], xy[:, 1]
        r2 = x * x + y * y
        radial = self._radial(r2)
        slope = 2 * (k.k1 + r2 * (2 * k.k2 + 3 * k.k3 * r2))
        out = np.empty((len(x), 2, 2))
        out[:, 0, 0] = radial + x * x * slope + 2 * k.p1 * y + 6 * k.p2 * x
        out[:, 0, 1] = x * y * slope + 2 * k.p1 * x + 2 * k.p2 * y
        out[:, 1, 0] = out[:, 0, 1]
        out[:, 1, 1] = radial + y * y * slope + 6 * k.p1 * y + 2 * k.p2 * x
        return out

    def by_k1(self, xy: Array) -> Array:
        """See `Lens`."""
        found: Array = xy * (xy * xy).sum(axis=1, keepdims=True)
        return found

    def straighten(self, bent: Array) -> Array:
        """See `Lens`."""
        criteria = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 40, 1e-9)
        points = np.ascontiguousarray(bent, dtype=np.float64).reshape(-1, 1, 2)
        found = cv2.undistortPointsIter(points, np.eye(3), self._k.distortion, np.eye(3), np.eye(3), criteria)
        return np.asarray(found, dtype=np.float64).reshape(-1, 2)


class Fisheye:
    """The image radius is a polynomial of the angle a from the axis: a (1 + k1 a^2 + k2 a^4 + k3 a^6 + k4 a^8).

    Source: Kannala and Brandt, PAMI 28(8), 2006, as in OpenCV's `fisheye`.
    """

    def __init__(self, intrinsics: Intrinsics) -> None:
        self._k = (intrinsics.k1, intrinsics.k2, intrinsics.k3, intrinsics.k4)
        angle = np.linspace(0.0, WIDEST, 400)
        self.r2_limit = _grows_until(np.tan(angle), self._radius(angle))

    def _radius(self, angle: Array) -> Array:
        k1, k2, k3, k4 = self._k
        a2 = angle * angle
        found: Array = angle * (1.0 + a2 * (k1 + a2 * (k2 + a2 * (k3 + a2 * k4))))
        return found

    def _radius_slope(self, angle: Array) -> Array:
        k1, k2, k3, k4 = self._k
        a2 = angle * angle
        found: Array = 1.0 + a2 * (3 * k1 + a2 * (5 * k2 + a2 * (7 * k3 + a2 * 9 * k4)))
        return found

    def bend(self, xy: Array) -> Array:
        """See `Lens`."""
        r = np.maximum(np.sqrt((xy * xy).sum(axis=1)), AXIS)
        found: Array = xy * (self._radius(np.arctan(r)) / r)[:, None]
        return found

    def slope(self, xy: Array) -> Array:
        """See `Lens`."""
        r = np.maximum(np.sqrt((xy * xy).sum(axis=1)), AXIS)
        angle = np.arctan(r)
        scale = self._radius(angle) / r
        # d(xy s(r)) = s I + xy xy^T s'(r) / r, with s' = (radius' / (1 + r^2) - s) / r
        along = (self._radius_slope(angle) / (1.0 + r * r) - scale) / (r * r)
        out: Array = xy[:, :, None] * xy[:, None, :] * along[:, None, None]
        out[:, 0, 0] += scale
        out[:, 1, 1] += scale
        return out

    def by_k1(self, xy: Array) -> Array:
        """See `Lens`."""
        r = np.maximum(np.sqrt((xy * xy).sum(axis=1)), AXIS)
        found: Array = xy * (np.arctan(r) ** 3 / r)[:, None]
        return found

    def straighten(self, bent: Array) -> Array:
        """See `Lens`; points outside the lens's field get its rim."""
        radius = np.sqrt((bent * bent).sum(axis=1))
        angle = np.minimum(radius, WIDEST)
        for _ in range(NEWTON):
            angle = np.clip(angle - (self._radius(angle) - radius) / self._radius_slope(angle), 0.0, WIDEST)
        found: Array = bent * (np.tan(angle) / np.maximum(radius, AXIS))[:, None]
        return found


def lens_of(intrinsics: Intrinsics) -> Lens:
    """The lens of a calibration."""
    return Fisheye(intrinsics) if intrinsics.model == "fisheye" else BrownConrady(intrinsics)


def _grows_until(radius: Array, image_radius: Array) -> float:
    """Squared radius up to which the image radius grows with the radius `(n,)`."""
    falling = np.flatnonzero(np.diff(image_radius) <= 0)
    return float(radius[falling[0]] ** 2) if falling.size else np.inf


NEAR_M = 0.02
"""Points closer to the camera plane than this are not projected [m]."""


class Projection:
    """A camera: its lens, then focal lengths and principal point. Source: OpenCV camera model.

    Args:
        intrinsics: its calibration.
        shutter: that learns; what the calibration says where absent, a global one where that says nothing: stills.
        rows: rows of the sensor that make up one of the image.

    Attributes:
        intrinsics: its calibration.
        focal: focal lengths `(2,)` [px].
        centre: principal point `(2,)` [px].
        is_distorted: whether the lens bends directions.
        shutter: what is known of its line time.
    """

    def __init__(self, intrinsics: Intrinsics, shutter: Shutter | None = None, rows: int = 1) -> None:
        self.intrinsics = intrinsics
        self.focal = np.array([intrinsics.fx, intrinsics.fy])
        self.centre = np.array([intrinsics.cx, intrinsics.cy])
        self.is_distorted = intrinsics.model == "fisheye" or bool(np.any(intrinsics.distortion != 0.0))
        self.shutter = shutter or Shutter(intrinsics.line_time or 0.0)
        self._rows = rows
        self._lens = lens_of(intrinsics)
        self._r2_limit = self._lens.r2_limit if self.is_distorted else np.inf

    @property
    def line_time(self) -> float:
        """From a row of the image to the next [s]."""
        return self._rows * self.shutter.line_time

    def halved(self) -> Projection:
        """The same camera with images of half the width and height, each pixel the mean of four."""
        i = self.intrinsics
        size = {"width": i.width // 2, "height": i.height // 2, "fx": i.fx / 2, "fy": i.fy / 2}
        middle = {"cx": (i.cx - 0.5) / 2, "cy": (i.cy - 0.5) / 2}
        return Projection(i.model_copy(update={**size, **middle}), self.shutter, 2 * self._rows)

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
