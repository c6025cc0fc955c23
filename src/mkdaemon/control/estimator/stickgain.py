"""How much tilt a stick count asks for, over what the parameter set says: found in the first seconds of a flight.

The FlightCtrl makes the tilt that it believes, and reports, follow its sticks. So what it reports, over what the model
of its loop says that it should report after the sticks that were sent, is the gain; disturbances average out. The
boards report 0.89 to 1.13 of what they believe, so a gain that differs less than that from the model's is none.
Source: least squares with exponential forgetting, L. Ljung, "System Identification" (1999), section 11.2.
"""

from __future__ import annotations

import math
from collections import deque
from typing import Final

import numpy as np

from mkdaemon.control.estimator.model import AircraftModel
from mkdaemon.control.linear import Array, discretise

STEP: Final = 0.010
"""Grid of the response [s]."""
MEMORY: Final = 4.0
"""What is older counts less than a third [s]."""
REACH: Final = 0.3
"""How late an attitude may come [s]."""
LONGEST_GAP: Final = 1.0
"""After a longer silence of the boards only so much of it is computed [s]."""
LEAST_MOTION: Final = math.radians(1.0)
"""Mean tilt, as a root mean square over `MEMORY`, that says enough [rad]."""
LEAST_CHANGE: Final = math.log(1.25)
"""Gains closer to the model's than a factor of 1.25 are the model's: the boards' own scale is no better known."""
SETTLED: Final = 2.0
"""Before sticks have been sent for so long a gain must differ more [s]: a flight that begins in wind leans before the
estimate knows why."""
FIRST_CHANGE: Final = math.log(1.3)
"""See `SETTLED`."""
LIKELY: Final = (0.5, 2.0)
"""Gains that are believed."""


class StickGain:
    """One flight's stick gain.

    Attributes:
        measured: gain over the model's; 1 before there was enough to see.
    """

    def __init__(self, model: AircraftModel, now: float) -> None:
        """Begin at a moment [s; monotonic], level."""
        a, b = np.zeros((4, 4)), np.zeros((4, 1))  # believed tilt, its integral, its rate, filtered stick
        a[0, 0], a[0, 2] = -1.0 / model.leak, 1.0
        a[1, 0], a[1, 3] = 1.0, -1.0
        a[2] = np.array([-model.a1, -model.a2, -1.0, model.a1]) / model.rate_lag
        a[3, 3], b[3, 0] = -1.0 / model.stick_filter, 1.0 / model.stick_filter
        self._f, g = discretise(a, b, STEP)
        self._g = g[:, 0]
        self._state = np.zeros((2, 4))
        self._time = now
        self._expected: deque[tuple[float, Array]] = deque([(now, np.zeros(2))])
        self._commands: deque[tuple[float, Array]] = deque([(-math.inf, np.zeros(2))])
        self._keep = math.exp(-1.0 / MEMORY)
        self._product = self._square = 0.0
        self._measured_at = now
        self._first_at = math.inf
        self.measured = 1.0

    @property
    def gain(self) -> float:
        """What to fly with: the measured gain, or 1 where that may be the boards' scale."""
        least = LEAST_CHANGE if self._measured_at - self._first_at >= SETTLED else FIRST_CHANGE
        return 1.0 if abs(math.log(self.measured)) < least else self.measured

    def sent(self, acts_at: float, tilt: Array) -> None:
        """Take sticks and when they act [s]: pitch and roll (2,) as the model would have them [rad]."""
        self._first_at = min(self._first_at, acts_at)
        self._commands.append((acts_at, tilt))

    def attitude_received(self, at: float, tilt: Array) -> None:
        """Take what the boards reported of a moment [s]: pitch and roll (2,) [rad]."""
        self._advance(at)
        expected = next((value for time, value in reversed(self._expected) if time <= at), None)
        if expected is None:
            return
        keep = self._keep ** max(0.0, at - self._measured_at)
        step = min(max(0.0, at - self._measured_at), 0.1)
        self._measured_at = max(self._measured_at, at)
        self._product = keep * self._product + step * float(expected @ tilt)
        self._square = keep * self._square + step * float(expected @ expected)
        if self._square > LEAST_MOTION**2 * MEMORY:
            self.measured = min(max(self._product / self._square, LIKELY[0]), LIKELY[1])

    def _advance(self, until: float) -> None:
        self._time = max(self._time, until - LONGEST_GAP)
        while self._time + STEP <= until:
            while len(self._commands) > 1 and self._commands[1][0] <= self._time + STEP / 2.0:
                self._commands.popleft()
            drive = self._commands[0][1]
            self._state = self._state @ self._f.T + drive[:, None] * self._g
            self._time += STEP
            self._expected.append((self._time, self._state[:, 0].copy()))
        while len(self._expected) > 1 and self._expected[0][0] < until - REACH:
            self._expected.popleft()
