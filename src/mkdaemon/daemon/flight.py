"""The shell of the flight core: brings it what happens, and lets it decide when it wants to.

Setpoint out: Zenoh thread, `call_soon_threadsafe`, `FlightCore.feed` (newest wins), tick, `Link.send_setpoint` with a
deadline.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from pathlib import Path
from secrets import token_hex

from mkdaemon.bus.gateway import Watcher
from mkdaemon.clock import Clock, SleepWatch
from mkdaemon.control.actions import Action, ReleaseAircraft, SendSticks
from mkdaemon.control.activeset import KnownSet
from mkdaemon.control.estimator.model import ModelUnknown
from mkdaemon.control.events import (
    AbortAsked,
    ActiveSetRead,
    ClientGone,
    FrameNotSent,
    FreeDisk,
    GuardActed,
    GuardChanged,
    LeaseAsked,
    LineChanged,
    ModelKnown,
    PathUploaded,
    ReleaseAsked,
    Reply,
)
from mkdaemon.control.modes import IN_FLIGHT
from mkdaemon.daemon.deck import Deck
from mkdaemon.daemon.discovery import require_flightctrl
from mkdaemon.daemon.preflight import active_set, free_disk, read_active_set
from mkdaemon.daemon.releases import Releases
from mkdaemon.link.link import Link
from mkdaemon.link.session.traffic import ReleaseResult, SetpointQueued, SetpointRefused
from mkdaemon.telemetry.command import AbortRequest, LeaseRequest, ReleaseRequest
from mkdaemon.telemetry.control import ControlLine, Gains, LeaseState, Phase
from mkdaemon.telemetry.path import PathStored, PathUploadRequest
from mkdaemon.telemetry.preflight import PreflightReport
from mkdaemon.translate import aircraft_model, assumed_model, extern_control

SECRET_BYTES = 16
"""Length of a lease's secret: 128 bits cannot be guessed."""


class FlightControl:
    """Runs the flight core; everything happens on the loop.

    Attributes:
        ticks: how often the core has decided, for the watchdog.
    """

    def __init__(
        self,
        deck: Deck,
        link: Link,
        *,
        clock: Clock,
        records: Path | None = None,
        watch_client: Callable[[str | None, Watcher], None] = lambda name, watcher: None,
    ) -> None:
        """Wire it.

        Args:
            deck: the flight core and what translates for it.
            link: the line.
            clock: of the daemon.
            records: folder in which flights are recorded; None where none are.
            watch_client: reports the coming and going of the holder; nothing by default.
        """
        self._deck, self._core, self._link, self._audit = deck, deck.core, link, deck.audit
        self._clock, self._records = clock, records
        self._releases = Releases(deck, link, clock)
        self._line: ControlLine | None = None
        self._watch_client, self._watched = watch_client, ""
        self.ticks = 0

    @property
    def phase(self) -> Phase:
        """Phase of control."""
        return self._core.phase

    # -- what the bus brings --------------------------------------------------------------------------------------

    def client_changed(self, name: str, is_here: bool) -> None:
        """Note that a client showed or lost its liveliness token."""
        if not is_here:
            self._deck.feed(ClientGone(name), self._clock.now())

    def guard_acted(self, released: bool) -> None:
        """Note that the guard has sent something because nothing came from here."""
        if released:
            self._deck.feed(GuardActed(), self._clock.now())
        self._audit.failsafe("guard release" if released else "guard neutral", "no stick frame was written in time")

    def guard_changed(self, is_alive: bool) -> None:
        """Note whether the guard is there."""
        self._deck.feed(GuardChanged(is_alive), self._clock.now())
        self._audit.log("info" if is_alive else "error", "guard runs" if is_alive else "guard is gone: no new lease")

    async def lease(self, request: LeaseRequest) -> LeaseState | None:
        """Answer a request about the lease; None if no client holds it.

        Raises:
            CommandRejectedError: see `FlightCore` and `require_flightctrl`.
        """
        if request.action == "take":
            await require_flightctrl(self._link, self._core.vehicle.link, use_remembered=request.use_remembered)
        reply = self._ask_core(request)
        if reply.must_read_set:
            reply = self._ask_core(request, await self._read_active_set())
        if reply.refusal is not None:
            raise reply.refusal
        return reply.lease

    def _ask_core(self, request: LeaseRequest, found: KnownSet | None = None) -> Reply:
        now = self._clock.now()
        self._note_line(now)
        secret = token_hex(SECRET_BYTES) if request.action == "take" else ""
        reply = self._deck.feed(LeaseAsked(request, secret, found), now)
        self._watch_holder()
        return reply

    async def _read_active_set(self) -> KnownSet:
        """Read the active set, and how much can be recorded; the flight core learns the aircraft's model from it."""
        parameters, dialect = await read_active_set(self._link), self._link.dialect
        # With the slow leak of a NaviCtrl 2.x an aircraft is lost once that stops to correct: docs/lab/control.md.
        found, now = aircraft_model(parameters, dialect, has_slow_leak=False), self._clock.now()
        known = ModelKnown(assumed_model(dialect), found) if isinstance(found, ModelUnknown) else ModelKnown(found)
        self._deck.feed(known, now)
        self._deck.feed(FreeDisk(free_disk(self._records)), now)
        return active_set(parameters)

    async def preflight(self) -> PreflightReport:
        """Make every check before a flight and publish the report; in flight the last active set is used."""
        found = None if self._core.phase in IN_FLIGHT else await self._read_active_set()
        now = self._clock.now()
        if found is not None:
            self._deck.feed(ActiveSetRead(found), now)
        self._note_line(now)
        return self._deck.publish_preflight(now)

    async def release(self, request: ReleaseRequest) -> ReleaseResult | None:
        """Release the aircraft for any client; return the outcome, or None if it did not end in time."""
        ended = self._releases.next_end()
        self._deck.feed(ReleaseAsked(request), self._clock.now())
        return await ended

    def gains(self) -> Gains:
        """Model, gains and margins of the horizontal loop."""
        return self._core.gains()

    def store_path(self, request: PathUploadRequest) -> PathStored:
        """Store a path, for any client.

        Raises:
            CommandRejectedError: `path_refused`.
        """
        refusal = self._deck.feed(PathUploaded(request), self._clock.now()).refusal
        if refusal is not None:
            raise refusal
        assert self._core.path_stored is not None
        return self._core.path_stored

    def abort(self, request: AbortRequest) -> None:
        """Stop the present manoeuvre, for any client.

        Raises:
            CommandRejectedError: `nothing_flown`.
        """
        refusal = self._deck.feed(AbortAsked(request), self._clock.now()).refusal
        if refusal is not None:
            raise refusal

    # -- what the core decides ------------------------------------------------------------------------------------

    async def run(self) -> None:
        """Tick for ever, each time the core wants to."""
        sleep = SleepWatch(self._clock)
        async with asyncio.TaskGroup() as tasks:
            while True:
                await self._wait()
                self.ticks += 1
                now = self._clock.now()
                self._note_line(now)
                for action in self._deck.tick(now, slept=sleep.take()):
                    self._carry_out(action, now, tasks)
                self._watch_holder()

    def _watch_holder(self) -> None:
        """Watch for the holder's end alone."""
        key = self._deck.holder_key
        name = "" if key is None else key.holder
        if name != self._watched:
            self._watched = name
            self._watch_client(name or None, self.client_changed)

    async def _wait(self) -> None:
        """Wait until the core wants to tick; news may bring that forward."""
        news, loop = self._deck.news, asyncio.get_running_loop()
        while (left := self._core.next_time() - self._clock.now()) > 0:
            news.clear()
            timer = loop.call_later(left, news.set)
            try:
                await news.wait()
            finally:
                timer.cancel()

    def _note_line(self, now: float) -> None:
        """Tell the core what the line can take, where that has changed."""
        line = self._link.control_line()
        if line != self._line:
            self._line = line
            self._deck.feed(LineChanged(line), now)

    def _carry_out(self, action: Action, now: float, tasks: asyncio.TaskGroup) -> None:
        """Carry out one action of a tick; slow ones continue in their own task."""
        match action:
            case SendSticks():
                self._send(action, now)
            case ReleaseAircraft():
                self._releases.begin(action.reason, tasks)
            case _:
                self._deck.publish(action, now)

    def _send(self, order: SendSticks, now: float) -> None:
        """Hand a stick frame to the line; the core hears of one that the line does not take."""
        fate = self._link.send_setpoint(
            lambda layout, number: extern_control(layout, order.counts, number), deadline=order.deadline
        )
        match fate:
            case SetpointQueued():
                self._deck.publish_output(order, fate.number, now)
            case SetpointRefused():
                self._deck.feed(FrameNotSent(fate.refusal), now)
