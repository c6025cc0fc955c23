"""Flying for ground stations: the gateway takes the lease when a station asks to fly, and returns it after the flight.

A ground station flies in two ways. It orders a manoeuvre (take-off, landing, hold, a place): the gateway streams it
for as long as that program beats (`stations.SILENCE`) and its connection stands. Or it streams its own setpoints:
each is handed on at once and as it came, none is repeated, so its silence is the silence of a client: level after
0.3 s, released after 1.0 s (docs/safety.md).
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, Final

from mkdaemon.client import Vehicle
from mkdaemon.client.asking import client_name
from mkdaemon.client.leasekeeper import LeaseKeeper
from mkdaemon.client.session import ENGAGING, RATE, SIGHTING, RepeatedSetpoint, SessionState
from mkdaemon.errors import CommandRejectedError, LeaseLostError, ManoeuvreError, MkError, NotEngagedError
from mkdaemon.gateways.faults import Faults
from mkdaemon.gateways.mavlink.modes import Mode
from mkdaemon.gateways.mavlink.stations import By
from mkdaemon.gateways.mavlink.texts import INFO, WARNING
from mkdaemon.telemetry.control import Outcome

PERIOD: Final = 1.0 / RATE
"""Between two setpoints of a manoeuvre [s]."""
STREAMED: Final = 0.5
"""A ground station streams while its last setpoint is not older than that [s]."""
_STOPPING: Final = frozenset({"hold", "land"})
"""Manoeuvres that another ground station than the one that flies may order too: they end what is flown."""

_ITS_FLIGHT: Final = "another ground station may order hold or landing, nothing else"
Announce = Callable[[int, str], None]
"""Sends a text to every station: severity and words."""


@dataclass(frozen=True, slots=True)
class Order:
    """What is flown for a ground station.

    Attributes:
        by: who asked.
        kind: last word of a key `setpoint/<kind>`; of a stream that of its last setpoint.
        fields: of the setpoint.
        is_streamed: the ground station sends the setpoints itself.
        mode: shown for it; None for the one that follows from what is flown.
    """

    by: By
    kind: str
    fields: Mapping[str, Any] = field(default_factory=dict)
    is_streamed: bool = False
    mode: Mode | None = None

    @property
    def needs_target(self) -> bool:
        """Whether it is flown by the target in sight."""
        return self.kind not in {"stick", "attitude"}


class ManualSteering:
    """Holds the lease while a station flies through the gateway.

    Attributes:
        order: what is flown, or wanted; None for nothing.
    """

    def __init__(
        self, uav: Vehicle, announce: Announce, now: Callable[[], float], faults: Faults, target: str = ""
    ) -> None:
        """Fly nothing.

        Args:
            uav: the vehicle.
            announce: tells all ground stations.
            now: the clock [s].
            faults: counts what a flight fails by.
            target: what is flown by; empty for the target in sight.
        """
        self._aim: Mapping[str, Any] = {"target": target} if target else {}
        self.order: Order | None = None
        self._announce, self._now, self._faults = announce, now, faults
        self._keeper = LeaseKeeper(partial(uav.lease, holder=f"{client_name()}-mavlink"[-64:]))
        self._serving: asyncio.Task[None] | None = None
        self._failure: MkError | None = None

    @property
    def shown_mode(self) -> Mode | None:
        """The mode of a ground station's own sticks while they are flown; None otherwise."""
        return self.order.mode if self.order is not None and self._keeper.flight.state is SessionState.HELD else None

    @property
    def is_flying(self) -> bool:
        """Whether the daemon sends what comes from here."""
        return self._keeper.is_engaged

    async def fly(self, order: Order) -> None:
        """Fly an order; returns when the daemon has begun it, which may take some seconds.

        Raises:
            CommandRejectedError: the lease or the setpoint is refused; says why. What was flown is flown on.
            NotEngagedError: the daemon did not begin; the lease is given back.
            LeaseLostError: the lease ended meanwhile.
            ManoeuvreError: another order has taken its place.
        """
        before = self.order
        if before is not None and before.by != order.by and order.kind not in _STOPPING:
            raise ManoeuvreError(f"{before.by} flies: {_ITS_FLIGHT}")
        try:
            self._want(order)
            await self._wait_for_engagement(order)
        except (NotEngagedError, CommandRejectedError):
            if self.order is order:  # what was flown goes on
                if before is not None and self.is_flying:
                    self._want(before)
                else:
                    self._end()
            raise

    def _want(self, order: Order) -> None:
        self.order, self._failure = order, None
        self._keeper.begin()
        patience = SIGHTING if order.needs_target else ENGAGING
        if order.is_streamed:
            self._keeper.flight.expect_stream(self._now(), patience)
        else:
            fields = {**self._aim, **order.fields} if order.needs_target else order.fields
            wanted = RepeatedSetpoint(order.kind, fields, patience, is_until_done=order.kind == "path")
            self._keeper.flight.fly(wanted, self._now())
        if self._serving is None or self._serving.done():
            self._serving = asyncio.create_task(self._serve(), name="orders of ground stations")

    async def _wait_for_engagement(self, order: Order) -> None:
        while True:
            await asyncio.sleep(PERIOD)
            if self._failure is not None:
                raise self._failure
            if self.order is not order:
                raise ManoeuvreError("another order replaced it" if self.order else "given back")
            if self._keeper.flight.has_started(self._now()):
                return

    def stream(self, by: By, kind: str, fields: Mapping[str, Any]) -> None:
        """Hand on a setpoint of the ground station that flies by a stream; one of another is not flown.

        Args:
            by: whose it is.
            kind: last word of a key `setpoint/<kind>`.
            fields: of the setpoint.

        Raises:
            CommandRejectedError: a field is out of range.
        """
        order = self.order
        if order is None or not order.is_streamed or order.by != by:
            return
        aim = self._aim if replace(order, kind=kind).needs_target else {}
        with suppress(LeaseLostError):  # announced with the next tick
            self._keeper.stream(kind, {**aim, **fields})

    def give_back(self, by: By) -> None:
        """Release the aircraft, which the pilot has then; nothing to do where nothing is flown.

        Args:
            by: the program that asks; only the one that flies may.

        Raises:
            ManoeuvreError: another ground station flies.
        """
        if self.order is not None and self.order.by != by:
            raise ManoeuvreError(f"{self.order.by} flies: {_ITS_FLIGHT}")
        self._end()

    async def close(self) -> None:
        """Give the lease back and wait for it."""
        self._end()
        if self._serving is not None:
            await asyncio.gather(self._serving, return_exceptions=True)
        await self._keeper.close()

    def _end(self, why: MkError | None = None) -> None:
        self._failure, self.order = why, None
        self._keeper.give_back()

    async def _serve(self) -> None:
        """Carry out orders until there is none."""
        due = self._now()
        while (order := self.order) is not None:
            try:
                self._serve_once(order)
            except MkError as error:
                self._announce_end(error)
            except Exception as error:  # noqa: BLE001  # the lease is given back; the gateway goes on
                self._faults.note("flight", error)
                self._end(MkError("a defect of the gateway ended the flight"))
            due = max(due + PERIOD, self._now())
            await asyncio.sleep(max(due - self._now(), 0.0))

    def _serve_once(self, order: Order) -> None:
        """Put what is due; end an order of a program that is silent.

        Raises:
            MkError: the lease was refused or has ended.
        """
        # A landing goes on: MAVSDK's own example ends when it has ordered it.
        is_left = not order.is_streamed and order.kind != "land" and not order.by.is_alive(self._now())
        if is_left and self._keeper.flight.is_wanted:
            self._announce(WARNING, f"{order.by} is silent: the aircraft is given back to the pilot")
            self._end(LeaseLostError(f"{order.by} is silent"))
            return
        self._keeper.step()
        if order.kind == "path" and self._keeper.flight.repeated is None:  # the aircraft is at its end
            self._want(Order(order.by, "hold"))

    def _announce_end(self, error: MkError) -> None:
        """The lease was refused, which its order reports, or the daemon has ended it: well after a landing."""
        flight = self._keeper.flight
        reason, outcome = flight.reason, flight.outcome
        if not isinstance(error, LeaseLostError):
            self._end(error)
            return
        if outcome is Outcome.LANDED:
            self._announce(INFO, "landed; the pilot pulls the throttle down and stops the motors")
        else:
            self._announce(WARNING, f"the aircraft is the pilot's: {reason}")
        self._end(LeaseLostError(f"the lease ended: {reason}"))
