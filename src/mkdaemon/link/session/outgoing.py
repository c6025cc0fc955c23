"""What is sent: gathers what is due, lets the scheduler order it, and tells who asked what became of it. Pure."""

from __future__ import annotations

import math

from mkdaemon.link.session.controlpath import ControlEntry
from mkdaemon.link.session.counters import Counters
from mkdaemon.link.session.health import HealthMonitor
from mkdaemon.link.session.peers import Peers
from mkdaemon.link.session.prober import Prober
from mkdaemon.link.session.questions import Questions
from mkdaemon.link.session.requests import Pending
from mkdaemon.link.session.scheduler import Entry, TransmitScheduler
from mkdaemon.link.session.steering import Steering
from mkdaemon.link.session.streams import Streams
from mkdaemon.link.session.traffic import Purpose
from mkdaemon.protocol.boards import Board


class Outgoing:
    """Everything that wants to be sent on one line."""

    def __init__(
        self,
        scheduler: TransmitScheduler,
        peers: Peers,
        health: HealthMonitor,
        counters: Counters,
        *,
        questions: Questions,
        steering: Steering,
        streams: Streams,
        prober: Prober,
    ) -> None:
        """Gather from `questions`, `steering`, `streams` and `prober`, in that order."""
        self._scheduler = scheduler
        self._peers = peers
        self._health = health
        self._counters = counters
        self._questions = questions
        self._steering = steering
        self._streams = streams
        self._prober = prober
        self._discarded: list[Entry] = []

    def poll(self, now: float) -> list[Entry]:
        """Return what to write now, in order."""
        self._questions.step(now)
        self._drop_expired(now)
        self._steering.step(now)
        self._ask_for_streams(now)
        if now >= self._probe_time():
            self._scheduler.submit(self._prober.make(self._peers.direct, now), now)
        out: list[Entry] = []
        while (entry := self._scheduler.take(now)) is not None:
            self._note_sent(entry, now)
            out.append(entry)
        return out

    def next_time(self, now: float) -> float:
        """When to poll again [s]."""
        times = [
            self._scheduler.next_time(now) or math.inf,
            self._questions.book.next_time(),
            self._steering.next_time(),
            self._probe_time(),
        ]
        if self._peers.redirected is None:
            times.append(self._streams.next_time())
        return min(times)

    def take_discarded(self) -> list[Entry]:
        """Return what was never sent since the last call."""
        discarded, self._discarded = self._discarded, []
        return discarded

    def _drop_expired(self, now: float) -> None:
        for entry in self._scheduler.take_expired():
            if entry.purpose is Purpose.ECHO:
                self._prober.dropped()
            if isinstance(entry.tag, Pending):
                self._questions.never_sent(entry.tag, now)
            self._counters.expired()
            self._discarded.append(entry)

    def _ask_for_streams(self, now: float) -> None:
        if self._peers.redirected is not None or now < self._streams.next_time():
            return
        for entry in self._streams.due(now):
            self._scheduler.submit(entry, now)
        self._health.wanted(self._peers.direct.word, self._streams.wanted, now)

    def _probe_time(self) -> float:
        """When the next link test is due [s]; infinite while nobody could answer it."""
        nobody_answers = self._peers.direct is Board.ANY or self._peers.redirected is not None
        return math.inf if nobody_answers else self._prober.next_time()

    def _note_sent(self, entry: Entry, now: float) -> None:
        self._counters.sent(entry)
        if isinstance(entry.tag, Pending):
            self._questions.sent(entry.tag, now)
        elif entry.purpose is Purpose.ECHO:
            self._prober.sent(entry, now)
        elif isinstance(entry, ControlEntry):
            self._steering.sent(entry, now)
