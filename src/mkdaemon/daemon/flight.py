"""The shell of the flight core: brings it what happens, and lets it decide when it wants to.

Setpoint out: Zenoh thread, `call_soon_threadsafe`, `FlightCore.setpoint` (newest wins), tick, `Link.send_setpoint` with
a deadline.
"""

from __future__ import annotations

import asyncio
from contextlib import suppress
from pathlib import Path

from mkdaemon.bus.codec import Payload, TooLong, check_command, decode_map
from mkdaemon.clock import Clock, SleepWatch
from mkdaemon.control.actions import (
    ReadGate,
)
from mkdaemon.control.activeset import ActiveSet
from mkdaemon.control.core import FlightCore
from mkdaemon.control.estimator.model import ModelUnknown
from mkdaemon.control.modes import IN_FLIGHT
from mkdaemon.daemon.audit import Audit, Outlet
from mkdaemon.daemon.discovery import require_flightctrl
from mkdaemon.daemon.orders import Orders
from mkdaemon.daemon.preflight import active_set, free_disk, read_active_set
from mkdaemon.daemon.releases import Releases
from mkdaemon.errors import CommandRejectedError
from mkdaemon.link.link import Link
from mkdaemon.link.session.traffic import ReleaseResult
from mkdaemon.telemetry.command import AbortRequest, LeaseRequest, ReleaseRequest
from mkdaemon.telemetry.control import (
    Gains,
    LeaseState,
    Phase,
)
from mkdaemon.telemetry.preflight import ControlPreflight, PreflightReport
from mkdaemon.telemetry.setpoint import Setpoint
from mkdaemon.telemetry.signature import Signature
from mkdaemon.translate import aircraft_model, assumed_model


class FlightControl:
    """Runs the flight core; everything happens on the loop.

    Attributes:
        ticks: how often the core has decided, for the watchdog.
    """

    def __init__(
        self,
        core: FlightCore,
        link: Link,
        bus: Outlet,
        audit: Audit,
        *,
        clock: Clock,
        records: Path | None = None,
    ) -> None:
        """Wire it; `records` is the folder in which flights are recorded, None where none are."""
        self._core, self._link, self._bus, self._audit = core, link, bus, audit
        self._clock, self._records = clock, records
        self._news = asyncio.Event()
        core.pacing.on_news = self._news.set
        self._releases = Releases(core, link, audit, clock)
        self._orders = Orders(link, bus, audit, self._releases, clock)
        self.ticks = 0

    @property
    def phase(self) -> Phase:
        """Where authority stands."""
        return self._core.phase

    # -- what the bus brings --------------------------------------------------------------------------------------

    def setpoint_arrived(
        self, kind: type[Setpoint], arrived: float, payload: Payload, proof: bytes
    ) -> CommandRejectedError | None:
        """Take a streamed setpoint; one that is refused is counted and reported.

        Args:
            kind: what the key carries.
            arrived: [s; monotonic].
            payload: as it came.
            proof: its attachment; see `telemetry.signature`.

        Returns:
            Why it was refused; None where it was taken.
        """
        fields = {"bytes": payload.size if isinstance(payload, TooLong) else len(payload)}
        try:
            fields = decode_map(payload)
            setpoint = check_command(kind, fields)
        except CommandRejectedError as error:
            self._core.setpoint_refused(kind.suffix, fields, error, arrived)
            return error
        assert isinstance(payload, bytes)
        return self._core.setpoint(setpoint, arrived, Signature(kind.suffix, payload, proof))

    def is_signed_by_holder(self, kind: type[Setpoint], payload: Payload, proof: bytes) -> bool:
        """Whether a setpoint comes from who holds the lease; from any thread."""
        return isinstance(payload, bytes) and self._core.is_signed_by_holder(Signature(kind.suffix, payload, proof))

    def client_changed(self, name: str, is_here: bool) -> None:
        """Note that a client showed or lost its liveliness token."""
        if not is_here:
            self._core.client_gone(name)

    def guard_acted(self, released: bool) -> None:
        """Note that the guard has sent something because nothing came from here."""
        if released:
            self._core.guard_acted()
        self._audit.failsafe("guard release" if released else "guard neutral", "no stick frame was written in time")

    def guard_changed(self, is_alive: bool) -> None:
        """Note whether the guard is there."""
        self._core.guard_changed(is_alive=is_alive)
        self._audit.log("info" if is_alive else "error", "guard runs" if is_alive else "guard is gone: no new lease")

    async def lease(self, request: LeaseRequest) -> LeaseState | None:
        """Answer a request about the lease; None for nobody.

        Raises:
            CommandRejectedError: see `FlightCore.lease` and `require_flightctrl`.
        """
        if request.action == "take":
            await require_flightctrl(self._link, self._core.facts.link, use_remembered=request.use_remembered)
        granted = self._ask_core(request)
        if isinstance(granted, ReadGate):
            granted = self._ask_core(request, await self._read_active_set())
        assert not isinstance(granted, ReadGate)
        return granted

    def _ask_core(self, request: LeaseRequest, found: ActiveSet | None = None) -> LeaseState | ReadGate | None:
        self._core.line_changed(self._link.control_line())
        return self._core.lease(request, self._clock.now(), found=found)

    async def _read_active_set(self) -> ActiveSet:
        """Read the active set, and how much can be recorded; the flight core learns the aircraft's model from it."""
        self._core.facts.free_disk = free_disk(self._records)
        parameters, dialect = await read_active_set(self._link), self._link.dialect
        # Flown with the slow leak of a NaviCtrl 2.x, an aircraft is lost once that stops to correct: docs/control.md.
        found = aircraft_model(parameters, dialect, has_slow_leak=False)
        if isinstance(found, ModelUnknown):
            self._core.model_known(assumed_model(dialect), found)
        else:
            self._core.model_known(found)
        return active_set(parameters)

    async def preflight(self) -> PreflightReport:
        """Make every check before a flight, and publish what was found; in flight nothing is read anew."""
        found = None if self._core.phase in IN_FLIGHT else await self._read_active_set()
        self._core.line_changed(self._link.control_line())
        report = self._core.preflight(self._clock.now(), found)
        self._bus.publish("control/preflight", ControlPreflight(stamp=self._clock.stamp(), **dict(report)))
        return report

    async def release(self, request: ReleaseRequest) -> ReleaseResult | None:
        """Release the aircraft, whoever asks; returns how it went, None where it had no end in time."""
        ended = self._releases.next_end()
        self._core.release(request)
        return await ended

    def gains(self) -> Gains:
        """Model, gains and margins of the horizontal loop."""
        return self._core.gains()

    def abort(self, request: AbortRequest) -> None:
        """Stop the manoeuvre that is flown, whoever asks.

        Raises:
            CommandRejectedError: `nothing_flown`.
        """
        self._core.abort(request)

    # -- what the core decides ------------------------------------------------------------------------------------

    async def run(self) -> None:
        """Tick for ever, each time the core wants to."""
        sleep = SleepWatch(self._clock)
        async with asyncio.TaskGroup() as tasks:
            while True:
                await self._wait()
                self.ticks += 1
                now = self._clock.now()
                self._core.line_changed(self._link.control_line())
                for action in self._core.tick(now, slept=sleep.take()):
                    self._orders.carry_out(action, tasks)

    async def _wait(self) -> None:
        """Wait until the core wants to tick; news may bring that forward."""
        while (left := self._core.next_time() - self._clock.now()) > 0:
            self._news.clear()
            with suppress(TimeoutError):
                async with asyncio.timeout(left):
                    await self._news.wait()
