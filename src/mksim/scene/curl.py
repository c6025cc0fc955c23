"""Paper that does not lie flat: a sheet bent into a part of a cylinder, which stretches no line on it.

All rays are carried to a flat sheet: a ray that hits a point of the bent sheet is replaced by the ray that sees the
same ink on the flat one. What lies around the sheet is carried with it, as `rolling` does for rows.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from mksim.scene.view import CameraView, RayGrid, ViewPose

Array = npt.NDArray[np.float64]

STEPS = 6
"""Newton steps from the flat sheet to the bent one; the bow is small against the distance."""


@dataclass(frozen=True, slots=True)
class Curl:
    """A bent sheet.

    Attributes:
        radius: of the cylinder [m]; positive bends the middle up, towards the reader. A sheet of 0.3 m that rose by
            3 mm in the middle has 3.75 m (width^2 / 8 / rise).
        axis: direction of the cylinder's axis, counter-clockwise from target x [rad].
        width: of the sheet across the axis [m]; beyond it the ground is flat.
    """

    radius: float
    axis: float
    width: float

    def height(self, across: Array) -> Array:
        """Height `(n,)` [m] over the least-squares plane of the sheet, at `(n,)` [m] along the plane."""
        inside = np.clip(across, -self.width / 2, self.width / 2)
        bow = np.abs(self.radius) - np.sqrt(self.radius**2 - inside**2)
        height: Array = np.sign(self.radius) * (self.width**2 / (24 * abs(self.radius)) - bow)
        return height

    def slope(self, across: Array) -> Array:
        """Its derivative."""
        inside = np.clip(across, -self.width / 2, self.width / 2)
        slope: Array = -np.sign(self.radius) * inside / np.sqrt(self.radius**2 - inside**2)
        return np.where(np.abs(across) < self.width / 2, slope, 0.0)

    def along_paper(self, across: Array) -> Array:
        """Length along the paper from its middle [m]: the arc."""
        inside = np.clip(across, -self.width / 2, self.width / 2)
        arc: Array = np.abs(self.radius) * np.arcsin(inside / abs(self.radius)) + (across - inside)
        return arc


def bend(rays: RayGrid, view: CameraView, plane: ViewPose, curl: Curl) -> RayGrid:
    """The rays of `view`'s camera that see on a flat sheet what it sees on the bent one.

    Args:
        rays: of the camera.
        view: where the camera is.
        plane: the least-squares plane of the sheet, its middle at the origin.
        curl: how it is bent.
    """
    x, y = rays.padded
    target_from_cam = plane.enu_from_body.T @ view.enu_from_cam
    turn = np.array([[np.cos(curl.axis), np.sin(curl.axis), 0], [-np.sin(curl.axis), np.cos(curl.axis), 0], [0, 0, 1]])
    eye = turn @ plane.enu_from_body.T @ (view.position_enu - plane.position_enu)
    looks = np.stack([x, y, np.ones_like(x)], axis=2).astype(np.float64) @ (turn @ target_from_cam).T
    down = np.where(looks[:, :, 2] < -1e-6, looks[:, :, 2], -1e-6)
    distance = -eye[2] / down
    for _ in range(STEPS):
        across = eye[1] + distance * looks[:, :, 1]
        miss = eye[2] + distance * down - curl.height(across)
        distance = distance - miss / (down - curl.slope(across) * looks[:, :, 1])
    hits = eye + distance[:, :, None] * looks
    hits[:, :, 1], hits[:, :, 2] = curl.along_paper(hits[:, :, 1]), 0.0
    seen = (hits - eye) @ (turn @ target_from_cam)
    meets = (looks[:, :, 2] < -1e-6) & (seen[:, :, 2] > 1e-6)
    depth = np.where(meets, seen[:, :, 2], 1.0)
    carried = [np.where(meets, seen[:, :, k] / depth, (x, y)[k]).astype(np.float32) for k in (0, 1)]
    return RayGrid(rays.intrinsics, (carried[0], carried[1]))
