"""A camera that looks down, and the eyes behind it, as a noise model fitted to docs/lab/accuracy.md."""

from __future__ import annotations

import math
import random
from dataclasses import dataclass

import numpy as np

from mkdaemon.control.estimator.values import TargetView
from mkdaemon.control.linear import Array

LEAST_SIZE = 22.0
"""Smaller tags are not decoded [px]; docs/lab/accuracy.md."""


@dataclass(frozen=True, slots=True)
class CameraModel:
    """What it sees and how late.

    Attributes:
        focal: [px].
        width: [px].
        height: [px].
        rate: images [Hz].
        noise: standard deviation of a measured edge [px].
        latency: from the exposure to the pose [s].
        jitter: of the latency [s].
        stamp_error: constant error of the time stamps [s].
        missing: share of images without a pose.
        tags: sizes, largest first [m].
        gone: times in which the target is out of sight, as (from, to) [s].
    """

    focal: float = 420.0
    width: int = 640
    height: int = 480
    rate: float = 30.0
    noise: float = 0.35
    latency: float = 0.080
    jitter: float = 0.008
    stamp_error: float = 0.0
    missing: float = 0.0
    tags: tuple[float, ...] = (0.30, 0.06)
    gone: tuple[tuple[float, float], ...] = ()

    def look(self, at: float, target_from_flu: Array, place: Array, rng: random.Random) -> TargetView | None:
        """Return what an image shows of the target; None where it shows none.

        Args:
            at: middle of the exposure [s].
            target_from_flu: true attitude (3, 3).
            place: true position in the frame of the target (3,) [m].
            rng: source of the noise.
        """
        if rng.random() < self.missing or any(start <= at < end for start, end in self.gone):
            return None
        seen = target_from_flu.T @ -place
        depth = -float(seen[2])
        size = self._largest(seen, depth)
        if size is None:
            return None
        lateral = depth * self.noise / self.focal / 2
        along = depth**2 * self.noise / (self.focal * size) / 1.4
        angle = self.noise * 2 * depth**2 / (self.focal * size * size)
        twist = np.array([rng.gauss(0, angle), rng.gauss(0, angle), rng.gauss(0, 0.01)])
        measured = seen + np.array([rng.gauss(0, lateral), rng.gauss(0, lateral), rng.gauss(0, along)])
        rotation = rotation_of(twist) @ target_from_flu
        position = np.diag([lateral**2, lateral**2, along**2])
        covariance = pose_covariance(rotation, measured, position, np.diag([angle**2, angle**2, 0.01**2]))
        return TargetView(at + self.stamp_error, measured, rotation, covariance)

    def _largest(self, seen: Array, depth: float) -> float | None:
        """Side of the largest tag that is whole in the image and large enough [m]."""
        if depth < 0.05:
            return None
        for size in self.tags:
            half = size / 2 * 1.15
            across = self.focal * (abs(seen[1]) + half) < self.width / 2 * depth
            along = self.focal * (abs(seen[0]) + half) < self.height / 2 * depth
            if across and along and self.focal * size / depth > LEAST_SIZE:
                return size
        return None


def pose_covariance(rotation: Array, measured: Array, position: Array, turn: Array) -> Array:
    """Covariance (6, 6) of the vehicle's pose in the target frame, from that of what the camera measured.

    With p = -R m: dp = -R dm - [p]x dr, because a turn of the vehicle moves it around the target.
    """
    p = -rotation @ measured
    cross = np.array([[0.0, -p[2], p[1]], [p[2], 0.0, -p[0]], [-p[1], p[0], 0.0]])
    covariance = np.zeros((6, 6))
    covariance[:3, :3] = rotation @ position @ rotation.T + cross @ turn @ cross.T
    covariance[:3, 3:] = -cross @ turn
    covariance[3:, :3] = covariance[:3, 3:].T
    covariance[3:, 3:] = turn
    return covariance


def rotation_of(vector: Array) -> Array:
    """Rotation matrix of a rotation vector [rad]."""
    x, y, z = vector
    angle = math.sqrt(x * x + y * y + z * z)
    k: Array = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    sine, cosine = (1.0, 0.5) if angle < 1e-9 else (math.sin(angle) / angle, (1 - math.cos(angle)) / angle**2)
    rotation: Array = np.eye(3) + sine * k + cosine * (k @ k)
    return rotation
