"""Flying for ground stations: the lease is taken when one asks to fly, and given back when nobody flies any more.

A ground station flies in two ways. It orders a manoeuvre (take-off, landing, hold, a place): the gateway streams it
for as long as that program beats (`stations.SILENCE`) and its connection stands. Or it streams setpoints of its own:
each is handed on at once and as it came, none is repeated, so its silence is the silence of a client: level after
0.3 s, released after 1.0 s (docs/safety.md).
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Final

from mkdaemon.client import Vehicle
from mkdaemon.client.asking import client_name
from mkdaemon.errors import CommandRejectedError, LeaseLostError, ManoeuvreError, MkError, NotEngagedError
from mkdaemon.gateways.mavlink.faults import Faults
from mkdaemon.gateways.mavlink.modes import Mode
from mkdaemon.gateways.mavlink.stations import Program, Station
from mkdaemon.gateways.mavlink.texts import INFO, WARNING
from mkdaemon.telemetry.control import ControlStatus, Outcome

if TYPE_CHECKING:
    from mkdaemon.client.lease import Lease

PERIOD: Final = 0.02
"""Between two setpoints of a manoeuvre that the gateway streams [s]."""
SIGHTING: Final = 12.0
"""Longest wait until the daemon begins a manoeuvre by the target [s], as for every client."""
ENGAGING: Final = 5.0
"""Longest wait until it begins one by sticks [s]."""
GRACE: Final = 1.5
"""Setpoints may be refused for so long before that counts [s]: with a new lease the estimate begins anew."""
STREAMED: Final = 0.5
"""A ground station streams while its last setpoint is not older than that [s]."""
_SETTLING: Final = 2.0
"""`control/status` may be from before the lease for so long after it was granted [s]."""
_STOPPING: Final = frozenset({"hold", "land"})
"""Manoeuvres that another ground station than the one that flies may order too: they end what is flown."""

_ITS_FLIGHT: Final = "another ground station may order hold or landing, nothing else"
Announce = Callable[[int, str], None]
"""Tells everybody: severity and words."""


@dataclass(frozen=True, slots=True)
class By:
    """Who flies.

    Attributes:
        station: where.
        program: which one there.
    """

    station: Station
    program: Program

    def is_alive(self, now: float) -> bool:
        """Whether it is still there."""
        return self.station.is_alive(self.program, now)

    def __str__(self) -> str:
        return f"ground station {self.program.system}/{self.program.component}"


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


class Steering:
    """Holds the lease while somebody flies through the gateway.

    Attributes:
        order: what is flown, or wanted; None for nothing.
    """

    def __init__(self, uav: Vehicle, announce: Announce, now: Callable[[], float], faults: Faults) -> None:
        """Fly nothing.

        Args:
            uav: the vehicle.
            announce: tells all ground stations.
            now: the clock [s].
            faults: counts what a flight fails by.
        """
        self.order: Order | None = None
        self._uav, self._announce, self._now, self._faults = uav, announce, now, faults
        self._lease: Lease | None = None
        self._status: ControlStatus | None = None
        self._granted_at = 0.0
        self._was_ours = False
        self._holding: asyncio.Task[None] | None = None
        self._failure: MkError | None = None

    @property
    def shown_mode(self) -> Mode | None:
        """The mode of a ground station's own sticks while they are flown; None otherwise."""
        return self.order.mode if self.order is not None and self._lease is not None else None

    @property
    def is_flying(self) -> bool:
        """Whether the daemon sends what comes from here."""
        return self._lease is not None and self._lease.is_engaged

    def status_arrived(self, status: ControlStatus) -> None:
        """Take what the daemon says of the lease."""
        self._status = status
        lease = self._lease
        if lease is not None and status.lease is not None and status.lease.epoch == lease.epoch:
            self._was_ours = True

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
        self.order, self._failure = order, None
        if self._holding is None or self._holding.done():
            self._holding = asyncio.create_task(self._hold(), name="lease of ground stations")
        try:
            await self._wait_for_engagement(order)
        except (NotEngagedError, CommandRejectedError):
            if self.order is order:  # what was flown goes on; else nobody flies
                self.order = before if self.is_flying else None
            raise

    async def _wait_for_engagement(self, order: Order) -> None:
        start = self._now()
        patience = SIGHTING if order.needs_target else ENGAGING
        while True:
            await asyncio.sleep(PERIOD)
            if self._failure is not None:
                raise self._failure
            if self.order is not order:
                raise ManoeuvreError("another order took its place" if self.order else "given back")
            lease, now = self._lease, self._now()
            if lease is None:
                continue
            kind = self.order.kind
            if lease.is_engaged and lease.status is not None and (order.is_streamed or lease.status.manoeuvre == kind):
                return
            refusal = lease.take_refusal()
            if refusal is not None and now - max(start, self._granted_at) > GRACE:
                raise refusal
            if now - start > patience:
                raise NotEngagedError(f"the daemon did not begin within {patience:g} s: {lease.reason}")

    def stream(self, by: By, kind: str, fields: Mapping[str, Any]) -> bool:
        """Hand on a setpoint of the ground station that flies by a stream; one of another is not flown.

        Args:
            by: whose it is.
            kind: last word of a key `setpoint/<kind>`.
            fields: of the setpoint.

        Returns:
            Whether it was handed on.

        Raises:
            CommandRejectedError: a field is out of range.
        """
        order, lease = self.order, self._lease
        if order is None or lease is None or not order.is_streamed or order.by != by:
            return False
        try:
            lease.put(kind, fields)
        except LeaseLostError as lost:
            self._end(lost)
            return False
        return True

    def give_back(self, by: By) -> None:
        """Release the aircraft, which the pilot has then; nothing to do where nothing is flown.

        Args:
            by: the program that asks; only the one that flies may.

        Raises:
            ManoeuvreError: another ground station flies.
        """
        if self.order is not None and self.order.by != by:
            raise ManoeuvreError(f"{self.order.by} flies: {_ITS_FLIGHT}")
        self.order = None

    async def close(self) -> None:
        """Give the lease back and wait for it."""
        self.order = None
        if self._holding is not None:
            await asyncio.gather(self._holding, return_exceptions=True)

    def _end(self, why: MkError) -> None:
        self._failure, self.order = why, None

    async def _hold(self) -> None:
        """Hold the lease for as long as there is an order."""
        holder = f"{client_name()}-mavlink"[-64:]
        while self.order is not None:  # None: given back before the lease was asked for; again: ordered while it ended
            try:
                async with self._uav.lease(holder=holder) as lease:
                    self._lease, self._granted_at, self._was_ours = lease, self._now(), False
                    await self._serve(lease)
            except MkError as error:
                self._end(error)
            except Exception as error:  # noqa: BLE001  # the lease has been given back; the gateway goes on
                self._faults.note("flight", error)
                self._end(MkError("a defect of the gateway ended the flight"))
            finally:
                self._lease = None

    async def _serve(self, lease: Lease) -> None:
        """Stream what is ordered until nobody flies any more."""
        due = self._now()
        while (order := self.order) is not None:
            if (status := self._end_of(lease)) is not None:
                self._announce_end(status.outcome, status.reason)
                return
            if not order.is_streamed:
                # A landing goes on: MAVSDK's own example ends when it has ordered it.
                if order.kind != "land" and not order.by.is_alive(self._now()):
                    self._announce(WARNING, f"{order.by} is silent: the aircraft is given back to the pilot")
                    self._end(LeaseLostError(f"{order.by} is silent"))
                    return
                try:
                    lease.put(order.kind, order.fields)
                except LeaseLostError:
                    self._announce_end(lease.outcome, lease.reason)
                    return
            due = max(due + PERIOD, self._now())
            await asyncio.sleep(max(due - self._now(), 0.0))

    def _end_of(self, lease: Lease) -> ControlStatus | None:
        """What the daemon says of the end of this lease; None while it has not said that it is over."""
        status = self._status
        if status is None or (status.lease is not None and status.lease.epoch == lease.epoch):
            return None
        return status if self._was_ours or self._now() - self._granted_at > _SETTLING else None

    def _announce_end(self, outcome: Outcome | None, reason: str) -> None:
        """The daemon has ended the lease: after a landing that is well, else it says why."""
        if outcome is Outcome.LANDED:
            self._announce(INFO, "landed; the pilot pulls the throttle down and stops the motors")
        else:
            self._announce(WARNING, f"the aircraft is the pilot's: {reason}")
        self._end(LeaseLostError(f"the lease ended: {reason}"))
