"""Whether the images believe the vehicle's attitude: it is left out while they contradict it, and taken up again.

An attitude with a swapped sign, a mounting that is off by many degrees or a target that is not level refuses every
right pose. What the images find by themselves, with the gates of a vehicle without attitude, decides.
"""

from __future__ import annotations

from collections import deque
from math import degrees
from typing import Final

import numpy as np

LOOKS: Final = 10
"""Newest images that tell whether the attitude is right."""
AGAINST: Final = 6
"""Weight of those that contradict which leaves it out: an image that something lies over misleads for a moment.

A right attitude was contradicted in none of 2,500 images (development flights, half of them with something wrong).
"""
PARTLY, WHOLE = 2, 3
"""Weight of an image: three leave the attitude out, two where nearly all edges agree and it is far off."""
FAR: Final = 2.0
"""Angle over the largest one that is believed, from which it is: a deck tilted a little more than expected is not."""
RECENT: Final = 3.0
"""Images older than this tell nothing about now [s]."""
BACK_LOOKS: Final = 15
"""Images in a row that agree, before it is taken up again."""
BACK_AFTER: Final = (1.0, 32.0)
"""And for so long [s]; twice as long after every time it was left out again, up to the second."""
FORGET: Final = 10.0
"""Without an image that tells for so long it is tried again [s]."""


class AttitudeWitness:
    """Weighs images for and against the vehicle's attitude.

    Attributes:
        contradicts: whether the attitude is left out.
    """

    def __init__(self) -> None:
        self.contradicts = False
        self._looks: deque[tuple[float, int]] = deque(maxlen=LOOKS)
        self._off: deque[float] = deque(maxlen=LOOKS)
        self._agreeing = 0
        self._agrees_since = self._newest = -np.inf
        self._back_after = BACK_AFTER[0]

    @property
    def off_deg(self) -> float:
        """By how much the attitude was off in images that contradicted it, median [deg]; 0 without any."""
        return degrees(float(np.median(self._off))) if self._off else 0.0

    def image_seen(self, time: float, off: float, gate: float, *, is_whole: bool = False) -> bool:
        """Take in an image that tells.

        Args:
            time: middle of its exposure [s].
            off: angle between the target's normal by the image and by the attitude [rad].
            gate: largest angle that is believed [rad].
            is_whole: whether nearly all edges of the target agree.

        Returns:
            Whether the attitude is left out from this image on, and was not before.
        """
        agrees = off <= gate
        if not agrees:
            self._off.append(off)
        self._newest = time
        if self.contradicts:
            self._weigh_return(time, agrees)
            return False
        weight = WHOLE if is_whole and off > FAR * gate else PARTLY
        self._looks.append((time, 0 if agrees else weight))
        self.contradicts = sum(weight for then, weight in self._looks if time - then < RECENT) >= AGAINST
        if self.contradicts:
            self._agreeing = 0
        return self.contradicts

    def time_passed(self, time: float) -> None:
        """Try the attitude again at a time [s] when no image has told anything about it for long."""
        if self.contradicts and not 0.0 <= time - self._newest < FORGET:
            self._believe()

    def _weigh_return(self, time: float, agrees: bool) -> None:
        if not agrees:
            self._agreeing = 0
            return
        if self._agreeing == 0:
            self._agrees_since = time
        self._agreeing += 1
        if self._agreeing >= BACK_LOOKS and time - self._agrees_since >= self._back_after:
            self._back_after = min(2.0 * self._back_after, BACK_AFTER[1])
            self._believe()

    def _believe(self) -> None:
        self.contradicts = False
        self._looks.clear()
        self._off.clear()
