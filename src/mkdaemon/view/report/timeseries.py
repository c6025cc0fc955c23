"""Numbers over time, and as many of them as a plot can show."""

from __future__ import annotations

import itertools
from array import array
from dataclasses import dataclass, field
from typing import Final

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

MOST: Final = 1600
"""Points of a line in a plot; a screen is about as wide."""


@dataclass(slots=True)
class TimeSeries:
    """One quantity of a flight.

    Attributes:
        times: [s].
        values: at these.
    """

    times: array[float] = field(default_factory=lambda: array("d"))
    values: array[float] = field(default_factory=lambda: array("d"))

    def __len__(self) -> int:
        return len(self.times)

    def add(self, at: float, value: float) -> None:
        """Add one."""
        self.times.append(at)
        self.values.append(value)

    def arrays(self) -> tuple[Array, Array]:
        """Times and values as arrays (n,), sorted by time."""
        times, values = np.array(self.times), np.array(self.values)
        order = np.argsort(times, kind="stable")
        return times[order], values[order]


def thin(times: Array, values: Array, most: int = MOST) -> tuple[Array, Array]:
    """Up to `most` points that show the same line: of every stretch the lowest and the highest stay.

    Args:
        times: (n,), sorted.
        values: (n,).
        most: points that are left; at least 4.
    """
    count = len(times)
    if count <= most:
        return times, values
    edges = np.linspace(0, count, most // 2 + 1).astype(int)
    kept: set[int] = {0, count - 1}
    for begin, end in itertools.pairwise(edges):
        part = values[begin:end]
        kept |= {int(begin + part.argmin()), int(begin + part.argmax())}
    order = np.array(sorted(kept))
    return times[order], values[order]
