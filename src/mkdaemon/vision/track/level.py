"""What the vehicle's attitude says about a pose: over a level target, the target's normal is the vertical."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from mkdaemon.config.vision import TrackerSection
from mkdaemon.vision.limits import JudgeLimits
from mkdaemon.vision.pose.edgefit import Level
from mkdaemon.vision.pose.pose import Pose, largest_variance
from mkdaemon.vision.track.attitude import Mounting, fuse_level, tilt_error

Array = npt.NDArray[np.float64]
Grey = npt.NDArray[np.uint8]

EXACT = 1e-3
"""Deviation of an attitude that replaces a tilt altogether [rad]."""


@dataclass(frozen=True, slots=True, eq=False)
class Sight:
    """One image with what is known about its moment.

    Attributes:
        pixels: `(h, w)` uint8.
        time: middle of the exposure [s].
        enu_from_flu: the vehicle's attitude then `(3, 3)`; none when unknown.
    """

    pixels: Grey
    time: float
    enu_from_flu: Array | None


class LevelKnowledge:
    """Knows the vertical in the image of one target.

    Args:
        is_level: whether the target lies level; the attitude says nothing about others.
        mounting: of the camera; none when unknown, and then the attitude says nothing.
        cfg: how well the attitude is known.
        limits: of the judge.
    """

    def __init__(self, is_level: bool, mounting: Mounting | None, cfg: TrackerSection, limits: JudgeLimits) -> None:
        self._mounting = mounting if is_level else None
        self._spread = float(np.radians(cfg.attitude_sd_deg))
        self._gate = float(np.radians(cfg.attitude_gate_deg))
        self._limits = limits

    def knows(self, seen: Sight) -> bool:
        """Whether the vertical is known in an image."""
        return seen.enu_from_flu is not None and self._mounting is not None

    def tilt(self, seen: Sight, pose: Pose) -> float | None:
        """Disagreement of a pose with the attitude [rad]; none where nothing is known."""
        if seen.enu_from_flu is None or self._mounting is None:
            return None
        return tilt_error(pose.rotation, self._mounting, seen.enu_from_flu)

    def gate(self, pose: Pose) -> float:
        """Largest disagreement that is believed of a pose [rad]."""
        spread = float(np.sqrt(largest_variance(pose.covariance[3:, 3:])))
        return self._gate + min(spread, self._limits.tilt_spread)

    def vertical(self, seen: Sight) -> Level | None:
        """The vertical in camera axes, to hold a fit with; none where nothing is known."""
        if seen.enu_from_flu is None or self._mounting is None or not self._limits.holds_tilt:
            return None
        up = (seen.enu_from_flu @ self._mounting.flu_from_cam).T[:, 2]
        return Level(up, self._spread)

    def fuse(self, seen: Sight, pose: Pose) -> Pose:
        """The pose with what the attitude knows about its tilt."""
        if seen.enu_from_flu is None or self._mounting is None:
            return pose
        return fuse_level(pose, self._mounting, seen.enu_from_flu, self._spread)

    def replace_tilt(self, seen: Sight, pose: Pose) -> Pose:
        """The pose with its tilt replaced by the attitude's; the place stays."""
        if seen.enu_from_flu is None or self._mounting is None:
            return pose
        vague = replace(pose, covariance=np.eye(6))
        return replace(fuse_level(vague, self._mounting, seen.enu_from_flu, EXACT), position=pose.position)
