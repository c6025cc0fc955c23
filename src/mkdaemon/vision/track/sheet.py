"""How the print of one target bends, as images near it showed: a slow state, as its paper moves in wind and sun only.

An image far away cannot tell a bend from a tilt. What near ones told is carried on and forgotten slowly.
"""

from __future__ import annotations

from math import exp
from typing import Final

import numpy as np

from mkdaemon.vision.pose.bend import Bend
from mkdaemon.vision.pose.pose import Pose

MOVED: Final = 16.3
"""Squared distance of a bend from what was known of it, from which that was wrong: chi-square(3), one in 1000."""
LASTS: Final = 300.0
"""Correlation time of a bend [s]; chosen."""


class LearnedBend:
    """The bend of one print: a process that returns to what is known without any image within minutes."""

    def __init__(self, prior: Bend | None) -> None:
        self._prior = self._last = prior
        self._time = -np.inf

    def at(self, time: float) -> Bend | None:
        """What is known at a time; none for a target that does not bend."""
        if self._prior is None or self._last is None:
            return None
        kept = exp(-max(time - self._time, 0.0) / LASTS)
        mean = kept * self._last.mean + (1.0 - kept) * self._prior.mean
        return Bend(mean, kept**2 * self._last.covariance + (1.0 - kept**2) * self._prior.covariance)

    def learn(self, time: float, pose: Pose) -> None:
        """Take in what the edges of a published pose say; its fit asked with what was known here.

        Grey values of a target far away hardly tell a bend from a tilt, and the lens and light they leave unexplained
        are larger: learned from them as well, the bend was off by 2.7 deviations (three flights of a bent print, 298
        images), from edges alone by 1.1.
        """
        if pose.bend is None or pose.known_bend is None or pose.source != "edges":
            return
        surprise = pose.bend.mean - pose.known_bend.mean
        is_learned = self._last is not self._prior
        is_moved = is_learned and float(surprise @ pose.known_bend.information @ surprise) > MOVED
        # A sheet that moved, or was learned wrong, is learned anew; one that its file does not expect is learned, too.
        self._last, self._time = self._prior if is_moved else pose.bend, time
