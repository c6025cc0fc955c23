"""Measure printed edges in an image without the renderer's mathematics and without a tag detector."""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt

from mkdaemon.vision.tags.tagmap import Tag
from mksim.scene.view import CameraView, ViewPose, project

Array = npt.NDArray[np.float64]


def corner_errors(image: npt.NDArray[np.uint8], tag: Tag, pose: ViewPose, view: CameraView) -> Array:
    """Distance of each rendered corner from its exact projection `(4,)` [px].

    Points on each side of the black square are projected exactly; the grey profile across the side gives the offset
    of the rendered edge by the centroid of its derivative; a line through the offsets, met with its neighbour's, is
    the rendered corner.
    """
    corners = project(view.camera_points(pose.points(tag.corners)), view.intrinsics)
    lines = []
    for start, end in zip(tag.corners, np.roll(tag.corners, -1, axis=0), strict=True):
        along = np.linspace(0.08, 0.92, 60)
        points = start + along[:, None] * (end - start)
        seen = project(view.camera_points(pose.points(points)), view.intrinsics)
        normal = _normals(seen)
        module_px = float(np.linalg.norm(seen[-1] - seen[0])) / 0.84 / tag.bitmap.shape[0]
        reach = min(4.0, 0.45 * module_px)
        steps = np.arange(-reach, reach + 1e-9, 0.1)
        probe = (seen[:, None, :] + steps[None, :, None] * normal[:, None, :]).astype(np.float32)
        profile = cv2.remap(image.astype(np.float32), probe, None, cv2.INTER_CUBIC)
        rise = np.abs(np.diff(profile, axis=1))
        offset = (rise * (steps[:-1] + 0.05)).sum(axis=1) / rise.sum(axis=1)
        good = np.abs(offset - np.median(offset)) < 0.3
        slope, at_start = np.polyfit(along[good], offset[good], 1)
        lines.append((at_start, at_start + slope, normal[0], normal[-1]))
    errors = []
    for k in range(4):
        _, before, _, normal_before = lines[k - 1]
        after, _, normal_after, _ = lines[k]
        shift = np.linalg.lstsq(np.stack([normal_before, normal_after]), np.array([before, after]), rcond=None)[0]
        errors.append(float(np.linalg.norm(shift)))
    assert np.isfinite(corners).all()
    return np.array(errors)


def _normals(points: Array) -> Array:
    tangent = np.gradient(points, axis=0)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    return np.stack([-tangent[:, 1], tangent[:, 0]], axis=1)
