"""Whether the images believe the vehicle's attitude: it is left out while they contradict it, and taken up again.

An attitude with a swapped sign, a mounting that is off by many degrees or a target that is not level refuses every
right pose. What the images find by themselves, with the gates of a vehicle without attitude, decides.

Contradictions have to agree with each other. A swapped sign turns the target's normal one way in the world, a mounting
one way on the vehicle; the wobble of a vibration behind a rolling shutter turns it another way in every image, and has
the mean zero, however large it is.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from math import degrees
from typing import Final

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

LOOKS: Final = 10
"""Newest images that tell whether the attitude is right."""
FEWEST: Final = 3
"""Of them that contradict which leave it out: what lies over a target misleads neighbouring images alike.

A right attitude was contradicted in none of 2,500 images (development flights, half of them with something wrong).
"""
LEAST_SCATTER: Final = 1e-12
"""Of turns, squared [rad^2]."""
CHANCE: Final = 1e-4
"""Probability that turns which have nothing in common have so large a mean; of all beginnings one in a thousand."""
RECENT: Final = 3.0
"""Images older than this tell nothing about now [s]."""
BACK_LOOKS: Final = 15
"""Images in a row that agree, before it is taken up again."""
BACK_AFTER: Final = (1.0, 32.0)
"""And for so long [s]; twice as long after every time it was left out again, up to the second."""
FORGET: Final = 10.0
"""Without an image that tells for so long it is tried again [s]."""


@dataclass(frozen=True, slots=True, eq=False)
class _Look:
    """What one image says: when, whether against the attitude, how the normal is turned in both frames `(2, 2)`."""

    time: float
    contradicts: bool
    turned: Array


class AttitudeWitness:
    """Weighs images for and against the vehicle's attitude.

    Attributes:
        contradicts: whether the attitude is left out.
    """

    def __init__(self) -> None:
        self.contradicts = False
        self._looks: deque[_Look] = deque(maxlen=LOOKS)
        self._off: deque[float] = deque(maxlen=LOOKS)
        self._agreeing = 0
        self._agrees_since = self._newest = -np.inf
        self._back_after = BACK_AFTER[0]

    @property
    def off_deg(self) -> float:
        """By how much the attitude was off in images that contradicted it, median [deg]; 0 without any."""
        return degrees(float(np.median(self._off))) if self._off else 0.0

    def image_seen(self, time: float, turned_enu: Array, enu_from_flu: Array, gate: float) -> bool:
        """Take in an image that tells.

        Args:
            time: middle of its exposure [s].
            turned_enu: rotation vector from the target's normal by the attitude to that by the image `(3,)` [rad; ENU].
            enu_from_flu: the attitude then `(3, 3)`.
            gate: largest angle that is believed [rad].

        Returns:
            Whether the attitude is left out from this image on, and was not before.
        """
        off = float(np.linalg.norm(turned_enu))
        agrees = off <= gate
        if not agrees:
            self._off.append(off)
        self._newest = time
        if self.contradicts:
            self._agreeing = self._agreeing + 1 if agrees else 0
            if self._agreeing == 1:
                self._agrees_since = time
            if self._agreeing >= BACK_LOOKS and time - self._agrees_since >= self._back_after:
                self._back_after = min(2.0 * self._back_after, BACK_AFTER[1])
                self._believe()
            return False
        turned = np.stack([turned_enu[:2], (enu_from_flu.T @ turned_enu)[:2]])
        self._looks.append(_Look(time, not agrees, turned))
        recent = [look for look in self._looks if time - look.time < RECENT]
        # However long it was right before: the newest images alone may tell.
        self.contradicts = any(_agree(recent[k:]) for k in range(len(recent)))
        if self.contradicts:
            self._agreeing = 0
        return self.contradicts

    def time_passed(self, time: float) -> None:
        """Try the attitude again at a time [s] when no image has told anything about it for long."""
        if self.contradicts and not 0.0 <= time - self._newest < FORGET:
            self._believe()

    def _believe(self) -> None:
        self.contradicts = False
        self._looks.clear()
        self._off.clear()


def _agree(looks: list[_Look]) -> bool:
    """Whether images contradict, and their contradictions agree in the world or on the vehicle.

    Of n turns in two axes that have nothing in common, with the mean m and the sum q of the squared distances from it,
    F = n (n - 1) m^2 / q has Fisher's distribution with 2 and 2 (n - 1) degrees of freedom, and is beyond F with the
    probability (1 + F / (n - 1))^-(n - 1).
    """
    n = len(looks)
    if sum(look.contradicts for look in looks) < FEWEST:
        return False
    turned = np.array([look.turned for look in looks])
    mean = turned.mean(axis=0)
    scatter = np.maximum(((turned - mean) ** 2).sum(axis=(0, 2)), LEAST_SCATTER)
    chance = (1.0 + n * (mean**2).sum(axis=1) / scatter) ** -(n - 1.0)
    return bool(chance.min() < CHANCE)
