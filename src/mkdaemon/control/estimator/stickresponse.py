"""How the aircraft answers its sticks, over what its model says: found in the first seconds of a flight.

The FlightCtrl makes the tilt that it believes, and reports, follow its sticks. What it reports is compared with what
the model of its loop says that it should report after the sticks that were sent, with the stick filter and without.
The filter whose response leaves less over is the aircraft's; the factor on that response is the stick gain. What
changes slowly is left out of both: wind and crooked accelerometers move the believed tilt too. The boards report 0.89
to 1.13 of what they believe, so a gain that differs less than that from the model's is none.

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
"""Grid of the responses [s]."""
MEMORY: Final = 4.0
"""What is older counts less than a third [s]."""
SLOW: Final = 0.7
"""What changes more slowly is left out [s]."""
REACH: Final = 0.3
"""How late an attitude may come [s]."""
LONGEST_GAP: Final = 1.0
"""After a longer silence of the boards only so much of it is computed [s]."""
LEAST_MOTION: Final = math.radians(1.0)
"""Mean tilt, as a root mean square over `MEMORY`, that says enough [rad]."""
LEAST_CHANGE: Final = math.log(1.25)
"""Gains closer to the model's than a factor of 1.25 are the model's: the boards' own scale is no better known."""
SETTLED: Final = 2.0
"""Before sticks have been sent for so long only a larger gain is believed, one that differs more [s]: an aircraft that
is handed over moves by sticks nobody here sent. A smaller gain that is not there doubles the sticks: in moderate wind 5
of 40 such flights left the target's sight within 2 s; a smaller one that is there only makes them soft."""
FIRST_CHANGE: Final = math.log(1.3)
"""See `SETTLED`."""
LIKELY: Final = (0.5, 2.0)
"""Gains that are believed."""
FILTER_SEEN: Final = 0.7
"""Before sticks have been sent for so long the filter is the model's [s]."""
CLEARLY: Final = 2.0
"""The other filter is believed when the one in use leaves this many times more over. In simulation it leaves 0.02 to
0.98 times as much when it is right, 2.3 to 50 when it is not; docs/control.md, "Estimator"."""


class StickResponse:
    """One flight's answer to its sticks.

    Attributes:
        measured: gain over the model's; 1 before there was enough to see.
        has_other_filter: the aircraft has a stick filter where the model has none, or none where the model has one.
    """

    def __init__(self, model: AircraftModel, now: float) -> None:
        """Begin at a moment [s; monotonic], level."""
        responses = [_response(candidate) for candidate in (model, model.with_other_filter())]
        self._f = np.array([f.T for f, _ in responses])
        self._g = np.array([g for _, g in responses])[:, None, :]
        self._state = np.zeros((2, 2, 4))  # filter, axis, state
        self._time = now
        self._expected: deque[tuple[float, Array]] = deque([(now, np.zeros((2, 2)))])
        self._commands: deque[tuple[float, Array]] = deque([(-math.inf, np.zeros(2))])
        self._keep = math.exp(-1.0 / MEMORY)
        self._slow: Array | None = None  # of both responses and of what is reported, by axis (3, 2)
        self._squares, self._products, self._reported = np.zeros(2), np.zeros(2), 0.0
        self._measured_at = now
        self._first_at = math.inf
        self.measured = 1.0
        self.has_other_filter = False

    @property
    def gain(self) -> float:
        """What to fly with: the measured gain, or 1 where that may be the boards' scale."""
        change = math.log(self.measured)
        if self._measured_at - self._first_at < SETTLED:
            return self.measured if change >= FIRST_CHANGE else 1.0
        return self.measured if abs(change) >= LEAST_CHANGE else 1.0

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
        passed = max(0.0, at - self._measured_at)
        keep, step = self._keep**passed, min(passed, 0.1)
        self._measured_at = max(self._measured_at, at)
        signals = np.array([*expected, tilt])
        slow = signals if self._slow is None else self._slow
        slow = self._slow = slow + (signals - slow) * (1.0 - math.exp(-passed / SLOW))
        first, second, seen = signals - slow
        self._squares = keep * self._squares + step * np.array([first @ first, second @ second])
        self._products = keep * self._products + step * np.array([first @ seen, second @ seen])
        self._reported = keep * self._reported + step * float(seen @ seen)
        self._judge()

    def _judge(self) -> None:
        """Choose the filter, and take its gain."""
        chosen = int(self.has_other_filter)
        if self._squares.min() <= LEAST_MOTION**2 * MEMORY:
            return
        if self._measured_at - self._first_at >= FILTER_SEEN:
            left = self._reported - self._products**2 / self._squares
            if left[chosen] > CLEARLY * max(left[1 - chosen], 0.0):
                self.has_other_filter, chosen = not self.has_other_filter, 1 - chosen
        gain = float(self._products[chosen] / self._squares[chosen])
        self.measured = min(max(gain, LIKELY[0]), LIKELY[1])

    def _advance(self, until: float) -> None:
        self._time = max(self._time, until - LONGEST_GAP)
        while self._time + STEP <= until:
            while len(self._commands) > 1 and self._commands[1][0] <= self._time + STEP / 2.0:
                self._commands.popleft()
            drive = self._commands[0][1]
            self._state = self._state @ self._f + drive[:, None] * self._g
            self._time += STEP
            self._expected.append((self._time, self._state[:, :, 0].copy()))
        while len(self._expected) > 1 and self._expected[0][0] < until - REACH:
            self._expected.popleft()


def _response(model: AircraftModel) -> tuple[Array, Array]:
    """Transition (4, 4) and input (4,) over `STEP` of believed tilt, its integral, its rate and the filtered stick."""
    a, b = np.zeros((4, 4)), np.zeros((4, 1))
    a[0, 0], a[0, 2] = -1.0 / model.leak, 1.0
    a[1, 0], a[1, 3] = 1.0, -1.0
    a[2] = np.array([-model.a1, -model.a2, -1.0, model.a1]) / model.rate_lag
    a[3, 3], b[3, 0] = -1.0 / model.stick_filter, 1.0 / model.stick_filter
    f, g = discretise(a, b, STEP)
    return f, g[:, 0]
