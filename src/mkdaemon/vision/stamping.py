"""When was an image taken: from the driver's stamp where there is one, with its clock's offset measured."""

from __future__ import annotations

import math
from collections import deque

WINDOW = 300
"""Images over which the smallest delay is kept: ten seconds at 30 Hz, short against the drift of a clock."""
MAX_AGE_S = 2.0
"""A driver stamp older than this against our own clock is not on our clock."""


class StampClock:
    """Turns driver stamps into our monotonic clock.

    A driver stamp on our clock (V4L2 stamps buffers with CLOCK_MONOTONIC) is taken as it is. On another clock the
    smallest delay seen between stamp and arrival is its offset: jitter of the transport is removed, its constant part
    cannot be seen and is the configured latency.
    """

    def __init__(self, latency: float = 0.0) -> None:
        self._latency = latency
        self._offsets: deque[float] = deque(maxlen=WINDOW)
        self._last = -math.inf

    def stamp(self, driver: float | None, arrived: float) -> tuple[float, str]:
        """Return when the image was taken [s; monotonic] and who knew: `driver` or `arrival`.

        Args:
            driver: the driver's stamp [s; any clock], None where it has none.
            arrived: when the image reached us [s; monotonic].
        """
        if driver is None or not math.isfinite(driver) or driver <= 0.0:
            return arrived - self._latency, "arrival"
        if driver < self._last - 1.0:
            self._offsets.clear()  # the stream started again
        self._last = driver
        if 0.0 <= arrived - driver <= MAX_AGE_S:
            return driver - self._latency, "driver"
        self._offsets.append(arrived - driver)
        return driver + min(self._offsets) - self._latency, "driver"
