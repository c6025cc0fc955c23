"""Puts the published values of a recording on the bus again, at their times, and counts what it put.

Only publishers of `PlayKey`s are ever declared; there is no port, no query and no setpoint here.
"""

from __future__ import annotations

import asyncio
from collections import Counter
from collections.abc import AsyncIterator, Callable, Iterable, Iterator
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from typing import Final

import zenoh

from mkdaemon.bus.codec import encode, encoding_of
from mkdaemon.bus.names import ROOT
from mkdaemon.client.playkeys import REPLAY, PlayKey, play_key
from mkdaemon.client.playpace import Pace
from mkdaemon.errors import MkError
from mkdaemon.record.entry import Entry
from mkdaemon.telemetry.play import PlayState, PlayStatus

SETTLE: Final = 0.3
"""After the first subscriber has come: time for its other subscriptions [s]."""
LOOK: Final = 0.05
"""Longest time between two looks at the pace and at live daemons [s]."""
STATUS_PERIOD: Final = 0.5
"""Of the status on the bus [s]."""
LOOK_AROUND: Final = 1.0
"""Time in which a live daemon has to answer [s]."""


@dataclass(slots=True)
class Sent:
    """What was put.

    Attributes:
        counts: values by key, as played.
        late: how late each was put, at its speed [s].
    """

    counts: Counter[str] = field(default_factory=Counter)
    late: list[float] = field(default_factory=list)

    def late_p99(self) -> float | None:
        """99th percentile of the lateness [s]; None where nothing was put."""
        if not self.late:
            return None
        return sorted(self.late)[min(int(0.99 * len(self.late)), len(self.late) - 1)]


@dataclass(frozen=True, slots=True)
class Selection:
    """Which part of a recording is played.

    Attributes:
        entries: gives all entries of it, in order, every time it is called.
        counts: values by key, as played.
        first: time of its beginning [s; Unix time].
        last: of its end [s; Unix time].
    """

    entries: Callable[[], Iterator[tuple[float, PlayKey, Entry]]]
    counts: Counter[str]
    first: float
    last: float

    @classmethod
    def of(cls, entries: Callable[[], Iterable[Entry]], name: str | None) -> Selection:
        """Look through a recording once.

        Args:
            entries: gives the entries, every time it is called.
            name: vehicle to play as; None for `replay/<vehicle>/...`.

        Raises:
            MkError: there is nothing to play.
        """

        def played() -> Iterator[tuple[float, PlayKey, Entry]]:
            for entry in entries():
                key = play_key(entry.key, name)
                if key is not None:
                    yield entry.base.file_time(entry.received) / 1e9, key, entry

        counts: Counter[str] = Counter()
        first, last = float("inf"), float("-inf")
        for at, key, _ in played():
            counts[key.whole] += 1
            first, last = min(first, at), max(last, at)
        if not counts:
            msg = "nothing to play: no published value in this part of the recording; `mkctl log info` shows its keys"
            raise MkError(msg)
        return cls(played, counts, first, last)

    @property
    def vehicles(self) -> set[str]:
        """Names under `mk/` that values are put under."""
        parts = (key.split("/") for key in self.counts)
        return {vehicle for root, vehicle, *_ in parts if root == ROOT}


class Player:
    """Plays one selection.

    Attributes:
        pace: speed and pause.
        sent: what was put so far, in this round.
        rounds: how often the end was reached.
    """

    def __init__(self, session: zenoh.Session, selection: Selection, pace: Pace, title: str) -> None:
        """Prepare; `play` does the work."""
        self.pace = pace
        self.sent = Sent()
        self.rounds = 0
        self._session, self._selection, self._title = session, selection, title
        self._publishers: dict[PlayKey, zenoh.Publisher] = {}
        self._changed = asyncio.Event()
        self._is_stopped = False
        self._found: set[str] = set()
        self._status_at = float("-inf")
        roots = {key.rpartition("/")[0].split("/")[1] for key in selection.counts}
        self._status = session.declare_publisher(f"{REPLAY}/status/{min(roots)}")

    # -- before ---------------------------------------------------------------------------------------------------

    async def refuse_live_daemons(self) -> None:
        """Make sure that no daemon lives under a name that is played under.

        Raises:
            MkError: one does.
        """
        names = self._selection.vehicles
        if not names:
            return
        ask = self._session.liveliness().get
        replies = await asyncio.to_thread(lambda: list(ask(f"{ROOT}/*/alive", timeout=LOOK_AROUND)))
        alive = {str(reply.ok.key_expr).split("/")[1] for reply in replies if reply.ok is not None}
        self._refuse(names & alive)

    async def wait_for_subscribers(self) -> None:
        """Return as soon as anybody subscribes to what will be played."""
        watched, loop = asyncio.Event(), asyncio.get_running_loop()

        def on_change(status: zenoh.MatchingStatus) -> None:
            if status.matching:
                loop.call_soon_threadsafe(watched.set)

        roots = {"/".join(key.split("/")[:2]) for key in self._selection.counts}
        publishers = [self._session.declare_publisher(f"{root}/**") for root in roots]
        listeners = []
        for publisher in publishers:
            listeners.append(publisher.declare_matching_listener(zenoh.handlers.Callback(on_change, indirect=False)))
            present: zenoh.MatchingStatus = publisher.matching_status  # type: ignore[assignment]  # the stub errs
            if present.matching:
                watched.set()
        await watched.wait()
        await asyncio.sleep(SETTLE)
        for listener in listeners:
            listener.undeclare()  # type: ignore[no-untyped-call]
        for publisher in publishers:
            publisher.undeclare()  # type: ignore[no-untyped-call]

    # -- playing --------------------------------------------------------------------------------------------------

    async def play(self, *, loops: bool = False) -> None:
        """Put everything, once or for ever; `stop` ends it.

        Raises:
            MkError: a daemon came up under a name that is played under.
        """
        async with self._watching_daemons():
            while not self._is_stopped:
                self.sent = Sent()
                self.pace.restart(self._selection.first, self._now())
                for at, key, entry in self._selection.entries():
                    if not await self._wait_until_due(at):
                        break
                    self._put(at, key, entry)
                self.rounds += not self._is_stopped
                if not loops:
                    break
        self._show_status(PlayState.STOPPED if self._is_stopped else PlayState.ENDED, is_due=True)

    def stop(self) -> None:
        """End it before the next value."""
        self._is_stopped = True
        self._changed.set()

    def changed(self) -> None:
        """Note that the pace was changed."""
        self._changed.set()

    @property
    def missing(self) -> dict[str, int]:
        """Values that are in the file and were not put in this round, by key."""
        wanted, sent = self._selection.counts, self.sent.counts
        return {key: wanted[key] - sent[key] for key in wanted.keys() | sent.keys() if wanted[key] != sent[key]}

    async def _wait_until_due(self, at: float) -> bool:
        """Wait for the time of a value; false when playing was stopped."""
        while True:
            self._refuse(self._found)
            if self._is_stopped:
                return False
            left = self.pace.wait(at, self._now())
            self._show_status(PlayState.PAUSED if self.pace.is_paused else PlayState.PLAYING)
            if left is not None and left <= 0:
                if not self.pace.is_paused:
                    self.sent.late.append(-left)
                return True
            self._changed.clear()
            try:
                async with asyncio.timeout(LOOK if left is None else min(left, LOOK)):
                    await self._changed.wait()
            except TimeoutError:
                continue

    def _put(self, at: float, key: PlayKey, entry: Entry) -> None:
        publisher = self._publishers.get(key)
        if publisher is None:
            # A player may wait for a slow subscriber; what it must not do is to leave something out.
            block = zenoh.CongestionControl.BLOCK
            publisher = self._publishers[key] = self._session.declare_publisher(key.whole, congestion_control=block)
        publisher.put(entry.payload, encoding=entry.encoding)
        self.sent.counts[key.whole] += 1

    def _show_status(self, state: PlayState, *, is_due: bool = False) -> None:
        now = self._now()
        if not is_due and now < self._status_at:
            return
        self._status_at = now + STATUS_PERIOD
        status = self.status(state)
        self._status.put(encode(status), encoding=encoding_of(PlayStatus))

    def status(self, state: PlayState) -> PlayStatus:
        """What the player does."""
        first, last = self._selection.first, self._selection.last
        return PlayStatus(
            file=self._title,
            state=state,
            speed=self.pace.speed,
            place=min(max(self.pace.place(self._now()) - first, 0.0), last - first),
            length=last - first,
            sent=self.sent.counts.total(),
            values=self._selection.counts.total(),
        )

    @asynccontextmanager
    async def _watching_daemons(self) -> AsyncIterator[None]:
        """Hear of daemons that come up meanwhile."""
        names, loop = self._selection.vehicles, asyncio.get_running_loop()

        def on_token(sample: zenoh.Sample) -> None:
            name = str(sample.key_expr).split("/")[1]
            if sample.kind == zenoh.SampleKind.PUT and name in names:
                loop.call_soon_threadsafe(self._found.add, name)

        handler = zenoh.handlers.Callback(on_token, indirect=False)
        subscriber = self._session.liveliness().declare_subscriber(f"{ROOT}/*/alive", handler)
        try:
            yield
        finally:
            subscriber.undeclare()  # type: ignore[no-untyped-call]

    @staticmethod
    def _refuse(alive: set[str]) -> None:
        if alive:
            name = min(alive)
            msg = (
                f"a daemon is alive as {name}: its clients would take the recording for the aircraft; "
                f"play without --as, or --as {name}-replay"
            )
            raise MkError(msg)

    @staticmethod
    def _now() -> float:
        return asyncio.get_running_loop().time()
