"""What the vehicle's attitude says about a pose: over a level target, the target's normal is nearly the vertical."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import radians

import numpy as np
import numpy.typing as npt

from mkdaemon.config.vision import TrackerSection
from mkdaemon.vision.pose.edgefit import Level
from mkdaemon.vision.pose.pose import Pose, largest_variance, turn
from mkdaemon.vision.pose.rolling import skew
from mkdaemon.vision.track.attitude import Mounting, Turning, fuse_normal, normal_beside
from mkdaemon.vision.track.course import lasting_doubt
from mkdaemon.vision.track.deck import PRIOR_SD, Deck
from mkdaemon.vision.tracklimits import JudgeLimits

Array = npt.NDArray[np.float64]
Grey = npt.NDArray[np.uint8]

FAST = radians(0.5)
"""Deviation of an attitude from one image to the next, each axis [rad]: what lasts is in the state of the deck."""
EXACT = 1e-3
"""Deviation of an attitude that replaces a tilt altogether [rad]."""


@dataclass(frozen=True, slots=True, eq=False)
class Sight:
    """One image with what is known about its moment.

    Attributes:
        pixels: `(h, w)` uint8.
        time: middle of the exposure [s].
        enu_from_flu: the vehicle's attitude then `(3, 3)`; none when unknown.
        turning_flu: how it turns then; none when unknown.
    """

    pixels: Grey
    time: float
    enu_from_flu: Array | None
    turning_flu: Turning | None = None

    def without_attitude(self) -> Sight:
        """The image as a vehicle without attitude sees it."""
        return replace(self, enu_from_flu=None, turning_flu=None)


class LevelKnowledge:
    """Knows where the normal of one target should point in an image, and learns how the target really lies.

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
        self._deck = Deck()

    def knows(self, seen: Sight) -> bool:
        """Whether the attitude says anything about an image."""
        return seen.enu_from_flu is not None and self._mounting is not None

    def tilt(self, seen: Sight, pose: Pose) -> float | None:
        """Angle between the normal of a pose and the one expected [rad]; none where nothing is known."""
        expected = self._expected(seen)
        return None if expected is None else _between(pose.rotation[:, 2], expected)

    def lean(self, seen: Sight, pose: Pose) -> float:
        """Angle between the normal of a pose and the vertical, whatever was learned [rad]; 0 where nothing is known."""
        if seen.enu_from_flu is None or self._mounting is None:
            return 0.0
        return _between(pose.rotation[:, 2], (seen.enu_from_flu @ self._mounting.flu_from_cam)[2])

    def log_odds(self, seen: Sight, first: Pose, second: Pose) -> float:
        """How much likelier the attitude makes one pose than another [nats]; 0 where nothing is known."""
        near, far = self.tilt(seen, first), self.tilt(seen, second)
        return 0.0 if near is None or far is None else (far**2 - near**2) / (2.0 * self._sd(seen) ** 2)

    def surprise2(self, seen: Sight, pose: Pose) -> float:
        """Squared angle between both normals, over what pose and attitude leave; 0 where nothing is known."""
        tilt = self.tilt(seen, pose)
        spread = self._sd(seen) ** 2 + largest_variance(pose.covariance[3:, 3:])
        return 0.0 if tilt is None else tilt**2 / spread

    def gate(self, seen: Sight, pose: Pose) -> float:
        """Largest disagreement that is believed of a pose [rad]."""
        return self.hidden_gate(pose) + self._deck_sd(seen)

    def hidden_gate(self, pose: Pose) -> float:
        """The same for a partly hidden first pose, which cannot tell a tilted deck from a border that is covered."""
        spread = float(np.sqrt(largest_variance(pose.covariance[3:, 3:])))
        return self._gate + min(spread, self._limits.tilt_spread)

    def vertical(self, seen: Sight) -> Level | None:
        """The normal expected in camera axes, to hold a fit with; none where nothing is known."""
        expected = self._expected(seen)
        return None if expected is None or not self._limits.holds_tilt else Level(expected, self._sd(seen))

    def fuse(self, seen: Sight, pose: Pose) -> Pose:
        """The pose with what the attitude knows about its tilt."""
        expected = self._expected(seen)
        return pose if expected is None else fuse_normal(pose, expected, self._sd(seen))

    def forget(self) -> None:
        """Forget how the target lies."""
        self._deck = Deck()

    def learn(self, seen: Sight, pose: Pose, held: Level | None = None) -> None:
        """Take in how the target lies, as the image alone says it.

        Args:
            seen: the image.
            pose: measured in it.
            held: what the fit was told about the tilt; none where the image decided alone.
        """
        if seen.enu_from_flu is None or self._mounting is None:
            return
        normal, spread = pose.rotation[:, 2], pose.covariance[3:, 3:]
        if held is not None:
            turned, spread = normal_beside(pose, held.up, held.spread)
            normal = turn(pose.rotation, turned)[:, 2]
        enu_from_cam = seen.enu_from_flu @ self._mounting.flu_from_cam
        # A small turn w moves the normal n by w x n; its horizontal part is what the deck is known by.
        moved = -(enu_from_cam @ skew(normal))[:2]
        covariance = lasting_doubt(pose) * (moved @ spread @ moved.T) + self._spread**2 * np.eye(2)
        self._deck.measured(seen.time, seen.enu_from_flu, enu_from_cam @ normal, covariance, is_sure=held is None)

    def replace_tilt(self, seen: Sight, pose: Pose) -> Pose:
        """The pose with its tilt replaced by the attitude's; the place stays."""
        expected = self._expected(seen)
        if expected is None:
            return pose
        vague = replace(pose, covariance=np.eye(6))
        return replace(fuse_normal(vague, expected, EXACT), position=pose.position)

    def _expected(self, seen: Sight) -> Array | None:
        """The normal expected `(3,)`, camera axes; none where nothing is known."""
        if seen.enu_from_flu is None or self._mounting is None:
            return None
        expected: Array = (seen.enu_from_flu @ self._mounting.flu_from_cam).T @ self._deck.normal(seen.enu_from_flu)
        return expected

    def _sd(self, seen: Sight) -> float:
        """Deviation of the normal expected, each axis [rad]."""
        return float(np.hypot(min(self._spread, FAST), self._deck_sd(seen)))

    def _deck_sd(self, seen: Sight) -> float:
        """Deviation of how the target lies by the attitude of an image [rad]; the prior's without one."""
        return self._deck.sd(seen.time, seen.enu_from_flu) if seen.enu_from_flu is not None else PRIOR_SD


def _between(a: Array, b: Array) -> float:
    """Angle between two directions [rad]."""
    return float(np.arctan2(np.linalg.norm(skew(a) @ b), a @ b))
