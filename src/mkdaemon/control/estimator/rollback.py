"""A Kalman filter on a fixed grid that takes measurements of the past: it goes back, adds them, comes forward again.

Several equal axes are carried together, each with its own state. A measurement belongs to the moment it was made,
not to the moment it arrived: pictures are 25 to 250 ms old when their pose is known, telemetry about 25 ms, and they
overtake each other. Source: Y. Bar-Shalom et al., "Estimation with Applications to Tracking and Navigation" (2001),
chapter 5 (filter) and chapter 8 (fixed-lag memory).

A second of flight goes some 900 steps, again and again over the same past. With matrices this small numpy's time is
that of its calls, so: few of them, and numbers of Python for what is computed one axis at a time. `dot` alone takes
half the time of `@`, but it releases the interpreter lock, as indexing by lists does: while vision computes, one of its
threads then runs, and the loop waits for it.
"""

from __future__ import annotations

import math
from bisect import insort
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from mkdaemon.control.estimator.values import OLDEST
from mkdaemon.control.estimator.wholenumbers import WholeNumbers
from mkdaemon.control.linear import Array

STEP: Final = 0.010
"""Grid [s]: a tenth of the fastest lag of the model."""
MEMORY: Final = OLDEST
"""How far back a measurement may reach [s]."""
GATE: Final = 5.0
"""Largest believable innovation [standard deviations]."""


@dataclass(frozen=True, slots=True)
class Measurement:
    """A linear measurement of every axis at one moment.

    Attributes:
        at: when it was true [s; monotonic].
        row: what it sees of the state (n,).
        values: measured, one for each axis (k,).
        variance: of the values, one for all or one for each axis (k,).
        gate: largest believable innovation [standard deviations].
        bias: variance of an error that lasts: it widens the gate, and weighs nothing.
        source: who measured it, where it may be found wrong later.
    """

    at: float
    row: Array
    values: Array
    variance: float | Array
    gate: float = GATE
    bias: float | Array = 0.0
    source: str = ""

    @property
    def is_sound(self) -> bool:
        """Whether it can be one: all numbers finite, the variance positive."""
        variances = np.ravel(self.variance).tolist()
        numbers = (self.at, *self.row.tolist(), *self.values.tolist(), *variances)
        return all(map(math.isfinite, numbers)) and min(variances) > 0.0


Drive = tuple[Sequence[float], "Array | None"]
"""An input (k,) of a step, and its variance (k,); None where nothing is said."""


@dataclass(slots=True)
class _Slot:
    """The state at the beginning of a grid step, everything measured in the step before added.

    It lacks what the reference was shifted by since `shifted`. `added` is what doubts added to its covariance.
    """

    state: Array
    covariance: Array
    drive: Sequence[float]
    doubt: Array | None
    shifted: Array
    measurements: list[tuple[float, Measurement]] = field(default_factory=list)
    added: Array | None = None


class RollbackFilter:
    """State and covariance of `k` equal axes with `n` states.

    The effect of a measurement is carried to the newest state when that state is read: an image gives two
    measurements of one moment.

    Attributes:
        rejected: measurements outside their gate, since the start.
        dropped: measurements older than the memory, since the start.
        refused: measurements that are none: a value, row or moment that is not finite, a variance that is not positive.
    """

    def __init__(
        self,
        f: Array,
        g: Array,
        noise: Array,
        states: Array,
        covariance: Array,
        now: float,
        counted: WholeNumbers | None = None,
    ) -> None:
        """Begin at a moment.

        Args:
            f: (n, n) transition over `STEP`, without what is counted.
            g: (n,) input over `STEP`.
            noise: (n, n) process noise over `STEP`.
            states: (k, n) first states.
            covariance: (n, n) of each of them.
            now: [s; monotonic].
            counted: feedback in whole counts; None for none.
        """
        self._noise = noise
        self._take_dynamics(f, g, counted)
        self._first = math.floor(now / STEP)
        axes = len(states)
        self._undriven = (0.0,) * axes
        self._shifted = np.zeros(states.shape)
        covariances = np.repeat(covariance[None], axes, axis=0)
        self._slots = [_Slot(states.copy(), covariances, self._undriven, None, self._shifted)]
        self._known = 0  # the last slot that holds what was measured before it
        self.rejected = 0
        self.dropped = 0
        self.refused = 0

    @property
    def time(self) -> float:
        """The moment of the newest state [s]."""
        return (self._first + len(self._slots) - 1) * STEP

    def remembers(self, at: float) -> bool:
        """Whether a measurement of a moment can still be used [s]."""
        return math.floor(at / STEP) >= self._first

    @property
    def states(self) -> Array:
        """The newest states (k, n)."""
        return self._state_of(self._newest())

    @property
    def covariances(self) -> Array:
        """Of the newest states (k, n, n)."""
        return self._newest().covariance

    def _newest(self) -> _Slot:
        """The newest slot, with everything that was measured."""
        newest = len(self._slots) - 1
        if self._known < newest:
            self._come_forward(newest)
        return self._slots[newest]

    def states_at(self, at: float) -> Array:
        """The states (k, n) at the grid step of a moment; the oldest or newest ones beyond the memory."""
        index = min(max(math.floor(at / STEP) - self._first, 0), len(self._slots) - 1)
        self._come_forward(index)
        return self._state_of(self._slots[index])

    def set_dynamics(self, f: Array, g: Array, counted: WholeNumbers | None = None) -> None:
        """Go on with another transition (n, n), input (n,) and counted feedback over `STEP`."""
        self._come_forward(len(self._slots) - 1)
        self._take_dynamics(f, g, counted)

    def _take_dynamics(self, f: Array, g: Array, counted: WholeNumbers | None) -> None:
        self._f, self._g, self._counted = f, g, counted
        self._rate: Array = (f - np.eye(len(f))) / STEP  # how fast the states change [1/s]
        self._doubt_of_drive = np.multiply.outer(g, g)
        self._inputs = g[None] if counted is None else np.array([g, counted.effect])
        self._fed_back = None if counted is None else np.multiply.outer(counted.effect, counted.row)

    def set_noise(self, noise: Array) -> None:
        """Go on with another process noise (n, n) over `STEP`."""
        self._come_forward(len(self._slots) - 1)
        self._noise = noise

    def shift(self, place: int, amounts: Array) -> None:
        """Add known amounts (k,) to one state, now and in the past: a change of the reference, not of the aircraft."""
        self._come_forward(len(self._slots) - 1)
        self._shifted = self._shifted.copy()
        self._shifted[:, place] += amounts

    def advance(self, drive: Sequence[float], doubted: Array | None = None) -> None:
        """Go one step forward under an input (k,), whose variance (k,) is none where nothing is said."""
        slot = self._newest()
        slot.drive = drive
        slot.doubt = None if doubted is None else doubted[:, None, None] * self._doubt_of_drive
        state, covariance = self._predicted(slot)
        self._slots.append(_Slot(state, covariance, self._undriven, None, self._shifted))
        if len(self._slots) > MEMORY / STEP:
            del self._slots[0]
            self._first += 1
        self._known = len(self._slots) - 1

    def redrive(self, since: float, drive: Callable[[float], Drive]) -> None:
        """Take that other inputs acted from a moment on [s], as far back as is remembered.

        Args:
            since: first moment of them.
            drive: the input (k,) that acted at a moment [s], and its variance (k,), as `advance` takes them.
        """
        first = max(math.floor(since / STEP) - self._first, 0)
        for index, slot in enumerate(self._slots[first:-1], first):
            slot.drive, doubted = drive((self._first + index + 0.5) * STEP)
            slot.doubt = None if doubted is None else doubted[:, None, None] * self._doubt_of_drive
            self._known = min(self._known, index)

    def forget(self, source: str) -> None:
        """Estimate again without what a source measured, as far back as is remembered: it was wrong."""
        for index, slot in enumerate(self._slots[1:], 1):
            rest = [entry for entry in slot.measurements if entry[1].source != source]
            if len(rest) < len(slot.measurements):
                slot.measurements = rest
                self._known = min(self._known, index - 1)

    def coast(self, steps: int, variance: float) -> None:
        """Predict many steps at once under an unknown input, and forget the history before them.

        The input is taken as a constant of mean zero. Transition, sum of inputs and sum of noise over 2k steps follow
        from those over k, so that a thousand steps cost ten products of matrices.

        Args:
            steps: how many.
            variance: of the input.
        """
        self._come_forward(len(self._slots) - 1)
        first, slot = self._first + len(self._slots) - 1 + steps, self._slots[-1]
        state, covariance = self._state_of(slot), slot.covariance
        whole, pushed, grown = np.eye(len(self._f)), np.zeros(len(self._f)), np.zeros_like(self._noise)
        f, g, noise = self._f, self._g, self._noise
        if self._fed_back is not None:  # the count is unknown after a coast: use the linear mean of the quantised term
            f = f + self._fed_back
        # x(n) = F^n x + (sum of F^k g) u, P(n) = F^n P F^n' + sum of F^k Q F^k' + var(u) (sum) (sum)': the input is
        # unknown but constant. Each round doubles the length of the step (F, g, Q): powers by squaring.
        while steps:
            if steps % 2:
                whole, pushed, grown = f @ whole, f @ pushed + g, f @ grown @ f.T + noise
            f, g, noise = f @ f, f @ g + g, f @ noise @ f.T + noise
            steps //= 2
        covariance = whole @ covariance @ whole.T + grown + variance * np.outer(pushed, pushed)
        covariance = (covariance + covariance.transpose(0, 2, 1)) / 2.0
        self._slots = [_Slot(state @ whole.T, covariance, self._undriven, None, self._shifted)]
        self._first, self._known = first, 0

    def measure(self, measurement: Measurement, doubt: Array | None = None) -> Array | None:
        """Add a measurement where it belongs and come forward again.

        Args:
            measurement: what was measured.
            doubt: covariance (n, n) to add to the state of that moment first, when the filter was too sure of itself.

        Returns:
            Innovation over its standard deviation (k,); None where the measurement is too old to be used, or is none.
        """
        if not measurement.is_sound:
            self.refused += 1
            return None
        index = math.floor(measurement.at / STEP) - self._first
        if index < 0:
            self.dropped += 1
            return None
        index = min(index, len(self._slots) - 1)
        self._come_forward(index)
        offset = min(measurement.at - (self._first + index) * STEP, STEP)
        slot = self._slots[index]
        if doubt is not None:
            slot.covariance = slot.covariance + doubt
            slot.added = doubt if slot.added is None else slot.added + doubt
        ratio = self._corrected(slot, offset, measurement)
        self.rejected += sum(abs(each) > measurement.gate for each in ratio.tolist())
        insort(slot.measurements, (offset, measurement), key=lambda entry: entry[0])
        self._known = index
        return ratio

    def ahead(self, drives: Sequence[Sequence[float]]) -> Array:
        """Return the states (k, n) after further steps under inputs (steps, k), without changing anything."""
        newest, counted = self._newest(), self._counted
        state = self._state_of(newest)
        deviations = counted.deviations(newest.covariance) if counted is not None and len(drives) else []
        for drive in drives:
            state = self._moved(state, drive, None if counted is None else counted.counts(state, deviations))
        return state

    def _come_forward(self, to: int) -> None:
        """Bring what was measured last up to a slot."""
        for index in range(self._known, to):
            after = self._slots[index + 1]
            after.state, after.covariance = self._predicted(self._slots[index])
            after.shifted = self._shifted
            if after.added is not None:
                after.covariance = after.covariance + after.added
            for late, known in after.measurements:
                self._corrected(after, late, known)
        self._known = max(self._known, to)

    def _state_of(self, slot: _Slot) -> Array:
        """The state of a slot with all shifts."""
        if slot.shifted is not self._shifted:
            slot.state, slot.shifted = slot.state + (self._shifted - slot.shifted), self._shifted
        return slot.state

    def _predicted(self, slot: _Slot) -> tuple[Array, Array]:
        before, f = self._state_of(slot), self._f
        counts = None
        if self._counted is not None and self._fed_back is not None:
            counts, slopes = self._counted.linearised(before, slot.covariance)
            f = f + np.array(slopes)[:, None, None] * self._fed_back
        covariance: Array = f @ slot.covariance @ f.swapaxes(-1, -2)
        covariance += self._noise
        if slot.doubt is not None:
            covariance += slot.doubt
        return self._moved(before, slot.drive, counts), covariance

    def _moved(self, state: Array, drive: Sequence[float], counts: Sequence[float] | None) -> Array:
        """The states (k, n) one step later under inputs (k,) and mean counts (k,)."""
        inputs = [drive] if counts is None else [drive, counts]
        after: Array = state @ self._f.T
        after += np.array(inputs).T @ self._inputs
        return after

    def _corrected(self, slot: _Slot, offset: float, measurement: Measurement) -> Array:
        """Correct a slot; inside a step the state moves as its rate says, so the row is carried back to its start."""
        # z = h x(t + offset) with x(t + offset) = x + A x offset, so the row at the slot's time is h + h A offset.
        row = measurement.row + measurement.row @ self._rate * offset
        # Kalman: K = P h / (h P h' + R). A lasting bias widens the gate only; a value outside it has weight zero.
        gain = slot.covariance @ row
        spread = gain @ row + measurement.variance
        innovation = measurement.values - self._state_of(slot) @ row
        ratio: Array = innovation / np.sqrt(spread + measurement.bias)
        is_believed = np.abs(ratio) <= measurement.gate
        step = gain * (is_believed / spread)[:, None]
        slot.state = slot.state + step * innovation[:, None]
        slot.covariance = slot.covariance - step[:, :, None] * gain[:, None, :]
        return ratio
