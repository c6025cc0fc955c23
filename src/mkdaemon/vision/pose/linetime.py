"""What is known of the line time of a camera: told by its file, or an unknown of every fit that images make known.

An image shows how far its rows are apart in motion, the product of motion and line time, and not either. So where
nobody told the line time T, fits reckon with a nominal one, T0, and with the motion m T / T0 in place of m. Before the
image is looked at that has the mean E[T] m / T0 and the variance (E[T^2] var(m) + var(T) m^2) / T0^2.

Where the motion is known besides (the attitude turns, the range changes) what an image alone says about m T / T0 is
linear in T: least squares over the images, each believed as far as it agrees with those before (a vibration that no
attitude knows turns the camera too).
"""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt
from typing import Final

import numpy as np

from mkdaemon.vision.arrays import Array
from mkdaemon.vision.limits import LIMITS

MOTIONS: Final = 4
"""Unknowns: angular rates [rad/s], then the speed along the axis [m/s]."""
LONGEST: Final = 60e-6
"""Line time of the slowest cameras [s]: 30 ms for 480 rows."""
NOMINAL: Final = LONGEST / 2.0
MOVING2: Final = 25.0
"""Squared deviations from rest from which a motion is one: at rest it is passed in one image of 20,000."""
HIDDEN: Final = 0.1
"""Share of the line time that an estimate is off by, however many images told it; chosen on three flights."""
PRIOR: Final = 3.0
"""Information before any image: an even chance from 0 to twice the nominal line time has the variance 1 / 3."""
RIDGE: Final = 1e-6
"""Information about a motion that no image shows [s^2/rad^2]."""
FEWEST: Final = 10
"""Images before the line time is believed to be none."""


@dataclass(frozen=True, slots=True, eq=False)
class KnownMotion:
    """What is known about the motion before the image is looked at.

    Attributes:
        expected: angular rate [rad/s] and speed along the axis [m/s] `(4,)`.
        spread: standard deviation of each `(4,)`.
    """

    expected: Array
    spread: Array


@dataclass(frozen=True, slots=True, eq=False)
class SeenMotion:
    """What one image says about the motion, with what was known before taken out again.

    Attributes:
        information: inverse of its covariance `(4, 4)`.
        pull: the information times the motion `(4,)`.
    """

    information: Array
    pull: Array


class Shutter:
    """The line time of one camera.

    Args:
        line_time: that its file tells [s]; none where it does not.
        reach_px: half of its rows times its focal length: what a turn by 1 rad/s moves in a line time of 1 s [px].

    Attributes:
        line_time: that fits reckon with [s]; 0 for a global shutter.
    """

    def __init__(self, line_time: float | None, reach_px: float = 0.0) -> None:
        self.line_time = NOMINAL if line_time is None else line_time
        self._reach_px = reach_px
        self._images = 0
        # Sums over images, in units of the nominal line time: information, and its product with the line time.
        self._known, self._agreed = 0.0, 0.0
        self._mean, self._variance = 1.0, 1.0 / PRIOR if line_time is None else 0.0

    @property
    def rolls(self) -> bool:
        """Whether rows are, or may be, exposed one after the other."""
        return self.line_time > 0.0

    @property
    def is_open(self) -> bool:
        """Whether images may still tell the line time."""
        return self.rolls and self._variance > 0.0

    @property
    def estimate(self) -> tuple[float, float]:
        """Line time and its deviation [s]."""
        return self._mean * self.line_time, sqrt(self._variance) * self.line_time

    @property
    def words(self) -> str:
        """What is known, for whoever reads an alarm."""
        if self._images < FEWEST:
            return f"unknown (0 to {1e6 * LONGEST:.0f} us) until a large target was seen in motion"
        line_time, sd = self.estimate
        return f"{1e6 * line_time:.0f} +- {1e6 * sd:.0f} us by {self._images} images"

    @property
    def scale(self) -> float:
        """Root mean square of the line time over the nominal one."""
        return sqrt(self._mean**2 + self._variance)

    def motion(self, known: KnownMotion) -> KnownMotion:
        """What is known of the motion times the line time over the nominal one."""
        spread = np.sqrt((self.scale * known.spread) ** 2 + self._variance * known.expected**2)
        return KnownMotion(self._mean * known.expected, spread)

    def learn(self, known: KnownMotion, seen: SeenMotion) -> None:
        """Take in an image.

        Args:
            known: of the motion, without the image.
            seen: by the image alone.
        """
        if not self.is_open or float(((known.expected / known.spread) ** 2).sum()) < MOVING2:
            return
        own = np.linalg.inv(seen.information + RIDGE * np.eye(MOTIONS))
        weight = np.linalg.inv(own + self.scale**2 * np.diag(known.spread**2))
        motion = own @ seen.pull
        surprise = motion - self._mean * known.expected
        weight /= max(1.0, float(surprise @ weight @ surprise) / MOTIONS)
        self._images += 1
        self._known += float(known.expected @ weight @ known.expected)
        self._agreed += float(known.expected @ weight @ motion)
        self._mean = max((PRIOR + self._agreed) / (PRIOR + self._known), 0.0)
        self._variance = 1.0 / (PRIOR + self._known) + (HIDDEN * self._mean) ** 2
        most = (self._mean + 2.0 * sqrt(self._variance)) * self.line_time * self._reach_px * LIMITS.edges.turning_sd
        if self._images >= FEWEST and most < LIMITS.edges.located_px:
            self.line_time = 0.0
