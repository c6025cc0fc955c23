"""The law of 2010: a PI on the offset of the tag in the newest image, at 15 Hz, straight to stick counts.

It knows nothing of delay, nor that the aircraft takes a tilt rate in the band of a position loop. It must lose the
aircraft: if it flies, the simulator lies. Source: docs/lab/control.md, "The law of 2010".
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mkdaemon.control.estimator.values import TargetView
from mkdaemon.control.limiter import StickCounts
from mkdaemon.control.linear import Array

PERIOD = 1 / 15
"""[s]."""


@dataclass(frozen=True, slots=True)
class PiGains:
    """Gains of the law.

    Attributes:
        p: [count/m].
        i: [count/(m s)].
        height_p: [count/m].
        height_i: [count/(m s)].
        hover: throttle it starts from [stick from the centre].
    """

    p: float = 14.0
    i: float = 2.0
    height_p: float = 8.0
    height_i: float = 2.0
    hover: float = -2.0


class PiLaw:
    """One flight with it."""

    def __init__(self, gains: PiGains, height: float) -> None:
        self._gains = gains
        self._height = height
        self._sum: Array = np.zeros(3)

    def sticks(self, view: TargetView, step: float) -> StickCounts:
        """Return sticks for the newest image, taken as if it were of now and the aircraft level."""
        gains = self._gains
        forward, left, up = view.position_flu
        error = np.array([forward, left, self._height + up])
        self._sum = np.clip(self._sum + error * step, -3.0, 3.0)
        level = gains.p * error[:2] + gains.i * self._sum[:2]
        throttle = gains.hover + gains.height_p * error[2] + gains.height_i * self._sum[2]
        pitch, left_down = np.clip(np.round(level), -40, 40)
        return StickCounts(int(pitch), -int(left_down), 0, int(np.clip(round(throttle), -60, 50)))
