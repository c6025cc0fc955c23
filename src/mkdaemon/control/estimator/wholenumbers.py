"""A feedback in whole numbers, as an eight-bit flight controller computes it, in an estimate that is never so sure."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from mkdaemon.control.linear import Array


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

    def linearised(self, states: Array, covariances: Array) -> tuple[Array, Array]:
        """Return mean count (k,) and its slope (k,) for states (k, n) with covariances (k, n, n)."""
        counts, slopes = np.empty(len(states)), np.empty(len(states))
        spread = (covariances @ self.row) @ self.row
        for axis, mean in enumerate((states @ self.row).tolist()):
            deviation = math.sqrt(self.blur**2 + max(float(spread[axis]), 0.0))
            steps = math.exp(-2.0 * (math.pi * deviation) ** 2)
            counts[axis] = mean - 0.5 * math.erf(mean / (deviation * math.sqrt(2.0)))
            counts[axis] += steps * math.sin(math.tau * mean) / math.pi
            slopes[axis] = 1.0 - math.exp(-0.5 * (mean / deviation) ** 2) / (deviation * math.sqrt(math.tau))
            slopes[axis] += 2.0 * steps * math.cos(math.tau * mean)
        return counts, slopes
