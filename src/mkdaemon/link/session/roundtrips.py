"""Probes and their answers over a moving window: percentiles, loss, late and double answers. Pure."""

from __future__ import annotations

from collections import deque
from collections.abc import Hashable
from typing import Final

from mkdaemon.telemetry.link import RoundTripStats

WEIGHT: Final = 1 / 8
"""Weight of a new round trip in the weighted mean (as TCP smooths its own; RFC 6298, section 2)."""
JITTER_WEIGHT: Final = 1 / 4
"""Weight of a new deviation in the jitter (the same)."""
CAPACITY: Final = 4096
"""Fates remembered at most; a window of 10 s at 100 Hz needs 1000."""


class RoundTrips:
    """Follows probes that carry a token."""

    def __init__(self, *, window: float, timeout: float) -> None:
        """Start empty.

        Args:
            window: how long a fate counts [s].
            timeout: an answer after this is late, the probe lost [s].
        """
        self.timeout = timeout
        self._window = window
        self._open: dict[Hashable, float] = {}
        self._given_up: deque[tuple[Hashable, float]] = deque(maxlen=64)
        self._fates: deque[tuple[float, float | None]] = deque()
        self._lost = 0
        self._sent_total = 0
        self._lost_total = 0
        self._late = 0
        self._duplicate = 0
        self._mean: float | None = None
        self._jitter = 0.0
        self._latest: deque[float] = deque(maxlen=64)
        self._last: float | None = None

    @property
    def unanswered(self) -> int:
        """Probes still waiting for their answer."""
        return len(self._open)

    def began(self, token: Hashable) -> float | None:
        """When a waiting probe was sent [s]; None where it does not wait."""
        return self._open.get(token)

    def before(self, now: float) -> list[tuple[Hashable, float]]:
        """Return the waiting probes sent before then, with their times [s]."""
        return [(token, sent) for token, sent in self._open.items() if sent < now]

    @property
    def fastest(self) -> float:
        """Shortest of the latest round trips [s]; 0 before the first."""
        return min(self._latest, default=0.0)

    @property
    def jitter(self) -> float:
        """Weighted mean deviation of the round trips from their mean [s]."""
        return self._jitter

    def sent(self, token: Hashable, now: float) -> None:
        """A probe went out; a token used again replaces the old probe."""
        self._open.pop(token, None)
        self._open[token] = now

    def answered(self, token: Hashable, now: float) -> float | None:
        """An answer came; returns its round trip [s], None when it answers nothing that waits."""
        began = self._open.pop(token, None)
        if began is None:
            self._count_stray(token)
            return None
        trip = now - began
        self._note(now, trip)
        self._last = trip
        self._latest.append(trip)
        if self._mean is not None:
            self._jitter += JITTER_WEIGHT * (abs(trip - self._mean) - self._jitter)
        self._mean = trip if self._mean is None else self._mean + WEIGHT * (trip - self._mean)
        return trip

    def forget(self, token: Hashable) -> None:
        """A probe's fate cannot be known: it counts neither way."""
        self._open.pop(token, None)

    def expire(self, now: float) -> int:
        """Give up probes without an answer in time; returns how many."""
        lost = 0
        while self._open:
            token, began = next(iter(self._open.items()))
            if now - began < self.timeout:
                break
            del self._open[token]
            self._given_up.append((token, now))
            self._note(now, None)
            lost += 1
        return lost

    def clear(self) -> None:
        """The port was lost: nothing that waits will be answered, and that is not the board's loss."""
        self._open.clear()
        self._given_up.clear()

    def forget_losses(self) -> None:
        """Forget the losses of the window and what waits; round trips stay, and a late answer is known as late."""
        self._given_up.extend(self._open.items())
        self._open.clear()
        self._fates = deque(fate for fate in self._fates if fate[1] is not None)
        self._lost = 0

    def fates(self, now: float) -> tuple[int, int]:
        """Return how many probes of the window have a known fate, and how many of them are lost."""
        while self._fates and self._fates[0][0] < now - self._window:
            self._drop_oldest()
        return len(self._fates), self._lost

    def statistics(self, now: float) -> RoundTripStats:
        """Sum up the window."""
        sent, lost = self.fates(now)
        trips = sorted(trip for _, trip in self._fates if trip is not None)
        return RoundTripStats(
            sent=sent,
            lost=lost,
            sent_total=self._sent_total,
            lost_total=self._lost_total,
            loss_percent=100 * lost / sent if sent else 0.0,
            last_ms=_ms(self._last),
            mean_ms=_ms(self._mean),
            p50_ms=_ms(percentile(trips, 0.50)),
            p95_ms=_ms(percentile(trips, 0.95)),
            p99_ms=_ms(percentile(trips, 0.99)),
            late=self._late,
            duplicate=self._duplicate,
        )

    def _note(self, now: float, trip: float | None) -> None:
        if len(self._fates) == CAPACITY:
            self._drop_oldest()
        self._fates.append((now, trip))
        self._lost += trip is None
        self._sent_total += 1
        self._lost_total += trip is None

    def _drop_oldest(self) -> None:
        self._lost -= self._fates.popleft()[1] is None

    def _count_stray(self, token: Hashable) -> None:
        for entry in self._given_up:
            if entry[0] == token:
                self._late += 1
                self._given_up.remove(entry)
                return
        self._duplicate += 1


def percentile(ordered: list[float], share: float) -> float | None:
    """Nearest-rank percentile of ascending values; None of none."""
    if not ordered:
        return None
    return ordered[min(int(share * len(ordered)), len(ordered) - 1)]


def _ms(seconds: float | None) -> float | None:
    return None if seconds is None else seconds * 1000
