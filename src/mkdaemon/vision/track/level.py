"""What the vehicle's attitude says about a pose: over a level target, the target's normal is nearly the vertical.

How a target that should lie level really lies, and how the vehicle's attitude is off: two slow pairs of angles.

A deck that is tilted lies so in the world; an attitude that is biased, or a mounting, is off in the vehicle. An image
measures their sum, the target's normal by the attitude. While the vehicle's heading stays, one number would do; when it
turns, the bias turns with it and the deck does not: taken for a deck, a bias of 5 degrees moves by 5 degrees in every
radian of heading. Poses that were found without this knowledge measure the sum; between them both drift.

How fast a deck drifts nobody knows before: a pad on the ground stays as it lies, a ship's deck rocks. An image of a far
target hardly tells a tilt; over a deck that rested while it was seen better, what was learned then still counts. And an
attitude may be wrong altogether, by a swapped sign, a mounting that is off by many degrees or a target that is not
level at all, or be shaken, another one in every image. All four are followed, each as likely as its predictions make
it. An attitude that is likelier wrong is left out, until it is likelier right: one threshold in odds.

Source: interacting multiple models, Blom and Bar-Shalom, IEEE TAC 33(8), 1988.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import degrees, exp, hypot, log, pi, radians, sqrt
from typing import Final

import numpy as np

from mkdaemon.config.vision import TrackerSection
from mkdaemon.vision.arrays import Array
from mkdaemon.vision.limits import LIMITS
from mkdaemon.vision.pose.pose import Pose, largest_variance
from mkdaemon.vision.pose.rolling import skew
from mkdaemon.vision.pose.unknowns import Level
from mkdaemon.vision.track.attitude import Mounting, Sight, angle_of, fuse_normal
from mkdaemon.vision.track.branches import lasting_doubt

PRIOR_SD: Final = radians(2.5)
"""Deviation of the normal from the vertical before an image measured it, each axis [rad]: half of its variance the
deck's, half the attitude's.

Over a deck tilted by 5 degrees 1 degree gave 2 wrong poses of 340, 2 and 3 degrees none; with 4 degrees 3 of 42 first
poses far away lose their certainty.
"""
DECKS, WRONG = slice(2), 2
"""Kinds: a deck that rests, one that rocks; an attitude that is wrong, one that is shaken."""
EXPECTED: Final = np.array([0.4745, 0.4745, 0.05, 0.001])
"""Probability of each kind before an image was seen, and of each that follows another one."""
SPREADS: Final = np.array([PRIOR_SD / sqrt(2.0), PRIOR_SD / sqrt(2.0), radians(15.0), PRIOR_SD / sqrt(2.0)])
"""Deviation of a deck's normal, and of the attitude's error, before an image was seen, each axis [rad]."""
DRIFTS: Final = np.radians([[0.1, 0.1, 0.25, 0.25], [2.0, 2.0, 0.25, 0.25], [6.0] * 4, [0.1, 0.1, 0.25, 0.25]])
"""Random walk of deck and error [rad/sqrt(s)]. A deck that rocks by 4 degrees in 4 s was lost for 40 images by 0.5
degrees; a swapped sign turns with the vehicle."""
NOISES: Final = np.radians([0.0, 0.0, 0.0, 5.0])
"""Of a shaken attitude, each axis [rad]: the wobble of a vibration behind a rolling shutter has the mean zero.

Of 420 drawn wobbles of 1.5 to 13 degrees, 75 images each, 5 were taken for a wrong attitude.
"""
ANEW: Final = 10.0
"""Mean time after which any kind may follow [s]; a deck that rests or rocks goes on for twice as long."""
MISSED: Final = 0.01 / (2.0 * pi * radians(20.0) ** 2)
"""Density of the normal of a wrong fit, one of a hundred, spread over 20 degrees [1/rad^2]."""
LEAST_WEIGHT: Final = 1e-12
"""Of a kind that the images contradict."""
UP: Final = np.array([0.0, 0.0, 1.0])
MOST_LEAN: Final = 4.0 * PRIOR_SD
"""Of a level target by a right attitude [rad]."""
LONGEST: Final = 10.0
"""Time without a measurement after which only the prior is known [s]."""


@dataclass(frozen=True, slots=True, eq=False)
class _Belief:
    """What is known by each kind.

    Attributes:
        weight: probability of each `(4,)`.
        mean: `(4, 4)`: horizontal part of the deck's normal, east and north, and error of the attitude about the
            vehicle's axes, roll and pitch [rad].
        covariance: of `mean` `(4, 4, 4)` [rad^2].
    """

    weight: Array
    mean: Array
    covariance: Array

    @property
    def wrong_odds(self) -> float:
        """Log odds of a wrong attitude against all else."""
        return log(self.weight[WRONG] / (self.weight.sum() - self.weight[WRONG]))

    def expected(self, observe: Array) -> Array:
        """What is observed, in the mean over both decks."""
        mean: Array = observe @ (self.weight[DECKS] @ self.mean[DECKS]) / self.weight[DECKS].sum()
        return mean

    def mixture(self, observe: Array) -> tuple[Array, Array]:
        """Mean m and covariance of what is observed over both decks: sum(w P) + sum(w m_i m_i^T) - m m^T."""
        weight, mean = self.weight[DECKS] / self.weight[DECKS].sum(), self.expected(observe)
        seen = self.mean[DECKS] @ observe.T
        spread = observe @ (weight @ self.covariance[DECKS].reshape(2, 16)).reshape(4, 4) @ observe.T
        return mean, spread + (weight[:, None] * seen).T @ seen - mean[:, None] * mean

    def later(self, passed: float) -> _Belief:
        """The same after some time [s]: another kind may have followed, and all drifts.

        A deck begins to rock, or to rest, where it lay; an attitude goes wrong by anything.
        """
        stays = exp(-passed / ANEW)
        anew = (1.0 - stays) * EXPECTED
        joint = np.diag(stays * self.weight)
        joint[DECKS, DECKS] += anew[DECKS, None] * self.weight[DECKS]
        new = np.zeros(4)
        new[WRONG] = anew[WRONG]
        whole = joint.sum(axis=1) + new
        joint, new = joint / whole[:, None], new / whole
        mean = joint @ self.mean
        second = joint @ (self.covariance + self.mean[:, :, None] * self.mean[:, None]).reshape(4, 16)
        second += np.outer(new, PRIOR.covariance[WRONG])
        spread = second.reshape(4, 4, 4) - mean[:, :, None] * mean[:, None]
        return _Belief(stays * self.weight + anew, mean, spread + (DRIFTS**2 * passed)[:, None] * np.eye(4))

    def corrected(self, observe: Array, measured: Array, covariance: Array, *, may_be_deck: bool) -> _Belief:
        """Kalman updates, each weight times the density of its surprise, exp(-y^T S^-1 y / 2) / (2 pi sqrt(det S)).

        A kind that expects it less than a wrong fit has missed it, and learns nothing.
        """
        surprise = (measured - self.mean @ observe.T)[:, :, None]
        across = self.covariance @ observe.T
        inverse = np.linalg.inv(observe @ across + covariance + (NOISES**2)[:, None, None] * np.eye(2))
        distance2 = (surprise.transpose(0, 2, 1) @ inverse @ surprise).ravel()
        density = np.exp(-distance2 / 2.0) * np.sqrt(np.linalg.det(inverse)) / (2.0 * pi)
        if not may_be_deck:
            density[DECKS] = 0.0
        gain = across @ inverse * (density > MISSED)[:, None, None]
        kept = self.covariance - gain @ across.transpose(0, 2, 1)
        weight = np.maximum(density, MISSED) * self.weight
        weight = np.maximum(weight / weight.sum(), LEAST_WEIGHT)
        return _Belief(weight, self.mean + (gain @ surprise)[:, :, 0], (kept + kept.transpose(0, 2, 1)) / 2.0)


PRIOR: Final = _Belief(EXPECTED, np.zeros((4, 4)), (SPREADS**2)[:, None, None] * np.eye(4))
"""Before anything was measured."""


def _observe(enu_from_flu: Array) -> Array:
    """How deck and bias move the normal that an attitude makes of an image `(2, 4)`.

    A small turn b of the vehicle moves a vertical normal by (R b) x up = (b'_north, -b'_east), b' = R b.
    """
    (east, by_east), (north, by_north) = enu_from_flu[:2, :2].tolist()
    return np.array([[1.0, 0.0, north, by_north], [0.0, 1.0, -east, -by_east]])


class Deck:
    """The normal of one target in the world, near the vertical, as the vehicle's attitude shows it, or as none can.

    For small tilts the horizontal part of a normal is the tilt [rad].

    Attributes:
        is_contradicted: whether the attitude is left out, as what images measure makes a wrong one likelier.
        off_deg: by how much it was off in the newest image that measured it [deg].
    """

    def __init__(self) -> None:
        self._belief = PRIOR
        self._time = -np.inf
        self._asked = (-np.inf, PRIOR)
        self.is_contradicted = False
        self.off_deg = 0.0

    def normal(self, enu_from_flu: Array) -> Array:
        """The normal expected by an attitude `(3, 3)`: `(3,)`, ENU, length 1."""
        east, north = self._belief.expected(_observe(enu_from_flu)).tolist()
        return np.array([east, north, sqrt(max(1.0 - east**2 - north**2, 0.0))])

    def sd(self, time: float, enu_from_flu: Array) -> float:
        """Deviation of that normal at a time, along its worse axis [rad]; at most the prior's."""
        _, spread = self._at(time).mixture(_observe(enu_from_flu))
        (east, both), (_, north) = spread.tolist()
        # The larger eigenvalue of a symmetric matrix of two rows.
        variance = (east + north) / 2.0 + hypot((east - north) / 2.0, both)
        return min(sqrt(variance), PRIOR_SD)

    def measured(self, time: float, enu_from_flu: Array, normal: Array, covariance: Array) -> None:
        """Take in a normal that an image measured.

        Args:
            time: of the image [s].
            enu_from_flu: the attitude then `(3, 3)`.
            normal: by that attitude `(3,)`, ENU.
            covariance: of its horizontal part with the attitude's `(2, 2)` [rad^2].
        """
        self.time_passed(time)
        leans = angle_of(normal, UP) > MOST_LEAN
        self.off_deg = degrees(angle_of(normal, self.normal(enu_from_flu)))
        self._belief = self._at(time).corrected(_observe(enu_from_flu), normal[:2], covariance, may_be_deck=not leans)
        self._time, self._asked = time, (-np.inf, PRIOR)
        odds = self._belief.wrong_odds
        if abs(odds) >= LIMITS.ambiguity.decided:
            self.is_contradicted = odds > 0.0

    def time_passed(self, time: float) -> None:
        """Try an attitude again at a time [s] about which no image has told anything for long."""
        self.is_contradicted = self.is_contradicted and 0.0 <= time - self._time <= LONGEST

    def _at(self, time: float) -> _Belief:
        """What is known at a time, before anything is measured then."""
        if time != self._asked[0]:
            passed = time - self._time
            self._asked = time, self._belief.later(passed) if 0.0 <= passed <= LONGEST else PRIOR
        return self._asked[1]


FAST = radians(0.5)
"""Deviation of an attitude from one image to the next, each axis [rad]: what lasts is in the state of the deck."""


class LevelKnowledge:
    """Knows where the normal of one target should point in an image, and learns how the target really lies.

    Args:
        is_level: whether the target lies level; the attitude says nothing about others.
        mounting: of the camera; none when unknown, and then the attitude says nothing.
        cfg: how well the attitude is known.
    """

    def __init__(self, is_level: bool, mounting: Mounting | None, cfg: TrackerSection) -> None:
        self._mounting = mounting if is_level else None
        self._spread = float(np.radians(cfg.attitude_sd_deg))
        self._gate = float(np.radians(cfg.attitude_gate_deg))
        self._deck = Deck()

    def knows(self, seen: Sight) -> bool:
        """Whether the attitude says anything about an image."""
        return seen.enu_from_flu is not None and self._mounting is not None

    def tilt(self, seen: Sight, pose: Pose) -> float | None:
        """Angle between the normal of a pose and the one expected [rad]; none where nothing is known."""
        level = self.vertical(seen)
        return None if level is None else angle_of(pose.rotation[:, 2], level.up)

    def sight(self, seen: Sight) -> Sight:
        """The image with its attitude; without, while images contradict it."""
        self._deck.time_passed(seen.time)
        return seen.without_attitude() if self._deck.is_contradicted else seen

    @property
    def contradicted_deg(self) -> float | None:
        """By how much images contradict the attitude [deg]; none while they do not."""
        return self._deck.off_deg if self._deck.is_contradicted else None

    def gate(self, seen: Sight, pose: Pose) -> float:
        """Largest disagreement that is believed of a pose [rad]."""
        return self.hidden_gate(pose) + self._deck_sd(seen)

    def hidden_gate(self, pose: Pose) -> float:
        """The same for a partly hidden first pose, which cannot tell a tilted deck from a border that is covered."""
        spread = float(np.sqrt(largest_variance(pose.covariance[3:, 3:])))
        return self._gate + min(spread, LIMITS.certainty.wrong_angle / LIMITS.certainty.deviations)

    def vertical(self, seen: Sight) -> Level | None:
        """The normal expected in camera axes, with its deviation; none where nothing is known."""
        if seen.enu_from_flu is None or self._mounting is None:
            return None
        expected = (seen.enu_from_flu @ self._mounting.flu_from_cam).T @ self._deck.normal(seen.enu_from_flu)
        return Level(expected, hypot(min(self._spread, FAST), self._deck_sd(seen)))

    def fuse(self, seen: Sight, pose: Pose) -> Pose:
        """The pose with what the attitude knows about its tilt."""
        level = self.vertical(seen)
        return pose if level is None else fuse_normal(pose, level.up, level.spread)

    def forget(self) -> None:
        """Forget how the target lies."""
        self._deck = Deck()

    def learn(self, seen: Sight, pose: Pose) -> bool:
        """Take in how the target lies, by a pose that the image alone decided.

        Returns:
            Whether the attitude is left out from this image on, and was not before.
        """
        if seen.enu_from_flu is None or self._mounting is None:
            return False
        normal, spread = pose.rotation[:, 2], pose.covariance[3:, 3:]
        enu_from_cam = seen.enu_from_flu @ self._mounting.flu_from_cam
        # A small turn w moves the normal n by w x n; its horizontal part is what the deck is known by.
        moved = -(enu_from_cam @ skew(normal))[:2]
        covariance = lasting_doubt(pose) * (moved @ spread @ moved.T) + self._spread**2 * np.eye(2)
        before = self._deck.is_contradicted
        self._deck.measured(seen.time, seen.enu_from_flu, enu_from_cam @ normal, covariance)
        return self._deck.is_contradicted and not before

    def _deck_sd(self, seen: Sight) -> float:
        """Deviation of how the target lies by the attitude of an image [rad]; the prior's without one."""
        return self._deck.sd(seen.time, seen.enu_from_flu) if seen.enu_from_flu is not None else PRIOR_SD
