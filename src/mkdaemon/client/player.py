"""Puts the published values of a recording on the bus again, at their times, and counts what it put.

Only publishers of `PlayKey`s are ever declared, and what is asked is answered with them; there is no port and no
setpoint here, and no command is obeyed. A thread puts, and another one reads ahead: the event loop, which draws and
listens to keys, makes no value late.
"""

from __future__ import annotations

import asyncio
import threading
import time
from collections.abc import AsyncIterator, Callable, Iterator, Sequence
from contextlib import ExitStack, asynccontextmanager, closing, contextmanager, suppress
from itertools import chain, islice
from pathlib import Path
from typing import Final

import zenoh

from mkdaemon.bus.callbacks import direct
from mkdaemon.bus.codec import encode, encoding_of
from mkdaemon.bus.names import REPLAY, ROOT, received_vehicle
from mkdaemon.bus.session import close_session, open_session, session_config
from mkdaemon.client.playcontrol import answer_controls
from mkdaemon.client.playedvalues import PlayedValues
from mkdaemon.client.playselection import STEP, Played, PlayedCounts, PlayKey, PlaySelection, read_ahead
from mkdaemon.client.taskerrors import background
from mkdaemon.errors import MkError
from mkdaemon.telemetry.play import PlayAction, PlayControl, PlayState, PlayStatus

SLOWEST: Final = 1 / 64
FASTEST: Final = 1024.0


class PlayPace:
    """Turns times of a recording into times at which they are played.

    Attributes:
        speed: seconds of the recording a second.
        is_paused: whether time stands still, but for steps.
    """

    def __init__(self, speed: float, began_at: float, now: float, *, is_paused: bool = False) -> None:
        """Begin.

        Args:
            speed: seconds of the recording a second.
            began_at: first time of the recording [s].
            now: [s].
            is_paused: begin with time that stands still.
        """
        self.speed = speed
        self.is_paused = is_paused
        self._place, self._since = began_at, now
        self._steps = 0

    def place(self, now: float) -> float:
        """Where in the recording it is [s]."""
        return self._place if self.is_paused else self._place + (now - self._since) * self.speed

    def wait(self, at: float, now: float) -> float | None:
        """Time until a value of the recording is due [s], at most 0 when it is; None while paused.

        Args:
            at: its time in the recording [s].
            now: [s].
        """
        if not self.is_paused:
            return (at - self.place(now)) / self.speed
        if self._steps == 0:
            return None
        self._steps -= 1
        self._place = max(self._place, at)
        return 0.0

    def toggle(self, now: float) -> None:
        """Pause, or go on."""
        self._hold(now)
        self.is_paused = not self.is_paused
        self._steps = 0

    def step(self, now: float) -> None:
        """Play one value and pause."""
        self._hold(now)
        self.is_paused = True
        self._steps += 1

    def change_speed(self, factor: float, now: float) -> None:
        """Play faster or slower from now on."""
        self.play_at(self.speed * factor, now)

    def play_at(self, speed: float, now: float) -> None:
        """Play this number of recorded seconds a second from now on."""
        self._hold(now)
        self.speed = min(max(speed, SLOWEST), FASTEST)

    def restart(self, began_at: float, now: float) -> None:
        """Go on at another time of the recording [s]."""
        self._place, self._since = began_at, now

    def _hold(self, now: float) -> None:
        self._place, self._since = self.place(now), now


@asynccontextmanager
async def open_player_session(
    *, connect: Sequence[str], listen: str | None, zenoh_file: Path | None = None, alone: bool = False
) -> AsyncIterator[zenoh.Session]:
    """Open a session for a player of recordings, and close it on leaving.

    Args:
        connect: endpoint of a daemon or of a router, where clients meet.
        listen: endpoint for clients, where nothing else is there.
        zenoh_file: Zenoh configuration, for TLS.
        alone: connect to no daemon: the viewer is in this process.

    Raises:
        MkError: no daemon listens at the endpoint, or the one to listen at is in use.
        ConfigError: an endpoint or the file cannot be understood.
    """
    if alone:
        config = session_config("peer")
    elif listen is None:
        config = session_config("client", connect=connect, zenoh_file=zenoh_file)
    else:
        config = session_config("peer", listen=[listen], zenoh_file=zenoh_file)
    session = await open_session(config, listen=() if listen is None else [listen])
    try:
        yield session
    finally:
        await close_session(session)


SETTLE: Final = 0.3
"""After the first subscriber has come: time for its other subscriptions [s]."""
STATUS_PERIOD: Final = 0.5
"""Of the status on the bus [s]."""
LOOK_AROUND: Final = 1.0
"""Time in which a live daemon has to answer [s]."""
FINE: Final = 0.002
"""The last part of a wait, for which the thread sleeps without listening to changes [s]."""


class Player:
    """Plays one selection.

    Attributes:
        pace: speed and pause; changed by `adjust` only.
        sent: what was put in this round.
        rounds: how often the end was reached.
        was_sought: a client moved the playback, so the published values are not the whole recording.
    """

    def __init__(self, session: zenoh.Session, selection: PlaySelection, pace: PlayPace, title: str) -> None:
        """Prepare; `play` does the work."""
        self.pace = pace
        self.sent = PlayedCounts()
        self.rounds = 0
        self.was_sought = False
        self._session, self._selection, self._title = session, selection, title
        self._publishers: dict[PlayKey, zenoh.Publisher] = {}
        self._values = PlayedValues(session, selection, self._place)
        self._turn = threading.Condition(threading.RLock())
        self._is_stopped = self._is_waiting = self._is_over = False
        self._sought: float | None = None
        self._starts = 0
        self._watched = asyncio.Event()
        self._loop = asyncio.get_running_loop()
        self._found: set[str] = set()
        roots = {key.rpartition("/")[0].split("/")[1] for key in selection.counts}
        self._name = min(roots)
        self._status = session.declare_publisher(f"{REPLAY}/status/{self._name}")

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
        alive = {received_vehicle(str(reply.ok.key_expr)) for reply in replies if reply.ok is not None}
        self._refuse(names & alive)

    @contextmanager
    def answering(self) -> Iterator[None]:
        """Answer, while the context lasts, as the vehicle did at the place of the recording that is played."""

        def on_question() -> None:
            with suppress(RuntimeError):  # the loop may be closing
                self._loop.call_soon_threadsafe(self._watched.set)

        with self._values.answering(on_question), answer_controls(self._session, self._name, self._control):
            yield

    def _control(self, control: PlayControl) -> PlayStatus:
        """Carry out a request; runs on the thread that answers it."""
        match control.action:
            case PlayAction.STEP:
                self.adjust(lambda pace, now: pace.step(now))
            case PlayAction.SPEED:
                self.adjust(lambda pace, now: pace.play_at(control.speed, now))
            case PlayAction.SEEK:
                self.seek(control.place)
            case _:
                is_wanted = control.action is PlayAction.PAUSE
                self.adjust(lambda pace, now: pace.toggle(now) if pace.is_paused is not is_wanted else None)
        self._show_status()
        return self.status()

    async def wait_for_subscribers(self) -> None:
        """Return as soon as a client subscribes to what will be played or queries it, or when `stop` is called."""

        def on_change(status: zenoh.MatchingStatus) -> None:
            if status.matching:
                self._loop.call_soon_threadsafe(self._watched.set)

        roots = {"/".join(key.split("/")[:2]) for key in self._selection.counts}
        self._is_waiting = True
        with ExitStack() as stack:
            for root in roots:
                publisher = stack.enter_context(self._session.declare_publisher(f"{root}/**"))
                handler = direct(on_change)
                stack.enter_context(publisher.declare_matching_listener(handler))
                present: zenoh.MatchingStatus = publisher.matching_status  # type: ignore[assignment]  # the stub errs
                if present.matching:
                    self._watched.set()
            try:
                await self._watched.wait()
            finally:
                self._is_waiting = False
            if not self._is_stopped:
                await asyncio.sleep(SETTLE)

    # -- playing --------------------------------------------------------------------------------------------------

    async def play(self, *, loops: bool = False, stays: bool = False) -> None:
        """Put everything, once or for ever; `stop` ends it.

        Args:
            loops: begin again at the end.
            stays: wait at the end for another place that is asked for.

        Raises:
            MkError: a daemon came up under a name that is played under; or the recording cannot be read any more.
        """
        for key in set(self._selection.keys.values()):
            # A player may wait for a slow subscriber; what it must not do is to leave something out.
            block = zenoh.CongestionControl.BLOCK
            self._publishers[key] = self._session.declare_publisher(key.whole, congestion_control=block)
        async with self._watching_daemons(), background(self._report()):
            while not self._is_stopped:
                self.sent = PlayedCounts()
                await self._put_in_thread(stays and not loops)
                self._refuse(self._found)
                self.rounds += not self._is_stopped
                if not loops:
                    break
        self._show_status(PlayState.STOPPED if self._is_stopped else PlayState.ENDED)

    def stop(self) -> None:
        """End it before the next value, or while it waits for subscribers."""
        with self._turn:
            self._is_stopped = True
            self._turn.notify()
        self._watched.set()

    def adjust(self, change: Callable[[PlayPace, float], object]) -> None:
        """Change the pace.

        Args:
            change: does it, by the present time [s].
        """
        with self._turn:
            change(self.pace, time.monotonic())
            self._turn.notify()

    @property
    def missing(self) -> dict[str, int]:
        """Values that are in the file and were not put in this round, by key."""
        wanted, sent = self._selection.counts, self.sent.counts
        return {key: wanted[key] - sent[key] for key in wanted.keys() | sent.keys() if wanted[key] != sent[key]}

    def seek(self, place: float) -> None:
        """Go on at another place, paused or not; the newest wish counts.

        Args:
            place: since the beginning of what is played [s].
        """
        first, last = self._selection.first, self._selection.last
        with self._turn:
            self._sought = min(max(first + place, first), last)
            self.was_sought = True
            self._turn.notify()

    async def _put_in_thread(self, stays: bool) -> None:
        """Put everything once; ends with the thread, also where this task is cancelled."""
        putting = asyncio.ensure_future(asyncio.to_thread(self._put_all, stays))
        try:
            await asyncio.shield(putting)
        except asyncio.CancelledError:
            self.stop()
            await putting
            raise

    def _put_all(self, stays: bool) -> None:
        at: float | None = self._selection.first
        while at is not None:
            self._put_from(at)
            at = self._next_place(stays)

    def _put_from(self, at: float) -> None:
        """Put everything from a time on [s; Unix time], until another place is asked for."""
        with closing(read_ahead(self._selection.played(at))) as ahead:
            first = tuple(islice(ahead, 1))  # time runs from when some of it has been read
            self._values.restart(at)
            with self._turn:
                self._starts += 1
                self.pace.restart(at, time.monotonic())
                self._show_status()
            for played in chain(first, ahead):
                if not self._wait_until_due(played.at):
                    return
                self._put(played)

    def _next_place(self, stays: bool) -> float | None:
        """The place that is asked for [s; Unix time], which is waited for at the end if it `stays`; None to end."""
        with self._turn:
            if stays and self._sought is None and not self._is_stopped:
                self._is_over = True
                self._show_status()
                self._turn.wait_for(lambda: self._sought is not None or self._is_stopped or self._found)
                self._is_over = False
            if self._is_stopped or self._found or self._sought is None:
                return None
            place, self._sought = self._sought, None
            self.pace.restart(place, time.monotonic())
            return place

    def _wait_until_due(self, at: float) -> bool:
        """Wait for the time of a value; false when playing was stopped, or another place is asked for."""
        while True:
            with self._turn:
                if self._is_stopped or self._found or self._sought is not None:
                    return False
                left = self.pace.wait(at, time.monotonic())
                if left is not None and left <= 0:
                    if not self.pace.is_paused:
                        self.sent.late[int(-left / STEP)] += 1
                    return True
                if left is None or left > FINE:
                    self._turn.wait(None if left is None else left - FINE / 2)
                    continue
            time.sleep(left)

    def _put(self, played: Played) -> None:
        self._values.take(played)
        self._publishers[played.key].put(played.entry.payload, encoding=played.entry.encoding)
        self.sent.counts[played.key.whole] += 1

    # -- what it tells --------------------------------------------------------------------------------------------

    def status(self, state: PlayState | None = None) -> PlayStatus:
        """What the player does; whether it waits, plays or pauses, if no state is given."""
        first, last = self._selection.first, self._selection.last
        with self._turn:
            is_paused, speed, starts = self.pace.is_paused, self.pace.speed, self._starts
        moving = PlayState.WAITING if self._is_waiting else PlayState.ENDED if self._is_over else PlayState.PLAYING
        return PlayStatus(
            file=self._title,
            state=state or (PlayState.PAUSED if is_paused and not self._is_over else moving),
            speed=speed,
            place=0.0 if self._is_waiting else self._place() - first,
            length=last - first,
            sent=self.sent.total,
            values=self._selection.total,
            zero=self._selection.zero,
            starts=starts,
        )

    def _place(self) -> float:
        """How far the recording has come [s; Unix time]."""
        with self._turn:
            place = self._sought or self.pace.place(time.monotonic())
        return min(max(place, self._selection.first), self._selection.last)

    def _show_status(self, state: PlayState | None = None) -> None:
        with self._turn:  # so that an older one is never put after a newer one
            self._status.put(encode(self.status(state)), encoding=encoding_of(PlayStatus))

    async def _report(self) -> None:
        """Publish the status twice a second."""
        while True:
            self._show_status()
            await asyncio.sleep(STATUS_PERIOD)

    @asynccontextmanager
    async def _watching_daemons(self) -> AsyncIterator[None]:
        """Hear of daemons that come up meanwhile, and end playing then."""
        names = self._selection.vehicles

        def on_token(sample: zenoh.Sample) -> None:
            name = received_vehicle(str(sample.key_expr))
            if sample.kind == zenoh.SampleKind.PUT and name is not None and name in names:
                with self._turn:
                    self._found.add(name)
                    self._turn.notify()

        handler = direct(on_token)
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
