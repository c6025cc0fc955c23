"""Where the camera is while the shutter is open, and what a point in the world becomes in the image.

The projection here is the ground truth of every rendered image: it is written out from the lens equations and shares
no code with the renderer (which maps pixels to planes) or with the pose estimation under test.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import lru_cache

import cv2
import numpy as np
import numpy.typing as npt

from mkdaemon.vision.camera.calibration_file import Intrinsics

Array = npt.NDArray[np.float64]
Image32 = npt.NDArray[np.float32]

NEAR_M = 0.005
"""Points closer to the image plane than this are behind the lens [m]."""


def rotation_from_vector(rotation_vector: Array) -> Array:
    """Rotation `(3, 3)` of an axis times angle `(3,)` [rad] (Rodrigues)."""
    angle = float(np.linalg.norm(rotation_vector))
    if angle < 1e-12:
        return np.eye(3)
    x, y, z = rotation_vector / angle
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    rotation: Array = np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * (cross @ cross)
    return rotation


@dataclass(frozen=True, slots=True)
class ViewPose:
    """A rigid body in the world: `enu_from_body` `(3, 3)` and `position_enu` `(3,)` [m]."""

    enu_from_body: Array
    position_enu: Array

    def points(self, points_body: Array) -> Array:
        """Carry points `(n, 3)` [m; body] into the world `(n, 3)` [m; ENU]."""
        carried: Array = points_body @ self.enu_from_body.T + self.position_enu
        return carried


@dataclass(frozen=True, slots=True)
class CameraView:
    """A camera at the middle of its exposure.

    Attributes:
        intrinsics: projection and lens.
        enu_from_cam: `(3, 3)`, camera axes are RDF.
        position_enu: `(3,)` [m].
        velocity_enu: `(3,)` [m/s]; only blurs.
        rate_cam: `(3,)` angular rate about the camera's own axes [rad/s]; only blurs.
        exposure_time: how long the shutter is open [s]; 0 freezes motion.
        time: middle of the exposure, moves platforms [s].
        line_time: between the exposures of neighbouring rows, from the top [s]; 0 is a global shutter. The pose is
            that of the middle row.
        vibration_cam: greatest angular rate of a vibration about the camera's axes `(3,)` [rad/s], seen by a rolling
            shutter; in the middle row its rate is greatest.
        vibration_hz: its frequency [Hz].
    """

    intrinsics: Intrinsics
    enu_from_cam: Array
    position_enu: Array
    velocity_enu: Array = field(default_factory=lambda: np.zeros(3))
    rate_cam: Array = field(default_factory=lambda: np.zeros(3))
    exposure_time: float = 0.0
    time: float = 0.0
    line_time: float = 0.0
    vibration_cam: Array = field(default_factory=lambda: np.zeros(3))
    vibration_hz: float = 0.0

    def turned(self, time_offset: float) -> Array:
        """Rotation vector `(3,)` [rad] from the pose to that `time_offset` [s] later, its own axes."""
        turned: Array = self.rate_cam * time_offset
        if self.vibration_hz > 0.0:
            circular = 2.0 * np.pi * self.vibration_hz
            turned = turned + self.vibration_cam * (np.sin(circular * time_offset) / circular)
        return turned

    def moved(self, time_offset: float) -> CameraView:
        """The same camera `time_offset` [s] away from the middle of the exposure, standing still."""
        return replace(
            self,
            enu_from_cam=self.enu_from_cam @ rotation_from_vector(self.rate_cam * time_offset),
            position_enu=self.position_enu + self.velocity_enu * time_offset,
            exposure_time=0.0,
            time=self.time + time_offset,
        )

    def wider(self, border: int) -> CameraView:
        """The same camera with `border` more pixels on each side."""
        lens = self.intrinsics
        grown = {"width": lens.width + 2 * border, "height": lens.height + 2 * border}
        middle = {"cx": lens.cx + border, "cy": lens.cy + border}
        return replace(self, intrinsics=lens.model_copy(update=grown | middle))

    def camera_points(self, points_enu: Array) -> Array:
        """World points `(n, 3)` [m; ENU] in the camera frame `(n, 3)` [m; RDF]."""
        seen: Array = (points_enu - self.position_enu) @ self.enu_from_cam
        return seen


def project(points_cam: Array, intrinsics: Intrinsics) -> Array:
    """Image `(n, 2)` [px, centres at integers] of points `(n, 3)` [m; RDF]; NaN for points behind the lens.

    Source: OpenCV camera model, Brown, Photogrammetric Engineering 37(8), 1971.
    """
    if intrinsics.model == "fisheye":
        return _fisheye(points_cam, intrinsics)
    z = np.where(points_cam[:, 2] > NEAR_M, points_cam[:, 2], np.nan)
    x, y = points_cam[:, 0] / z, points_cam[:, 1] / z
    r2 = x * x + y * y
    radial = 1.0 + r2 * (intrinsics.k1 + r2 * (intrinsics.k2 + r2 * intrinsics.k3))
    xd = x * radial + 2.0 * intrinsics.p1 * x * y + intrinsics.p2 * (r2 + 2.0 * x * x)
    yd = y * radial + intrinsics.p1 * (r2 + 2.0 * y * y) + 2.0 * intrinsics.p2 * x * y
    return np.stack([intrinsics.fx * xd + intrinsics.cx, intrinsics.fy * yd + intrinsics.cy], axis=1)


def _fisheye(points_cam: Array, intrinsics: Intrinsics) -> Array:
    """The same through a fisheye. Source: OpenCV."""
    points = np.ascontiguousarray(points_cam, dtype=np.float64).reshape(-1, 1, 3)
    found, _ = cv2.fisheye.projectPoints(
        points, np.zeros(3), np.zeros(3), intrinsics.matrix, intrinsics.distortion.reshape(4, 1)
    )
    seen: Array = np.where(points_cam[:, 2:] > NEAR_M, found[:, 0], np.nan)
    return seen


class RayGrid:
    """The direction each pixel looks along, undistorted: `x` and `y` at unit depth, `(height, width)` float32.

    Finer grids for super-sampling are interpolated from one grid with a border of one pixel, so sub-sample centres
    are exact to 1e-5 px.
    """

    def __init__(self, intrinsics: Intrinsics, padded: tuple[Image32, Image32] | None = None) -> None:
        """Compute the directions, or take those `(height + 2, width + 2)` that are known, with the border."""
        self.intrinsics = intrinsics
        self._x, self._y = padded if padded is not None else _directions(intrinsics)
        self.x, self.y = self._x[1:-1, 1:-1].copy(), self._y[1:-1, 1:-1].copy()
        self._column_low, self._column_high = self.x.min(axis=0), self.x.max(axis=0)
        rim = np.concatenate(
            [
                np.column_stack([g[i, ::16], h[i, ::16]])
                for g, h in ((self.x, self.y), (self.x.T, self.y.T))
                for i in (0, -1)
            ]
        )
        corner = np.array(
            [[self.x[-1, -1], self.y[-1, -1]], [self.x[0, -1], self.y[0, -1]], [self.x[-1, 0], self.y[-1, 0]]]
        )
        self.rim: Array = np.vstack([np.concatenate([rim, corner]).T, np.ones(len(rim) + 3)]).astype(np.float64)
        self._row_low, self._row_high = self.y.min(axis=1), self.y.max(axis=1)

    @property
    def padded(self) -> tuple[Image32, Image32]:
        """The directions with their border, `(height + 2, width + 2)` each."""
        return self._x, self._y

    def window(self, x_range: tuple[float, float], y_range: tuple[float, float]) -> tuple[slice, slice]:
        """Rows and columns that can see directions inside the box; empty slices when none does."""
        columns = np.flatnonzero((self._column_high >= x_range[0]) & (self._column_low <= x_range[1]))
        rows = np.flatnonzero((self._row_high >= y_range[0]) & (self._row_low <= y_range[1]))
        if not columns.size or not rows.size:
            return slice(0, 0), slice(0, 0)
        return (
            slice(max(int(rows[0]) - 2, 0), min(int(rows[-1]) + 3, self.intrinsics.height)),
            slice(max(int(columns[0]) - 2, 0), min(int(columns[-1]) + 3, self.intrinsics.width)),
        )

    def fine(self, rows: slice, columns: slice, factor: int) -> tuple[Image32, Image32]:
        """Directions of the `factor` x `factor` sub-samples of a window."""
        if factor == 1:
            return self.x[rows, columns], self.y[rows, columns]
        return self._finer(self._x, rows, columns, factor), self._finer(self._y, rows, columns, factor)

    def _finer(self, grid: Image32, rows: slice, columns: slice, factor: int) -> Image32:
        part = grid[rows.start : rows.stop + 2, columns.start : columns.stop + 2]
        fine = cv2.resize(part, None, fx=factor, fy=factor, interpolation=cv2.INTER_LINEAR)
        return np.asarray(fine[factor:-factor, factor:-factor], dtype=np.float32)


@lru_cache(maxsize=4)
def _directions(intrinsics: Intrinsics) -> tuple[Image32, Image32]:
    """Directions of all pixels and of a border of one; kept, scenes share their lens."""
    v, u = np.mgrid[-1 : intrinsics.height + 1, -1 : intrinsics.width + 1].astype(np.float64)
    x, y = _undistorted((u - intrinsics.cx) / intrinsics.fx, (v - intrinsics.cy) / intrinsics.fy, intrinsics)
    found = x.astype(np.float32), y.astype(np.float32)
    for grid in found:
        grid.setflags(write=False)
    return found


def _undistorted(xd: Array, yd: Array, intrinsics: Intrinsics) -> tuple[Array, Array]:
    """Invert the lens by fixed-point iteration until 1e-9 of the focal length; a fisheye by OpenCV."""
    if intrinsics.model == "fisheye":
        bent = np.stack([xd, yd], axis=-1).reshape(-1, 1, 2)
        found = cv2.fisheye.undistortPoints(bent, np.eye(3), intrinsics.distortion.reshape(4, 1))
        straight = np.asarray(found, dtype=np.float64).reshape(*xd.shape, 2)
        return straight[..., 0], straight[..., 1]
    # `project` bends by xd = x radial(r) + dx(x, y). The fixed point of x = (xd - dx(x, y)) / radial(r) is its inverse.
    x, y = xd.copy(), yd.copy()
    for _ in range(60):
        r2 = x * x + y * y
        radial = 1.0 + r2 * (intrinsics.k1 + r2 * (intrinsics.k2 + r2 * intrinsics.k3))
        dx = 2.0 * intrinsics.p1 * x * y + intrinsics.p2 * (r2 + 2.0 * x * x)
        dy = intrinsics.p1 * (r2 + 2.0 * y * y) + 2.0 * intrinsics.p2 * x * y
        new_x, new_y = (xd - dx) / radial, (yd - dy) / radial
        change = max(float(np.abs(new_x - x).max()), float(np.abs(new_y - y).max()))
        x, y = new_x, new_y
        if change < 1e-9:
            break
    return x, y


def view_towards(
    intrinsics: Intrinsics, position_enu: Array, point_enu: Array, *, turn: float = 0.0, time: float = 0.0
) -> CameraView:
    """A camera at `position_enu` looking at `point_enu`, upright or north up, turned about its axis [rad]."""
    forward = (point_enu - position_enu) / np.linalg.norm(point_enu - position_enu)
    up = np.array([0.0, 0.0, 1.0]) if abs(forward[2]) < 0.99 else np.array([0.0, 1.0, 0.0])
    right = np.cross(forward, up)
    right /= np.linalg.norm(right)
    rotation = np.stack([right, np.cross(forward, right), forward], axis=1)
    return CameraView(intrinsics, rotation @ rotation_from_vector(np.array([0.0, 0.0, turn])), position_enu, time=time)
