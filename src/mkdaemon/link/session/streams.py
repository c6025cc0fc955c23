"""The wanted streams: requested once, and renewed while they are wanted. Pure; driven with `now`.

They are wanted by configuration, by `auto`, or since they were changed at run time. A board has ONE timer for all its
streams (NaviCtrl 4.0 s, FlightCtrl 4.1 s); any stream request renews them all. A request with interval 0 renews without
costing a frame, so an unwanted kind is the renewal; where all kinds are wanted, the one with the shortest reply is.
Every other request costs one frame and restarts the phase of its stream, so a stream is asked for again only when its
rate changes or it is overdue. How often they are renewed follows from the share of requests that the board hears; see
`renewal`. Source: docs/firmware-notes, "Subscriptions".
"""

from __future__ import annotations

import difflib
import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, NamedTuple

from mkdaemon.config.link import LinkConfig
from mkdaemon.errors import CommandRejectedError, ConfigError
from mkdaemon.link.session import budget
from mkdaemon.link.session.line import LineRules
from mkdaemon.link.session.prober import AUTO
from mkdaemon.link.session.renewal import HeardShare, renewal_interval
from mkdaemon.link.session.scheduler import QueuedTransmission
from mkdaemon.link.session.streamkinds import KINDS, TICK_TIME, kind_of, round_up_interval
from mkdaemon.link.session.traffic import Purpose
from mkdaemon.protocol.wire import Board, WireMessage

OVERDUE_PERIODS: Final = 3
"""A stream of which nothing came for this number of periods is asked for again."""
ASK_AGAIN: Final = 0.15
"""Shortest time between two requests for the same stream [s]; the longest round trip by radio is 0.13 s."""
ASK_RARELY: Final = 1.0
"""Longest such time for a stream that flight does not need [s]: each request without an answer takes twice as long as
the one before."""


@dataclass(slots=True)
class _Stream:
    interval: float
    asked_at: float = -math.inf
    seen_at: float = -math.inf
    patience: float = ASK_AGAIN

    def due_at(self) -> float:
        """When it must be asked for [s]: at once, or when it is overdue and the last request has had its time."""
        if self.asked_at == -math.inf:
            return -math.inf
        periods = OVERDUE_PERIODS * self.interval
        if self.seen_at >= self.asked_at:
            return max(self.seen_at + periods, self.asked_at + ASK_AGAIN)
        return max(self.seen_at + periods, self.asked_at + self.patience)

    def ask(self, now: float, *, is_vital: bool) -> None:
        """Note a request; one that stayed without an answer makes the next one wait longer where flight can."""
        is_answered = self.seen_at >= self.asked_at
        self.patience = ASK_AGAIN if is_answered or is_vital else min(2.0 * self.patience, ASK_RARELY)
        self.asked_at = now


class Subscriptions:
    """The streams of one board."""

    def __init__(self, board: Board, share: HeardShare, *, renew: float = 1.5) -> None:
        """Want nothing yet.

        Args:
            board: who streams.
            share: how many requests it hears.
            renew: longest time between two renewals [s].
        """
        self.board = board
        self._share = share
        self._renew = renew
        self._chosen = (-1, renew)
        self._wanted: dict[str, _Stream] = {}
        self._to_stop: list[str] = []
        self._renewed_at = -math.inf

    @property
    def wanted(self) -> dict[str, float]:
        """Interval of every wanted stream [s]."""
        return {key: stream.interval for key, stream in self._wanted.items()}

    def want(self, key: str, interval: float) -> None:
        """Want a stream at an interval [s], see `round_up_interval`; 0 or less ends it.

        Raises:
            CommandRejectedError: see `kind_of`.
        """
        kind_of(key, self.board)
        if interval <= 0:
            if self._wanted.pop(key, None) is not None:
                self._to_stop.append(key)
            return
        interval = round_up_interval(interval)
        stream = self._wanted.get(key)
        if stream is None or stream.interval != interval:
            self._wanted[key] = _Stream(interval)

    def end(self, key: str) -> None:
        """End an unwanted stream."""
        if key not in self._to_stop and self.board in KINDS[key].boards:
            self._to_stop.append(key)

    def forget(self) -> None:
        """The board lost everything it was asked (reboot, port lost): ask for all of it again."""
        for stream in self._wanted.values():
            stream.asked_at = stream.seen_at = -math.inf
        self._renewed_at = -math.inf

    def frame_received(self, key: str, now: float) -> None:
        """A frame of a kind arrived."""
        stream = self._wanted.get(key)
        if stream is not None:
            stream.seen_at = now

    def due(self, now: float) -> list[WireMessage]:
        """Return the requests to send now and note them as asked."""
        messages = [KINDS[key].ask(0) for key in self._to_stop]
        self._to_stop.clear()
        for key in sorted(self._wanted, key=lambda key: not KINDS[key].is_vital):
            stream = self._wanted[key]
            if now >= stream.due_at():
                stream.ask(now, is_vital=KINDS[key].is_vital)
                messages.append(KINDS[key].ask(stream.interval))
        if messages:
            self._renewed_at = now
        elif self._wanted and now >= self._renewed_at + self.renewal:
            self._renewed_at = now
            messages.append(self._renewal(now))
        return messages

    def next_time(self) -> float:
        """When `due` has something next [s]; infinite while nothing is wanted."""
        if self._to_stop:
            return -math.inf
        if not self._wanted:
            return math.inf
        return min(self._renewed_at + self.renewal, *(stream.due_at() for stream in self._wanted.values()))

    @property
    def renewal(self) -> float:
        """Time between two renewals, as the line is now [s]."""
        if self._chosen[0] != self._share.noted:
            self._chosen = (self._share.noted, renewal_interval(self._share, self._renew))
        return self._chosen[1]

    def _renewal(self, now: float) -> WireMessage:
        for key, kind in KINDS.items():
            if key not in self._wanted and self.board in kind.boards and kind.renews is not None:
                return kind.ask(0)
        key = next(key for key in KINDS if key in self._wanted)
        self._wanted[key].asked_at = now
        return KINDS[key].ask(self._wanted[key].interval)


QUEUED: Final = 1.0
"""Longest time a request for a stream waits for the line [s]; it is asked again anyway."""
BORROWED: Final = 4.0
"""Time after which a stream started by a client's request ends [s], as on a board without renewal."""
LEFT_OVER: Final = 8
"""Frames of an unwanted stream within `LEFT_OVER_TIME` from which another program requested it: it is ended,
because every renewal keeps them alive too."""
LEFT_OVER_TIME: Final = 6.0
"""See `LEFT_OVER` [s]."""
DemandOf = Callable[[dict[str, float]], budget.Demand]
"""What the line must carry with these streams [s]."""


def check_rates(cfg: LinkConfig) -> None:
    """Refuse configured rates that no board streams, or that the line cannot carry whichever board it ends at.

    Raises:
        ConfigError: with the nearest key, or with the arithmetic.
    """
    rates = {} if isinstance(cfg.rates, str) else cfg.rates
    for key in rates.keys() - KINDS.keys():
        near = difflib.get_close_matches(key, KINDS, n=1, cutoff=0.4) or list(KINDS)
        raise ConfigError(f"link.rates: there is no stream {key!r}; did you mean {' or '.join(near)}?")
    echo_hz = 1 / AUTO if cfg.echo_hz == "auto" else cfg.echo_hz
    for board in (Board.NC, Board.FC):
        streams = {key: round_up_interval(ms / 1000) for key, ms in rates.items() if board in KINDS[key].boards}
        rules = LineRules(baud=cfg.baud, direct=board, gap=cfg.gap_ms / 1000)
        try:
            budget.check(budget.Demand(streams, echo_hz), rules, limit=cfg.max_line_share)
        except CommandRejectedError as error:
            raise ConfigError(f"link.rates: {error.reason} {error.fix}") from error


class _Borrowed(NamedTuple):
    """A stream that a client's own request started: its interval before, 0 for none, and when it ends [s]."""

    before: float
    until: float


class Streams:
    """Wishes, and the subscriptions that fulfil them on the board at the end of the wire.

    Attributes:
        is_on: the board was asked for them since the port was opened.
    """

    def __init__(self, cfg: LinkConfig, share: HeardShare | None = None) -> None:
        """Want what is configured; requests are heard as `share` says, by default as its prior does."""
        self.is_on = False
        self._cfg = cfg
        self._share = share or HeardShare()
        self._subscriptions = Subscriptions(Board.ANY, self._share, renew=cfg.renewal)
        self._borrowed: dict[str, _Borrowed] = {}
        self._ended: list[str] = []
        self._left_over: dict[str, deque[float]] = {}
        self._wishes = {} if isinstance(cfg.rates, str) else {key: ms / 1000 for key, ms in cfg.rates.items()}

    @property
    def wanted(self) -> dict[str, float]:
        """Interval of every wanted stream [s]."""
        return self._subscriptions.wanted

    @property
    def renewal(self) -> float:
        """Time between two renewals, as the line is now [s]."""
        return self._subscriptions.renewal

    def restart(self) -> None:
        """A port was opened: nothing runs."""
        self.is_on = False
        for key in list(self._borrowed):
            self._give_back(key)
        self._subscriptions.forget()

    def forget(self) -> None:
        """The board forgot what it was asked: ask again."""
        self._subscriptions.forget()

    def use_board(self, board: Board) -> None:
        """This board streams from now on; wishes it cannot fulfil wait for one that can."""
        for key in list(self._borrowed):
            self._give_back(key)
        wanted = self._subscriptions.wanted
        self._subscriptions = Subscriptions(board, self._share, renew=self._cfg.renewal)
        for key, period in wanted.items():
            if board in KINDS[key].boards:
                self._subscriptions.want(key, period)

    def want(self, key: str, interval: float, rules: LineRules, demand_of: DemandOf) -> None:
        """Change one stream [s]; 0 ends it.

        Raises:
            CommandRejectedError: no such stream, or the line cannot carry it; with the arithmetic.
        """
        streams = {**self.wanted, key: interval}
        if interval <= 0:
            del streams[key]
        else:
            kind_of(key, rules.direct)
            # What was wished is weighed where it is faster than what boards are asked for: it is refused, not bent.
            budget.check(demand_of(streams), rules, limit=self._cfg.max_line_share)
            streams[key] = round_up_interval(interval)
        self._subscriptions.want(key, interval)
        self._wishes = streams

    def request_received(
        self, message: WireMessage, board: Board, now: float, rules: LineRules, demand_of: DemandOf
    ) -> None:
        """Weigh the stream that a client's own request starts; it ends when the board would end it by itself.

        Every renewal renews all streams of a board, so one that is not known here would go on for ever.

        Raises:
            CommandRejectedError: the line cannot carry it; with the arithmetic.
        """
        stream = message.spec.stream
        if stream is None or board is not self._subscriptions.board:
            return
        key, interval = stream.key, message.interval * TICK_TIME  # type: ignore[attr-defined]  # streams have one
        if interval > 0:
            budget.check(demand_of({**self.wanted, key: interval}), rules, limit=self._cfg.max_line_share)
            before = self._borrowed[key].before if key in self._borrowed else self.wanted.get(key, 0.0)
            self._subscriptions.want(key, interval)
            self._borrowed[key] = _Borrowed(before, now + BORROWED)
        elif key in self._borrowed:
            self._give_back(key)

    def _give_back(self, key: str) -> None:
        self._subscriptions.want(key, self._borrowed.pop(key).before)

    def start(self, rules: LineRules, demand_of: DemandOf) -> list[str]:
        """Ask for the configured streams; returns those this board does not have."""
        wishes, missing = self._wishes, []
        if self._cfg.rates == "auto" and not wishes:
            wishes = budget.best_mix(rules.direct, rules, limit=self._cfg.max_line_share, demand=demand_of({}))
        for key, interval in wishes.items():
            try:
                self._subscriptions.want(key, interval)
            except CommandRejectedError:
                missing.append(key)
        self.is_on = True
        return missing

    def frame_received(self, key: str, now: float) -> None:
        """A frame of a kind arrived."""
        if key not in KINDS:
            return
        self._subscriptions.frame_received(key, now)
        seen = self._left_over.setdefault(key, deque(maxlen=LEFT_OVER))
        if key in self._subscriptions.wanted or not self.is_on:
            seen.clear()
            return
        seen.append(now)
        if len(seen) == LEFT_OVER and now - seen[0] <= LEFT_OVER_TIME:
            self._subscriptions.end(key)
            self._ended.append(key)
            seen.clear()

    def take_ended(self) -> list[str]:
        """Return the streams of another program that were ended since the last call."""
        ended, self._ended = self._ended, []
        return ended

    def due(self, now: float) -> list[QueuedTransmission]:
        """Return the requests to send now, as frames for the scheduler."""
        for key in [key for key, borrowed in self._borrowed.items() if now >= borrowed.until]:
            self._give_back(key)
        board = self._subscriptions.board
        return [
            QueuedTransmission(message.to_frame(board), Purpose.SUBSCRIPTION, now + QUEUED, board, message)
            for message in self._subscriptions.due(now)
        ]

    def next_time(self) -> float:
        """When there are requests next [s]; infinite for never."""
        times = (self._subscriptions.next_time(), *(borrowed.until for borrowed in self._borrowed.values()))
        return min(times) if self.is_on else float("inf")
