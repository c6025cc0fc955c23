"""The law of 2010: a PI on the offset of the tag in the newest image, at 15 Hz, straight to stick counts.

It knows nothing of delay, nor that the aircraft takes a tilt rate in the band of a position loop. It must lose the
aircraft: if it flies, the simulator lies. Source: docs/lab/control.md, "The law of 2010".
"""

from __future__ import annotations

from typing import Final

import numpy as np

from lab.control.flights import Flight
from lab.control.rig import Rig
from mkdaemon.control.estimator.values import TargetView
from mkdaemon.control.limiter import StickCounts
from mkdaemon.control.linear import Array
from mkdaemon.control.regulator.autopilot import at_origin

PERIOD: Final = 1 / 15
"""[s]."""
GAINS: Final = np.array([14.0, 14.0, 8.0])
"""Of the offset: forward, left and height [count/m]."""
SLOW_GAIN: Final = 2.0
"""Of its sum [count/(m s)]."""
HOVER: Final = -2.0
"""Throttle it starts from [stick from the centre]."""
HEIGHT: Final = 2.0
"""Flown [m]."""


class LawRig(Rig):
    """One flight with it."""

    def __init__(self, flight: Flight) -> None:
        super().__init__(flight)
        self._sum: Array = np.zeros(3)

    def _control(self, at: float) -> None:
        """The images alone decide."""

    def _see(self, view: TargetView, at: float) -> None:
        """Take the newest image as if it were of now and the aircraft level, at most every 1/15 s."""
        if self.record.times and at - self.record.times[-1] < PERIOD:
            return
        forward, left, up = view.position_flu
        error = np.array([forward, left, HEIGHT + up])
        self._sum = np.clip(self._sum + error * PERIOD, -3.0, 3.0)
        pitch, left_down, throttle = np.round(GAINS * error + SLOW_GAIN * self._sum + (0.0, 0.0, HOVER))
        level = np.clip((pitch, left_down), -40, 40).astype(int)
        self._send(StickCounts(int(level[0]), -int(level[1]), 0, int(np.clip(throttle, -60, 50))), at)
        self._keep(at_origin(HEIGHT), at)
