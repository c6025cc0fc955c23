"""A feedback in whole numbers, as an eight-bit flight controller computes it, in an estimate that is never so sure."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from mkdaemon.control.linear import Array

_ROOT_2: Final = math.sqrt(2.0)
_ROOT_TAU: Final = math.sqrt(math.tau)


@dataclass(frozen=True, slots=True)
class WholeNumbers:
    """A feedback that acts in whole counts, truncated towards zero; noise in what is counted blurs its steps.

    For an input that is normal with mean m and deviation s, the mean count and its slope are those of the statistical
    linearisation (A. Gelb, W. Vander Velde, "Multiple-Input Describing Functions", 1968, chapter 2): the straight line,
    less half a count, plus the first harmonic of the steps.

    Attributes:
        row: what is counted, of the state (n,) [count].
        effect: what one count changes within a step (n,).
        blur: standard deviation of the noise in what is counted [count]; from 0.2 on the other harmonics are nothing.
    """

    row: Array
    effect: Array
    blur: float

    def deviations(self, covariances: Array) -> list[float]:
        """Return the standard deviation of what is counted (k,) for covariances (k, n, n) [count]."""
        spreads = (covariances @ self.row @ self.row).tolist()
        return [math.sqrt(self.blur**2 + max(spread, 0.0)) for spread in spreads]

    def counts(self, states: Array, deviations: list[float]) -> list[float]:
        """Return the mean count (k,) for states (k, n) and deviations (k,) of what is counted."""
        means = (states @ self.row).tolist()
        return [_linearised(*each)[0] for each in zip(means, deviations, strict=True)]

    def linearised(self, states: Array, covariances: Array) -> tuple[Sequence[float], Sequence[float]]:
        """Return mean count (k,) and its slope (k,) for states (k, n) with covariances (k, n, n)."""
        means = (states @ self.row).tolist()
        counts, slopes = zip(*map(_linearised, means, self.deviations(covariances)), strict=True)
        return counts, slopes


def _linearised(mean: float, deviation: float) -> tuple[float, float]:
    """Mean count and its slope for a normal input."""
    # trunc(x) = x - sign(x) / 2 + sum over k of sin(2 pi k x) / (pi k), for x of mean m and deviation s:
    # E[sign(x)] = erf(m / (s sqrt 2)), E[sin(2 pi x)] = exp(-2 pi^2 s^2) sin(2 pi m); the slope is the derivative by m.
    off = mean / deviation
    steps = math.exp(-2.0 * (math.pi * deviation) ** 2)
    count = mean - 0.5 * math.erf(off / _ROOT_2) + steps * math.sin(math.tau * mean) / math.pi
    slope = 1.0 - math.exp(-0.5 * off * off) / (deviation * _ROOT_TAU) + 2.0 * steps * math.cos(math.tau * mean)
    return count, slope
