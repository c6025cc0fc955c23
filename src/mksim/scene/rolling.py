"""A rolling shutter: every row of the image is exposed at its own time, by a camera that has moved on.

All rows are carried to one camera at the middle of the image: a ray of a row hits the plane of the scene where the
moved camera sees it, and the standing camera sees that point along another ray. Exact for everything in that plane.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from mksim.scene.view import CameraView, Pose, RayGrid, rotation_from_vector

Array = npt.NDArray[np.float64]

LEAST_SLOPE = 1e-6
"""Rays that are nearer to parallel with the plane do not meet it."""


def roll(rays: RayGrid, view: CameraView, plane: Pose) -> RayGrid:
    """The rays of `view`'s camera while its rows are exposed one after the other.

    Args:
        rays: of the camera at rest.
        view: the camera when its middle row is exposed, and how it moves.
        plane: whose xy plane the scene lies in; it stands still.
    """
    x, y = rays.padded
    times = (np.arange(len(x)) - (len(x) - 1) / 2) * view.line_time
    turns = np.array([rotation_from_vector(view.turned(float(time))) for time in times])
    looks = np.stack([x, y, np.ones_like(x)], axis=2).astype(np.float64) @ turns.transpose(0, 2, 1)
    normal = view.enu_from_cam.T @ plane.enu_from_body[:, 2]
    height = float(normal @ view.camera_points(plane.position_enu[None])[0])
    places = times[:, None] * (view.enu_from_cam.T @ view.velocity_enu)
    slope = looks @ normal
    distance = (height - places @ normal)[:, None] / np.where(np.abs(slope) > LEAST_SLOPE, slope, np.inf)
    hits = places[:, None, :] + distance[:, :, None] * looks
    meets = (distance > 0.0) & (hits[:, :, 2] > 0.0)
    seen = np.where(meets[:, :, None], hits, looks)
    depth = np.maximum(seen[:, :, 2:], LEAST_SLOPE)
    carried = (seen[:, :, :2] / depth).astype(np.float32)
    return RayGrid(rays.intrinsics, (carried[:, :, 0], carried[:, :, 1]))
