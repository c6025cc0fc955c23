"""Estimates stick gain, stick filter and delay of the aircraft in the first seconds of a flight.

The FlightCtrl controls the tilt that it estimates and reports. The reported tilt is compared with the one that the
model predicts from the sticks sent. A bank of hypotheses has the stick filter on and off, each with the estimated delay
of the line, and with 30 ms less to 60 ms more. For each hypothesis, least squares gives the stick gain. Slow changes
are removed by a high-pass filter, because wind and accelerometer errors also move the reported tilt. The boards report
0.89 to 1.13 of their tilt, so a smaller difference of the gain is ignored.

A delay and a filter have similar effects; both have a prior, the delay from the line's measurement before the flight.
The noise is unknown and estimated too: the likelihood of a hypothesis depends on the ratio of its residual to the
smallest residual.

Source: least squares with exponential forgetting, L. Ljung, "System Identification" (1999), section 11.2; likelihood of
a linear model with unknown noise, A. Gelman et al., "Bayesian Data Analysis" (2013), section 14.2.
"""

from __future__ import annotations

import math
from collections import deque
from typing import Final

import numpy as np

from mkdaemon.control.estimator.model import AircraftModel
from mkdaemon.control.linear import Array, discretise

STEP: Final = 0.010
"""Grid of the responses, and of the delays [s]."""
_LAG_STEPS: Final = np.arange(-3, 7)
LAGS: Final = _LAG_STEPS * STEP
"""Delays of sticks and reports together, relative to the line's estimated delay [s]."""
MEMORY: Final = 4.0
"""Older samples weigh less than 1/e [s]."""
SLOW: Final = 0.7
"""Slower changes are removed [s]."""
REACH: Final = 0.3
"""How late an attitude may come [s]."""
LONGEST_GAP: Final = 1.0
"""After a longer silence of the boards, only this much of it is computed [s]."""
LEAST_MOTION: Final = math.radians(1.0)
"""Mean tilt, as a root mean square over `MEMORY`, that says enough of filter and gain [rad]."""
LEAST_LEFT: Final = math.radians(0.15)
"""What any hypothesis leaves over [rad]: gusts, and the tenth of a degree in which boards report."""
LEAST_CHANGE: Final = math.log(1.25)
"""Gains closer to the model's than a factor of 1.25 are the model's: the boards' own scale is no better known."""
SETTLED: Final = 2.0
"""During this time after the first stick frame, only a larger gain is accepted, beyond `FIRST_CHANGE` [s]: after a
handover the aircraft still moves by the pilot's sticks. A wrongly small gain doubles our sticks: in moderate wind 5 of
40 such flights lost sight of the target within 2 s. A small gain that is missed only makes the control soft."""
FIRST_CHANGE: Final = math.log(1.3)
"""See `SETTLED`."""
LASTS: Final = 1.0
"""A smaller gain is accepted after motion has shown it for this time [s]; a larger one at once. In the first quarter of
a second of a step, late frames looked like a gain of 0.74 with 13 nat (genuine firmware, radio)."""
LIKELY: Final = (0.5, 2.0)
"""Least and largest accepted gain."""
FILTER_SEEN: Final = 0.7
"""During this time after the first stick frame, filter and delay keep their values from before the flight [s]."""
INDEPENDENT: Final = 10.0
"""Independent residuals of both axes a second: what is left over stays for some 0.2 s."""
GAIN_CLEARLY: Final = 4.0
"""Log-likelihood ratio against the model's gain from which a gain is accepted [nat]: lost stick frames look like half
an answer, which no gain explains."""
CLEARLY: Final = 6.0
"""Log-likelihood ratio from which the other filter is accepted [nat]: half the residual for 1.7 s."""


class StickResponse:
    """One flight's answer to its sticks.

    Attributes:
        measured: gain over the model's; 1 before there was enough to see.
        has_other_filter: the aircraft has a stick filter where the model has none, or none where the model has one.
        lag: delay of sticks and reports together, relative to the line's estimated delay [s].
    """

    def __init__(self, model: AircraftModel, now: float) -> None:
        """Begin at a moment [s; monotonic], level."""
        responses = [tilt_response(candidate) for candidate in (model, model.with_other_filter())]
        self._f = np.array([f.T for f, _ in responses])
        self._g = np.array([g for _, g in responses])[:, None, :]
        self._state = np.zeros((2, 2, 4))  # filter, axis, state
        self._time = now
        self._expected = np.zeros((round(REACH / STEP) + len(LAGS), 2, 2))  # newest last: time, filter, axis
        self._commands: deque[tuple[float, Array]] = deque([(-math.inf, np.zeros(2))])
        self._reports: deque[tuple[float, Array]] = deque()
        self._keep = math.exp(-1.0 / MEMORY)
        self._slow: Array | None = None  # of what every hypothesis expects and of what is reported, by axis
        self._squares, self._products = np.zeros((2, len(LAGS))), np.zeros((2, len(LAGS)))
        self._reported = self._seen = 0.0
        self._prior = -0.5 * (LAGS / model.line_sd) ** 2
        self._measured_at = now
        self._first_at = math.inf
        self._is_clear = False
        self._smaller_for = 0.0
        self.measured = 1.0
        self.has_other_filter = False
        self.lag = 0.0

    @property
    def gain(self) -> float:
        """Gain for the flight: the measured one, or 1 if the boards' scale may explain it, or the evidence is weak."""
        change = math.log(self.measured)
        if not self._is_clear:
            return 1.0
        if self._measured_at - self._first_at < SETTLED:
            return self.measured if change >= FIRST_CHANGE else 1.0
        if change < 0.0:
            return self.measured if self._smaller_for >= LASTS else 1.0
        return self.measured if change >= LEAST_CHANGE else 1.0

    def sent(self, acts_at: float, tilt: Array) -> None:
        """Take sticks, and when they act by the line's estimated delay: pitch and roll (2,), by the model [rad]."""
        self._first_at = min(self._first_at, acts_at)
        self._commands.append((acts_at, tilt))
        self._advance(acts_at - REACH + LAGS[0])  # of no earlier moment is asked: a silence leaves nothing to catch up

    def attitude_received(self, at: float, tilt: Array) -> None:
        """Take a reported tilt and its time by the line's estimated delay: pitch and roll (2,) [rad].

        It is compared when all sticks that act as much later as the line may be faster are known.
        """
        self._reports.append((at, tilt))
        self._advance(at)
        while self._reports and self._reports[0][0] <= at + LAGS[0]:
            self._compare(*self._reports.popleft())

    def _compare(self, at: float, tilt: Array) -> None:
        """Compare a report with what every hypothesis expects."""
        # The expectation of each lag at the report's time, interpolated on the grid.
        newest = (at - self._time) / STEP + len(self._expected) - 1  # place of the moment itself
        first = math.floor(newest)
        place = first - _LAG_STEPS
        if place[-1] < 0 or place[0] + 1 > len(self._expected):
            return
        later = np.minimum(place + 1, len(self._expected) - 1)
        share = newest - first
        expected = (1.0 - share) * self._expected[place] + share * self._expected[later]  # lag, filter, axis
        passed = max(0.0, at - self._measured_at)
        keep, step = self._keep**passed, min(passed, 0.1)
        self._measured_at = max(self._measured_at, at)
        # High-pass, the same for expectations x and report y: y - (low-pass of time constant SLOW).
        signals = np.concatenate([expected.transpose(1, 0, 2).reshape(-1, 2), tilt[None]])
        slow = signals if self._slow is None else self._slow
        slow = self._slow = slow + (signals - slow) * (1.0 - math.exp(-passed / SLOW))
        fast = signals - slow
        moved, seen = fast[:-1].reshape(2, len(LAGS), 2), fast[-1]
        # Sums with exponential forgetting, of both axes: Sxx, Sxy (filter, lag), Syy and the time they cover.
        self._squares = keep * self._squares + step * (moved**2).sum(axis=2)
        self._products = keep * self._products + step * (moved @ seen)
        self._reported = keep * self._reported + step * float(seen @ seen)
        self._seen = keep * self._seen + step
        if self._measured_at - self._first_at >= FILTER_SEEN:
            self._judge()
        self._take_gain(step)

    def _judge(self) -> None:
        """Choose the filter, and weigh the delays."""
        # With the best gain a hypothesis leaves Syy - Sxy^2 / Sxx. The noise is unknown, so its log-likelihood is
        # -(n / 2) ln(residual), with n independent residuals; plus the prior of the lag. Source: Gelman, as above.
        fitted = np.maximum(self._products, 0.0) ** 2 / np.maximum(self._squares, 1e-12)
        left = np.maximum(self._reported - fitted, 0.0) + LEAST_LEFT**2 * max(self._seen, STEP)
        likelihood = -0.5 * INDEPENDENT * self._seen * np.log(left) + self._prior
        best = likelihood.max(axis=1)
        chosen = int(self.has_other_filter)
        if self._is_moving and best[1 - chosen] - best[chosen] > CLEARLY:
            self.has_other_filter, chosen = not self.has_other_filter, 1 - chosen
        # The lag is the posterior mean over the bank of the chosen filter.
        weights = np.exp(likelihood[chosen] - best[chosen])
        self.lag = float(weights @ LAGS / weights.sum())

    @property
    def _is_moving(self) -> bool:
        return bool(self._squares.min() > LEAST_MOTION**2 * MEMORY)

    def _take_gain(self, passed: float) -> None:
        """Measure the gain, after some time of motion [s]."""
        if self._is_moving:
            chosen = int(self.has_other_filter), int(np.abs(LAGS - self.lag).argmin())
            squares, products = float(self._squares[chosen]), float(self._products[chosen])
            # Least squares: g = Sxy / Sxx. It must beat the model's gain 1 by the likelihood ratio of both residuals,
            # (n / 2) ln(residual(1) / residual(g)), where residual(g) = Syy - 2 g Sxy + g^2 Sxx.
            gain = min(max(products / squares, LIKELY[0]), LIKELY[1])
            least, as_model = (
                self._reported - 2.0 * factor * products + factor**2 * squares + LEAST_LEFT**2 * self._seen
                for factor in (gain, 1.0)
            )
            self.measured = gain
            self._is_clear = 0.5 * INDEPENDENT * self._seen * math.log(as_model / least) > GAIN_CLEARLY
            is_smaller = self._is_clear and math.log(gain) <= -LEAST_CHANGE
            self._smaller_for = self._smaller_for + passed if is_smaller else 0.0

    def _advance(self, until: float) -> None:
        self._time = max(self._time, until - LONGEST_GAP)
        while self._time + STEP <= until:
            while len(self._commands) > 1 and self._commands[1][0] <= self._time + STEP / 2.0:
                self._commands.popleft()
            drive = self._commands[0][1]
            self._state = np.matmul(self._state, self._f) + drive[:, None] * self._g
            self._time += STEP
            self._expected[:-1] = self._expected[1:]
            self._expected[-1] = self._state[:, :, 0]


def tilt_response(model: AircraftModel) -> tuple[Array, Array]:
    """Transition (4, 4) and input (4,) over `STEP` of the FlightCtrl's tilt, integral, rate and filtered stick."""
    a, b = np.zeros((4, 4)), np.zeros((4, 1))
    a[0, 0], a[0, 2] = -1.0 / model.leak, 1.0
    a[1, 0], a[1, 3] = 1.0, -1.0
    a[2] = np.array([-model.a1, -model.a2, -1.0, model.a1]) / model.rate_lag
    a[3, 3], b[3, 0] = -1.0 / model.stick_filter, 1.0 / model.stick_filter
    f, g = discretise(a, b, STEP)
    return f, g[:, 0]
