"""A deck told by normals that images measured."""

from __future__ import annotations

import numpy as np

from lab.vision.flight import LOOKING_DOWN
from mkdaemon.config.vision import TrackerSection
from mkdaemon.vision.pose.pose import Pose, turn
from mkdaemon.vision.track.attitude import ImageSight, turn_between
from mkdaemon.vision.track.level import LevelKnowledge

PIXELS = np.zeros((2, 2), np.uint8)


class Deck:
    """What images taught of a deck and an attitude that is exact from image to image."""

    def __init__(self) -> None:
        self.level = LevelKnowledge(True, LOOKING_DOWN, TrackerSection(attitude_sd_deg=1e-6))

    def measured(self, time: float, enu_from_flu: np.ndarray, normal: np.ndarray, sd: float) -> None:
        """An image whose fit knows a normal `(3,)` [ENU] by a deviation of each axis [rad]."""
        seen = self._seen(time, enu_from_flu)
        level = seen.enu_from_cam.T
        rotation = turn(level, turn_between(level[:, 2], level @ normal / np.linalg.norm(normal)))
        spread = np.diag([1e-6] * 3 + [sd**2] * 3)
        self.level.learn(seen, Pose(rotation, np.array([0.0, 0.0, 1.0]), spread, "edges", 99, 0.1))

    def normal(self, time: float, enu_from_flu: np.ndarray) -> np.ndarray:
        """The normal expected `(3,)` [ENU]."""
        seen = self._seen(time, enu_from_flu)
        return seen.enu_from_cam @ self.level.vertical(seen).up

    def sd(self, time: float, enu_from_flu: np.ndarray) -> float:
        """Its deviation [rad]."""
        return self.level.vertical(self._seen(time, enu_from_flu)).spread

    def is_contradicted_at(self, time: float) -> bool:
        """Whether the attitude is left out of an image."""
        seen = self._seen(time, np.eye(3))
        return self.level.sight(seen) is not seen

    @staticmethod
    def _seen(time: float, enu_from_flu: np.ndarray) -> ImageSight:
        return ImageSight(PIXELS, time, enu_from_flu @ LOOKING_DOWN.flu_from_cam)
