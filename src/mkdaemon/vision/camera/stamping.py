"""When was an image taken: from the driver's stamp where there is one, with its clock's offset measured."""

from __future__ import annotations

import math
from collections import deque

WINDOW = 300
"""Images looked back at: ten seconds at 30 Hz, short against the drift of a clock."""
WINDOW_TIME = 10.0
"""The same in time, for slow cameras [s]."""
PROOF = 2.0
"""How long stamps on another clock are watched before they are believed [s]."""
DRIFT = 0.002
"""Clocks differ by less than this; the nominal rate some streams count in differs by far more."""
JITTER = 0.015
"""What the smallest delay of a second may differ from the next one's on a busy network [s]."""
LOST = 0.3
"""Growth of the smallest delay that no network explains: believed stamps are given up [s]."""
RECENT = 0.5
"""Over so long that growth is looked for [s]."""
MAX_AGE = 2.0
"""A driver stamp older than this against our own clock is not on our clock."""


class StampClock:
    """Turns driver stamps into our monotonic clock.

    A driver stamp on our clock (V4L2 stamps buffers with CLOCK_MONOTONIC) is taken as it is. On another clock the
    smallest delay seen between stamp and arrival is its offset: jitter of the transport is removed, its constant part
    cannot be seen and is the configured latency.

    Not every stamp is a time: FFmpeg numbers the images of an HTTP stream at 25 a second whatever the camera does, so
    a camera of 10 a second seemed 4.7 s late after 8 s. Stamps on another clock are therefore believed only while they
    run as fast as ours; until then, and otherwise, an image was taken when it arrived.
    """

    def __init__(self, latency: float = 0.0) -> None:
        self._latency = latency
        self._seen: deque[tuple[float, float]] = deque(maxlen=WINDOW)
        """Arrival and delay of each image [s]."""
        self._last = -math.inf
        self._believed = False

    def stamp(self, driver: float | None, arrived: float) -> tuple[float, str]:
        """Return when the image was taken [s; monotonic] and who knew: `driver` or `arrival`.

        Args:
            driver: the driver's stamp [s; any clock], None where it has none.
            arrived: when the image reached us [s; monotonic].
        """
        if driver is None or not math.isfinite(driver) or driver <= 0.0:
            return arrived - self._latency, "arrival"
        if driver < self._last - 1.0:
            self._seen.clear()  # the stream started again
            self._believed = False
        self._last = driver
        if 0.0 <= arrived - driver <= MAX_AGE:
            return driver - self._latency, "driver"
        self._seen.append((arrived, arrived - driver))
        while self._seen[0][0] < arrived - WINDOW_TIME:
            self._seen.popleft()
        self._believed = self._runs_as_ours()
        if not self._believed:
            return arrived - self._latency, "arrival"
        return driver + min(delay for _, delay in self._seen) - self._latency, "driver"

    def _runs_as_ours(self) -> bool:
        """Believed when the smallest delay stays over the window, until it has grown too far."""
        first, last = self._seen[0][0], self._seen[-1][0]
        if self._believed:
            recent = min(delay for at, delay in self._seen if at >= last - RECENT)
            if recent - min(delay for _, delay in self._seen) <= LOST:
                return True
            self._seen.clear()  # the proof begins anew
            return False
        if last - first < PROOF:
            return False
        middle = 0.5 * (first + last)
        older = min(delay for at, delay in self._seen if at <= middle)
        younger = min(delay for at, delay in self._seen if at > middle)
        return abs(younger - older) <= JITTER + DRIFT * (last - first)
