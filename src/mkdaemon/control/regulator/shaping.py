"""Whole counts from wanted numbers: what rounding leaves over is added to the next one.

A count of tilt is 0.45 deg, 8 cm/s2: rounding alone would shake a hover by centimetres. Source: error feedback
quantisation, e.g. S. Norsworthy et al., "Delta-Sigma Data Converters" (1997), first order.
"""

from __future__ import annotations


class CountShaper:
    """One axis of sticks."""

    def __init__(self, lowest: int, highest: int) -> None:
        self._lowest = lowest
        self._highest = highest
        self._rest = 0.0

    def count(self, wanted: float) -> int:
        """Return the count to send for a wanted number of counts; bounded, the rest carried over is below one."""
        total = wanted + self._rest
        count = min(max(round(total), self._lowest), self._highest)
        self._rest = min(max(total - count, -1.0), 1.0)
        return count
