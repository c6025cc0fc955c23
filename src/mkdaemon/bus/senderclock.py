"""Converts a setpoint's send time to the daemon's clock: its age counts from then, not from its arrival.

A client that sends more than this machine reads leaves a queue in the kernel: what is read last was sent seconds ago,
and would be flown after the client's death. The clock of the sender may be of another machine, so nothing is known of
it but that it only runs on. Time of arrival less stamp is the offset of the clocks and the delay of the way, and no
delay is negative: the smallest difference that a lease has shown is nearest to the offset. An age is too small by the
shortest delay of the lease, never too large; how long that may be is measured when the lease is taken (`slow_path`).
The stamps are signed, so only the holder changes what is learnt, and no exchange of times is needed.
"""

from __future__ import annotations

import threading
from typing import Final

DRIFT: Final = 1e-3
"""By how much two clocks may run apart [s/s]: Linux slews each by 5e-4 at most (adjtimex, MAXFREQ)."""


class SenderClock:
    """Estimates the clock of the lease's holder; from any thread."""

    def __init__(self) -> None:
        self._epoch: int | None = None
        self._offset = self._learnt_at = 0.0
        self._lock = threading.Lock()

    def sent(self, epoch: int, stamp: float, arrived: float) -> float:
        """Send time of a setpoint, by our clock [s]; never after its arrival.

        Args:
            epoch: of the lease whose holder signed it; another one has another clock.
            stamp: by its sender's clock [s].
            arrived: by ours [s].
        """
        with self._lock:
            shown = arrived - stamp
            grown = self._offset + DRIFT * max(0.0, arrived - self._learnt_at)
            self._offset = shown if epoch != self._epoch else min(shown, grown)
            self._epoch, self._learnt_at = epoch, arrived
            return min(stamp + self._offset, arrived)
