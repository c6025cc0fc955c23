"""Pose of a target from the corners of its tags, with a covariance that includes what calibration does not know.

Camera axes are RDF. `rotation` is camera from target, `position` the target's origin in the camera [m]. Covariances are
6x6 over (position [m], rotation vector [rad]), both in camera axes; the rotation is a left perturbation.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import sqrt
from typing import Literal

import cv2
import numpy as np
import numpy.typing as npt

from mkdaemon.vision.arrays import Array, UnknownsEstimate
from mkdaemon.vision.pose.projection import Projection
from mkdaemon.vision.pose.rolling import skew
from mkdaemon.vision.tags.cellread import Detection
from mkdaemon.vision.tags.tagmap import SAME_HEIGHT_M, Tag

Source = Literal["corners", "edges", "photometric"]

RIDGE, LEAST_RIDGE = 1e-9, 1e-12
"""Share of the normal matrix' diagonal that is added before inversion, plus a constant: unobservable directions stay
finite."""
LEAST_NORM = 1e-9
"""Vectors shorter than this have no direction."""
CORNER_SD_PX = 0.15
"""Deviation of a detected corner [px]: 0.02 on large tags, 0.15 at 15 px a side, rendered images."""
FLOOR_RANGE = 0.003
"""Range error a calibration leaves, of the range: focal length and print size."""
FLOOR_LATERAL = 0.002
"""Lateral error a calibration leaves, of the range: principal point."""
FLOOR_ANGLE = np.radians(0.1)
"""Angle error a calibration leaves [rad]: lens model and flatness of the print."""


@dataclass(frozen=True, slots=True, eq=False)
class Pose:
    """Pose of a target in the camera's axes.

    Attributes:
        rotation: camera from target `(3, 3)`.
        position: origin of the target `(3,)` [m; RDF].
        covariance: of the measurement alone `(6, 6)`; `with_floor` adds calibration.
        source: how it was measured.
        points: measurements that agree.
        rms_px: their residual [px]; for `photometric` the residual over the contrast, in px of edge shift.
        inliers: share of the measurements that agree.
        step: length of the last step of the fit against the range.
        loss: geometric mean of the bounded squared residuals of all samples, by which rival fits of an image compare.
        likeness: correlation between model and image without the noise of single pixels, where the fit knows it.
        blur_px: half width of an edge in the image, or of grey values the deviation of the point spread, where known.
        melted_px: side of cells below which a fit to edges has found edges that run into their neighbours [px].
        shift_px: how far all edges lie towards their bright side, where the fit asked [px].
        blown: share of the edges whose bright side is blown.
        motion: of the camera while its rows were read `(4,)`, where the fit asked; see `rolling`.
        known_motion: what was known about it before the fit.
        seen_motion: what the image alone says about it, if the line time is unknown.
        bend: of the print, where the fit asked.
        known_bend: what was known about it before the fit.
        shared: factor on the variance by residuals that neighbouring pixels share (`photofit`).
        common: share of the residuals' variance that neighbouring pixels share: the rest is noise.
        cost: robust mean square of the residuals of a fit to grey values [grey^2], with what its bend and motion cost.
        is_halved: whether it is of an image of half the size: its loss compares with others of that size alone.
    """

    rotation: Array
    position: Array
    covariance: Array
    source: Source
    points: int
    rms_px: float
    inliers: float = 1.0
    step: float = 0.0
    loss: float = 0.0
    likeness: float | None = None
    blur_px: float | None = None
    melted_px: float = 0.0
    shift_px: float = 0.0
    blown: float = 0.0
    motion: Array | None = None
    known_motion: UnknownsEstimate | None = None
    seen_motion: UnknownsEstimate | None = None
    bend: UnknownsEstimate | None = None
    known_bend: UnknownsEstimate | None = None
    shared: float = 1.0
    common: float = 1.0
    cost: float | None = None
    is_halved: bool = False

    @property
    def unexplained_px(self) -> float:
        """Residual without the noise of single pixels [px]: what the model lacks, or has not reached, is shared."""
        return self.rms_px * sqrt(self.common)

    @property
    def range_m(self) -> float:
        """Distance of the target's origin [m]."""
        return sqrt(float(self.position @ self.position))

    @property
    def tilt(self) -> float:
        """Angle between the line of sight and the target's normal [rad]."""
        toward = -self.position / max(self.range_m, 1e-9)
        return float(np.arccos(np.clip(self.rotation[:, 2] @ toward, -1.0, 1.0)))


def angle_between(a: Array, b: Array) -> float:
    """Angle of the rotation from `b` to `a` [rad]."""
    return float(np.arccos(np.clip((np.trace(a @ b.T) - 1.0) / 2.0, -1.0, 1.0)))


def apart(one: Pose, other: Pose) -> Array:
    """Step `(6,)` from one pose to another: position [m], rotation vector [rad], as in their covariances."""
    turned = np.asarray(cv2.Rodrigues(other.rotation @ one.rotation.T)[0], np.float64).ravel()
    return np.concatenate([other.position - one.position, turned])


def length2(step: Array, covariance: Array) -> float:
    """Squared length of a step `(k,)` in deviations of a covariance `(k, k)`."""
    return float(step @ np.linalg.solve(covariance, step))


def turn(rotation: Array, by: Array) -> Array:
    """Left-multiply a rotation by the exponential of a rotation vector `(3,)` [rad], keeping it orthonormal."""
    turned = cv2.Rodrigues(by.reshape(3, 1))[0] @ rotation
    # Newton's step to the nearest orthonormal matrix: rounding errors are squared.
    orthonormal: Array = 1.5 * turned - 0.5 * turned @ (turned.T @ turned)
    return orthonormal


def moved(pose: Pose, by: Array) -> Pose:
    """The pose of another point of the same rigid target, `by` from its origin `(3,)` [m; target], in the same axes.

    With q = R b a turn w about the old origin moves the new one by w x q: dp' = dp - [q]x w.
    """
    arm = pose.rotation @ by
    carry = np.eye(6)
    carry[:3, 3:] = -skew(arm)
    return replace(pose, position=pose.position + arm, covariance=carry @ pose.covariance @ carry.T)


def calibration_sd(pose: Pose) -> tuple[float, float, float]:
    """Uncertainty of the calibration, common to all images: sd along the sight [m], across it [m], angle [rad]."""
    distance = pose.range_m
    return FLOOR_RANGE * distance, FLOOR_LATERAL * distance, float(FLOOR_ANGLE)


def with_floor(pose: Pose) -> Array:
    """Covariance `(6, 6)` including calibration: range .3 %, lateral .2 %, angle .1 deg (standard deviations)."""
    along_sd, across_sd, angle_sd = calibration_sd(pose)
    sight = pose.position / max(pose.range_m, 1e-9)
    along = np.outer(sight, sight)
    floor = np.zeros((6, 6))
    floor[:3, :3] = along_sd**2 * along + across_sd**2 * (np.eye(3) - along)
    floor[3:, 3:] = angle_sd**2 * np.eye(3)
    return pose.covariance + floor


def solve(tags: Sequence[tuple[Tag, Detection]], projection: Projection) -> list[Pose]:
    """Solve a target's pose from the corners of its detected tags.

    Args:
        tags: tags of one target with their detections; at least one.
        projection: calibrated camera.

    Returns:
        Candidates, the one with the smallest residual first: two for tags in one plane, where a mirrored pose explains
        the corners almost as well, one otherwise; empty when no solution lies in front of the camera.

    Source: IPPE, Collins and Bartoli, IJCV 109(3), 2014; SQPnP, Terzakis and Lourakis, ECCV 2020.
    """
    points = np.concatenate([tag.corners for tag, _ in tags])
    pixels = np.concatenate([found.corners for _, found in tags])
    rays = projection.undistort(pixels)
    sd = CORNER_SD_PX * max(found.shrunk for _, found in tags)
    poses: list[Pose] = []
    for start in _starts(tags, points, rays):
        rotation, position = refined(points, rays, *start)
        seen = points @ rotation.T + position
        projected, visible = projection.project(seen)
        if not bool(visible.all()):
            continue
        squares = float(((pixels - projected) ** 2).sum())
        # A turn w about the target's origin moves its point at the arm q by w x q, so the row of w is q x J.
        by_point = projection.jacobian(seen).reshape(-1, 3)
        jacobian = np.hstack([by_point, np.cross(np.repeat(seen - position, 2, axis=0), by_point)])
        # C = sigma^2 (J^T J)^-1 with sigma^2 by the residuals of 2 n - 6 degrees of freedom, at least a corner's own.
        variance = max(sd**2, squares / (len(jacobian) - 6))
        covariance = variance * inverted(damped(jacobian.T @ jacobian))
        rms = sqrt(squares / len(points))
        poses.append(Pose(rotation, position, covariance, "corners", len(points), rms, loss=rms**2))
    return sorted(poses, key=lambda pose: pose.rms_px)


def refined(points: Array, rays: Array, rotation: Array, position: Array) -> tuple[Array, Array]:
    """The rotation and position near these by which points `(n, 3)` [m] are seen at rays `(n, 2)` at unit depth."""
    turned, moved = cv2.Rodrigues(rotation)[0], position.reshape(3, 1).copy()
    vector, place = cv2.solvePnPRefineLM(points, rays, np.eye(3), np.zeros(0), turned, moved)
    return np.asarray(cv2.Rodrigues(vector)[0], np.float64), np.asarray(place, np.float64).ravel()


def _starts(tags: Sequence[tuple[Tag, Detection]], points: Array, rays: Array) -> list[tuple[Array, Array]]:
    """Rotations and positions that explain where the corners of tags are seen; IPPE knows both of one plane."""
    first = tags[0][0]
    local = (points - first.position) @ first.rotation
    method = cv2.SOLVEPNP_SQPNP
    if float(np.abs(local[:, 2]).max()) < SAME_HEIGHT_M:
        local[:, 2], method = 0.0, cv2.SOLVEPNP_IPPE
    _, rotations, positions, _ = cv2.solvePnPGeneric(local, rays, np.eye(3), np.zeros(0), flags=method)
    found: list[tuple[Array, Array]] = []
    for vector, place in zip(rotations, positions, strict=True):
        rotation = np.asarray(cv2.Rodrigues(vector)[0], np.float64) @ first.rotation.T
        position = np.asarray(place, np.float64).ravel() - rotation @ first.position
        if np.isfinite(rotation).all() and np.isfinite(position).all():
            found.append((rotation, position))
    return found


def inverse(pose: Pose, covariance: Array) -> tuple[Array, Array, Array]:
    """Turn camera-sees-target into target-sees-camera.

    Args:
        pose: camera from target.
        covariance: `(6, 6)` that belongs to it.

    Returns:
        Rotation target from camera `(3, 3)`, position of the camera `(3,)` [m; target] and covariance `(6, 6)` in
        target axes.
    """
    back = pose.rotation.T
    # c = -R' p; a left perturbation w of R moves c by R' (w x p) = -R' [p]x w.
    jacobian = np.zeros((6, 6))
    jacobian[:3, :3] = -back
    jacobian[:3, 3:] = -back @ skew(pose.position)
    jacobian[3:, 3:] = -back
    return back, -back @ pose.position, jacobian @ covariance @ jacobian.T


def largest_variance(covariance: Array) -> float:
    """Largest eigenvalue of a symmetric matrix; OpenCV's solver, as LAPACK starts threads."""
    if not np.isfinite(covariance).all():
        return float("inf")
    return max(float(cv2.eigen(np.ascontiguousarray(covariance))[1][0, 0]), 0.0)


def correlation(a: Array, b: Array) -> float:
    """Pearson's correlation of two vectors; zero when one of them is constant."""
    a, b = a - a.mean(), b - b.mean()
    norm = float(np.sqrt((a @ a) * (b @ b)))
    return float(a @ b) / norm if norm > LEAST_NORM else 0.0


def median(values: npt.NDArray[np.floating]) -> float:
    """Upper median."""
    return quantile(values, 0.5)


def quantile(values: npt.NDArray[np.floating | np.integer], share: float) -> float:
    """The value that so large a share is below, one of `values`; by partition, which is faster than `np.quantile`."""
    rank = min(int(share * values.size), values.size - 1)
    return float(np.partition(values, rank, axis=None)[rank])


def damped(normal: Array) -> Array:
    """A normal matrix `(k, k)` with its ridge."""
    found: Array = normal.copy()
    diagonal = found.reshape(-1)[:: len(found) + 1]
    diagonal += RIDGE * diagonal + LEAST_RIDGE
    return found


def inverted(normal: Array) -> Array:
    """Inverse of a normal matrix `(k, k)`."""
    return np.asarray(np.linalg.inv(normal), np.float64)
