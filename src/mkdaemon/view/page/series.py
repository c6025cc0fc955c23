"""Values over time that a page draws: it is sent what is new, and keeps the rest itself."""

from __future__ import annotations

from collections import deque
from itertools import islice
from typing import Final

KEPT: Final = 4096
"""Points of one series."""


class PageSeries:
    """Points in order of time, the oldest forgotten.

    Attributes:
        count: of all points ever taken; a reader's place.
    """

    def __init__(self, *, shortest_step: float = 0.0, kept: int = KEPT) -> None:
        """Begin empty.

        Args:
            shortest_step: a point that comes sooner after the last one is left out [s].
            kept: points.
        """
        self.count = 0
        self._step = shortest_step
        self._points: deque[tuple[float | None, ...]] = deque(maxlen=kept)
        self._last = float("-inf")

    def add(self, at: float, *values: float | None) -> None:
        """Take a point.

        Args:
            at: its time [s].
            values: as many as every other point has; None for one that is not known.
        """
        if at - self._last < self._step:
            return
        self._last = at
        self.count += 1
        self._points.append((round(at, 3), *(None if value is None else round(value, 4) for value in values)))

    def since(self, place: int) -> list[tuple[float | None, ...]]:
        """The points that a reader does not have: time, then values.

        Args:
            place: the `count` when it last read.
        """
        new = min(self.count - place, len(self._points))
        return list(islice(self._points, len(self._points) - new, None)) if new > 0 else []

    def clear(self) -> None:
        """Forget every point; readers go on from here."""
        self._points.clear()
        self._last = float("-inf")
