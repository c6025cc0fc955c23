"""Evidence of the moving window: frames by kind, damaged bytes, probes and their answers. Pure."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Hashable
from dataclasses import dataclass, field
from typing import Final, NamedTuple

from mkdaemon.link.session.fates import Tally
from mkdaemon.protocol.framing import DropReason
from mkdaemon.telemetry.link import KindHealth, RoundTripStats, Why

STALE_PERIODS: Final = 3
"""A stream is stale after this many missed periods."""
OVERDUE: Final = 0.2
"""A stale stream degrades the link after this at the earliest [s]; a radio's spike of 62 ms is 3 periods at 50 Hz."""


class OwnTime:
    """The time in which this program looked: only that tells that something did not arrive.

    What comes while the loop is kept from running waits in the kernel, and what the loop should have sent was not sent.
    """

    def __init__(self) -> None:
        self._missed: deque[tuple[float, float]] = deque(maxlen=64)

    def miss(self, since: float, until: float) -> None:
        """Note that nothing was looked at between two times [s]."""
        self._missed.append((since, until))

    def elapsed(self, since: float, now: float) -> float:
        """Time that passed since then and was looked at [s]; infinite since never."""
        if since == -math.inf:
            return math.inf
        return now - since - sum(max(until - max(since, began), 0.0) for began, until in self._missed)

    def share_missed(self, now: float, window: float) -> float:
        """Share of a time up to now in which this program did not run [1]."""
        return 1.0 - self.elapsed(now - window, now) / window


@dataclass(slots=True)
class FrameKind:
    """Arrivals of one kind of frame.

    Attributes:
        key: the message, as in Zenoh keys.
        board: that sends it.
        frames: since the port was opened.
        last: when the latest one arrived [s]; minus infinity before the first.
        interval: requested [s]; None if not requested.
        asked_at: when that was asked for first [s].
        arrivals: times of the latest ones [s].
        own: the time after which one counts as missing.
    """

    key: str
    board: str
    frames: int = 0
    last: float = -math.inf
    interval: float | None = None
    asked_at: float = math.inf
    arrivals: deque[float] = field(default_factory=lambda: deque(maxlen=256))
    own: OwnTime = field(default_factory=OwnTime)

    def missed(self, now: float) -> float:
        """Periods since the latest frame, or since it was asked for."""
        if self.interval is None:
            return 0.0
        return self._waited(now) / self.interval

    def is_overdue(self, now: float) -> bool:
        """Stale for long enough that the line, not a single late frame of a fast stream, is to blame."""
        return self.missed(now) > STALE_PERIODS and self._waited(now) > OVERDUE

    def _waited(self, now: float) -> float:
        """Own time since the latest frame, or since it was asked for [s]."""
        return self.own.elapsed(max(self.last, self.asked_at), now)

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

    def __init__(self, own: OwnTime | None = None) -> None:
        """Nothing was heard; a frame is missing when its time has passed in `own`, all time if none is given."""
        self._own = own or OwnTime()
        self._kinds: dict[tuple[str, str], FrameKind] = {}

    def clear(self) -> None:
        """A port was opened."""
        self._kinds.clear()

    def received(self, board: str, key: str, now: float) -> None:
        """A right frame arrived."""
        kind = self._kinds.get((board, key))
        if kind is None:
            kind = self._kinds[board, key] = FrameKind(key, board, own=self._own)
        kind.frames += 1
        kind.last = now
        kind.arrivals.append(now)

    def wanted(self, board: str, intervals: dict[str, float], now: float) -> None:
        """These streams of a board are asked for, at these intervals [s]; its others are not."""
        for kind in self._kinds.values():
            if kind.board == board and kind.key not in intervals:
                kind.interval = None
        for key, interval in intervals.items():
            kind = self._kinds.setdefault((board, key), FrameKind(key, board, own=self._own))
            if kind.interval != interval:
                kind.interval, kind.asked_at = interval, now

    @property
    def asked(self) -> list[FrameKind]:
        """The kinds that were requested."""
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


class _Sizes:
    """Sizes of the moving window, and their sum: it is asked for with every look at the line.

    Attributes:
        total: of what is in the window [bytes].
        entries: when, how many bytes, and why they were no frame; None for a right one.
    """

    def __init__(self, window: float, most: int) -> None:
        self.total = 0
        self.entries: deque[tuple[float, int, DropReason | None]] = deque()
        self._window, self._most = window, most

    def add(self, now: float, size: int, reason: DropReason | None = None) -> None:
        """Take an entry; the oldest goes where there are too many."""
        self.entries.append((now, size, reason))
        self.total += size
        if len(self.entries) > self._most:
            self._drop_oldest()

    def clear(self) -> None:
        """Forget all."""
        self.entries.clear()
        self.total = 0

    def forget(self, now: float) -> None:
        """Forget what has left the window."""
        while self.entries and self.entries[0][0] < now - self._window:
            self._drop_oldest()

    def _drop_oldest(self) -> None:
        self.total -= self.entries.popleft()[1]


class ReceivedBytes:
    """Bytes of the moving window, right and damaged."""

    def __init__(self, window: float) -> None:
        """Start empty; figures are over `window` [s]."""
        self._window = window
        self._damage = _Sizes(window, 1024)
        self._decoded = _Sizes(window, 4096)
        self._raw: deque[tuple[float, int]] = deque(maxlen=256)
        self._text = ""

    def clear(self) -> None:
        """A port was opened: what came before says nothing about it."""
        self._damage.clear()
        self._raw.clear()

    def forget_damage(self) -> None:
        """An outage is over: the damage it did says nothing about the line as it is now."""
        self._damage.clear()

    def arrived(self, size: int, now: float) -> None:
        """Bytes arrived, whatever they are."""
        self._raw.append((now, size))

    def frame(self, size: int, now: float) -> None:
        """These bytes were a valid frame."""
        self._decoded.add(now, size)

    def damaged(self, reason: DropReason, raw: bytes, now: float, *, keep_text: bool) -> None:
        """Bytes were no frame.

        Args:
            reason: why.
            raw: the bytes.
            now: [s; monotonic].
            keep_text: text replaces the known text.
        """
        self._damage.add(now, len(raw), reason)
        self._decoded.add(now, len(raw))
        if reason is DropReason.TEXT and keep_text:
            self._text = raw.decode("latin-1")

    def rates(self, now: float) -> tuple[float, float]:
        """Undecodable bytes and wrong checksums a second over the window [1/s]."""
        self._forget(now)
        checksums = sum(1 for _, _, reason in self._damage.entries if reason is DropReason.CHECKSUM)
        return self._damage.total / self._window, checksums / self._window

    def share(self, now: float) -> tuple[int, int]:
        """Damaged and all bytes of the window."""
        self._forget(now)
        return self._damage.total, self._decoded.total

    def arrived_since(self, since: float) -> int:
        """Bytes that arrived after a moment [s], whatever they are."""
        return sum(size for at, size in self._raw if at > since)

    def damaged_since(self, since: float) -> int:
        """Bytes that arrived after a moment [s] and were no frame."""
        return sum(size for at, size, _ in self._damage.entries if at > since)

    def text_since(self, since: float) -> str | None:
        """The text, where everything that was no frame after a moment [s] is text; None otherwise."""
        recent = [reason for at, _, reason in self._damage.entries if at > since]
        is_text = recent and all(reason is DropReason.TEXT for reason in recent) and _is_readable(self._text)
        return self._text if is_text else None

    def _forget(self, now: float) -> None:
        self._damage.forget(now)
        self._decoded.forget(now)


def _is_readable(sample: str) -> bool:
    """Mostly printable, as boot banners are and a wrong baud is not."""
    readable = sum(1 for c in sample if c.isascii() and (c.isprintable() or c.isspace()))
    return readable > 0 and readable >= 0.9 * len(sample)


WEIGHT: Final = 1 / 8
"""Weight of a new round trip in the weighted mean (as TCP smooths its own; RFC 6298, section 2)."""
JITTER_WEIGHT: Final = 1 / 4
"""Weight of a new deviation in the jitter (the same)."""
LATE_PROOF: Final = 1.0
"""An answer this late after its probe was given up is no evidence about the present line [s]."""
CAPACITY: Final = 4096
"""Fates remembered at most; a window of 10 s at 100 Hz needs 1000."""


class _GivenUp(NamedTuple):
    """A probe without an answer in time: when it was given up [s], and why it has none."""

    token: Hashable
    at: float
    why: Why


class _Fate(NamedTuple):
    """When a fate was known, and when it was sent [s]; the round trip [s], or why there was none."""

    at: float
    sent: float
    trip: float | None
    why: Why | None = None


class RoundTrips:
    """Follows probes that carry a token.

    Attributes:
        timeout: see `__init__`.
        tally: what became of all of them.
    """

    def __init__(self, *, window: float, timeout: float, own: OwnTime | None = None) -> None:
        """Start empty.

        Args:
            window: how long a fate counts [s].
            timeout: an answer after this is late, the probe lost [s].
            own: the time in which an answer can be missing; all of it if none is given.
        """
        self._own = own or OwnTime()
        self.timeout = timeout
        self._window = window
        self.tally = Tally()
        self._open: dict[Hashable, float] = {}
        self._given_up: deque[_GivenUp] = deque(maxlen=64)
        self._fates: deque[_Fate] = deque()
        self._forgiven_until = -math.inf
        self._duplicate = 0
        self._mean: float | None = None
        self._jitter = 0.0
        self._latest: deque[float] = deque(maxlen=64)
        self._last: float | None = None

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

    @property
    def spread(self) -> float:
        """By how much the median of the latest round trips is longer than the shortest [s]; 0 before the first."""
        middle = percentile(sorted(self._latest), 0.5)
        return 0.0 if middle is None else middle - self.fastest

    def asked(self, now: float) -> Hashable | None:
        """The probe that an answer without a token belongs to; None where none waits.

        That is the newest probe older than the fastest round trip: answers do not overtake each other, and one of two
        requests may be lost.
        """
        waiting = list(self._open)
        fitting = [token for token in waiting if now - self._open[token] >= self.fastest]
        return fitting[-1] if fitting else next(iter(waiting), None)

    def asked_before(self, now: float) -> Hashable | None:
        """The probe given up a moment ago that a late answer without a token belongs to; None where there is none."""
        return next((gone.token for gone in self._given_up if now - gone.at < LATE_PROOF), None)

    def sent(self, token: Hashable, now: float) -> None:
        """A probe went out; a token used again gives the old probe up."""
        if token in self._open:
            self._give_up(token, now, Why.LOST)
        for gone in [gone for gone in self._given_up if gone.token == token]:
            self._given_up.remove(gone)
        self.tally.sent += 1
        self._open[token] = now

    def answered(self, token: Hashable, now: float) -> float | None:
        """An answer came; returns its round trip [s], None when it answers nothing that waits."""
        began = self._open.pop(token, None)
        if began is None:
            self._count_stray(token)
            return None
        trip = now - began
        self.tally.answered += 1
        self._note(_Fate(now, began, trip))
        self._last = trip
        self._latest.append(trip)
        if self._mean is not None:
            self._jitter += JITTER_WEIGHT * (abs(trip - self._mean) - self._jitter)
        self._mean = trip if self._mean is None else self._mean + WEIGHT * (trip - self._mean)
        return trip

    def proves_hearing(self, token: Hashable, now: float) -> bool:
        """Whether an answer now shows that the other end hears us; one that was given up a moment ago does, too."""
        return token in self._open or any(gone.token == token and now - gone.at < LATE_PROOF for gone in self._given_up)

    def replaced(self, token: Hashable, now: float) -> None:
        """The board answers only a newer probe: no answer to this one will come."""
        if token in self._open:
            self._give_up(token, now, Why.REPLACED)

    def expire(self, now: float, why: Why = Why.LOST) -> int:
        """Give up probes without an answer in time, for a reason; returns how many."""
        lost = 0
        while self._open:
            token, began = next(iter(self._open.items()))
            if self._own.elapsed(began, now) < self.timeout:
                break
            self._give_up(token, now, Why.OUTAGE if began <= self._forgiven_until else why)
            lost += 1
        return lost

    def interrupted(self, now: float) -> None:
        """The port was lost, or this program stood still: no answer to what waits will be seen."""
        for token in list(self._open):
            self._give_up(token, now, Why.OUTAGE)

    def forgive(self, now: float) -> None:
        """An outage is over: what it swallowed is counted, and says nothing about the line as it is now."""
        self._forgiven_until = now

    def losses(self, now: float) -> tuple[int, int]:
        """Return the probes of the window that tell how the line is, and how many of them are lost.

        Those lost that were sent before the end of an outage tell nothing, nor do those that the board replaced.
        """
        telling = [
            fate
            for fate in self._of_window(now)
            if fate.trip is not None or (fate.why is not Why.REPLACED and fate.sent > self._forgiven_until)
        ]
        return len(telling), sum(fate.trip is None for fate in telling)

    def _of_window(self, now: float) -> deque[_Fate]:
        while self._fates and self._fates[0].at < now - self._window:
            self._fates.popleft()
        return self._fates

    def statistics(self, now: float) -> RoundTripStats:
        """Sum up the window."""
        fates, tally = self._of_window(now), self.tally
        trips = sorted(fate.trip for fate in fates if fate.trip is not None)
        sent, lost = len(fates), len(fates) - len(trips)
        return RoundTripStats(
            sent=sent,
            lost=lost,
            replaced=sum(fate.why is Why.REPLACED for fate in fates),
            sent_total=tally.answered + tally.late + tally.unanswered,
            lost_total=tally.late + tally.unanswered,
            loss_percent=100 * lost / sent if sent else 0.0,
            last_ms=_ms(self._last),
            mean_ms=_ms(self._mean),
            p50_ms=_ms(percentile(trips, 0.50)),
            p95_ms=_ms(percentile(trips, 0.95)),
            p99_ms=_ms(percentile(trips, 0.99)),
            late=tally.late,
            duplicate=self._duplicate,
        )

    def _note(self, fate: _Fate) -> None:
        if len(self._fates) == CAPACITY:
            self._fates.popleft()
        self._fates.append(fate)

    def _give_up(self, token: Hashable, now: float, why: Why) -> None:
        began = self._open.pop(token)
        self._given_up.append(_GivenUp(token, now, why))
        self.tally.gave_up(why)
        self._note(_Fate(now, began, None, why))

    def _count_stray(self, token: Hashable) -> None:
        for gone in self._given_up:
            if gone.token == token:
                self.tally.came_late(gone.why)
                self._given_up.remove(gone)
                return
        self._duplicate += 1


def percentile(ordered: list[float], share: float) -> float | None:
    """Nearest-rank percentile of ascending values; None of none."""
    if not ordered:
        return None
    return ordered[min(int(share * len(ordered)), len(ordered) - 1)]


def _ms(seconds: float | None) -> float | None:
    return None if seconds is None else seconds * 1000
