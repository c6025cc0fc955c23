"""Which kinds of frames arrive, how often, and which are overdue. Pure; driven with `now`."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field
from typing import Final

from mkdaemon.telemetry.link import KindHealth

STALE_PERIODS: Final = 3
"""A stream is stale after this many missed periods."""
OVERDUE: Final = 0.2
"""A stale stream degrades the link after this at the earliest [s]; a radio's spike of 62 ms is 3 periods at 50 Hz."""


@dataclass(slots=True)
class FrameKind:
    """Arrivals of one kind of frame.

    Attributes:
        key: the message, as in Zenoh keys.
        board: who sends it.
        frames: since the port was opened.
        last: when the latest one arrived [s]; minus infinity before the first.
        interval: asked for [s]; None where nobody asked.
        asked_at: when that was asked for first [s].
        arrivals: times of the latest ones [s].
    """

    key: str
    board: str
    frames: int = 0
    last: float = -math.inf
    interval: float | None = None
    asked_at: float = math.inf
    arrivals: deque[float] = field(default_factory=lambda: deque(maxlen=256))

    def missed(self, now: float) -> float:
        """Periods since the latest frame, or since it was asked for."""
        if self.interval is None:
            return 0.0
        return (now - max(self.last, self.asked_at)) / self.interval

    def is_overdue(self, now: float) -> bool:
        """Stale for long enough that the line, not a single late frame of a fast stream, is to blame."""
        return self.missed(now) > STALE_PERIODS and now - max(self.last, self.asked_at) > OVERDUE

    def rate(self, now: float, window: float) -> float:
        """Frames a second over the window [Hz]."""
        while self.arrivals and self.arrivals[0] < now - window:
            self.arrivals.popleft()
        if len(self.arrivals) < 2:
            return 0.0
        # The time since the last arrival counts, so that a stream that stopped does not keep its rate.
        span = max(self.arrivals[-1] - self.arrivals[0], now - self.arrivals[0] - 2 * (self.interval or 1.0))
        return (len(self.arrivals) - 1) / span if span > 0 else 0.0


class Arrivals:
    """Every kind of frame heard or asked for since the port was opened."""

    def __init__(self) -> None:
        self._kinds: dict[tuple[str, str], FrameKind] = {}

    def clear(self) -> None:
        """A port was opened."""
        self._kinds.clear()

    def received(self, board: str, key: str, now: float) -> None:
        """A right frame arrived."""
        kind = self._kinds.get((board, key))
        if kind is None:
            kind = self._kinds[board, key] = FrameKind(key, board)
        kind.frames += 1
        kind.last = now
        kind.arrivals.append(now)

    def wanted(self, board: str, intervals: dict[str, float], now: float) -> None:
        """These streams of a board are asked for, at these intervals [s]; its others are not."""
        for kind in self._kinds.values():
            if kind.board == board and kind.key not in intervals:
                kind.interval = None
        for key, interval in intervals.items():
            kind = self._kinds.setdefault((board, key), FrameKind(key, board))
            if kind.interval != interval:
                kind.interval, kind.asked_at = interval, now

    @property
    def asked(self) -> list[FrameKind]:
        """The kinds somebody asked for."""
        return [kind for kind in self._kinds.values() if kind.interval is not None]

    def overdue(self, now: float) -> list[FrameKind]:
        """The kinds that should have come."""
        return [kind for kind in self._kinds.values() if kind.is_overdue(now)]

    def are_on_time(self, now: float) -> bool:
        """Whether streams are asked for, and none is stale."""
        asked = self.asked
        return bool(asked) and not any(kind.missed(now) > STALE_PERIODS for kind in asked)

    def health(self, now: float, window: float) -> tuple[KindHealth, ...]:
        """Describe every kind; rates over a window [s]."""
        return tuple(
            KindHealth(
                key=kind.key,
                board=kind.board,
                frames=kind.frames,
                rate=kind.rate(now, window),
                asked_rate=None if kind.interval is None else 1 / kind.interval,
                age=min(now - kind.last, 1e9),
                is_stale=kind.missed(now) > STALE_PERIODS,
            )
            for kind in self._kinds.values()
        )
