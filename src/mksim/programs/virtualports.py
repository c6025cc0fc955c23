"""What a daemon in virtual time stands on: a cable to the simulated boards, and a bus with one client.

`Wiring` takes them in place of the serial port and of Zenoh; everything between them is the daemon's own.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Mapping
from typing import Any, Final, Protocol

import msgpack
from pydantic import BaseModel

from mkdaemon.bus.codec import encode
from mkdaemon.bus.commandserver import Handler
from mkdaemon.bus.gateway import Watcher
from mkdaemon.bus.intake import Taker, Verifier
from mkdaemon.client.answers import Answer
from mkdaemon.client.session import PAUSE, FlightSession
from mkdaemon.errors import LinkLostError
from mkdaemon.link.ports.port import Port
from mkdaemon.telemetry.command import CommandResult
from mkdaemon.telemetry.setpoint import Setpoint
from mkdaemon.telemetry.signature import sign

TICK: Final = 2e-3
"""How often bytes are carried [s]."""


class Aircraft(Protocol):
    """Boards and what they fly, at the end of a cable; `mksim.simulation.Simulation` is one.

    Attributes:
        now: simulated time [s].
    """

    now: float

    def write(self, data: bytes, at: float) -> None:
        """Send bytes to the board at `at` [s]; they take their time on the line."""

    def advance(self, to: float) -> list[tuple[float, bytes]]:
        """Run to `to` [s] and return what reached the host: bytes with the time they arrived [s]."""


class Cable:
    """The one cable to the boards."""

    def __init__(self, aircraft: Aircraft, moved: Callable[[float], None]) -> None:
        """Plug it in.

        Args:
            aircraft: the boards, and what they fly.
            moved: called after every step with the time [s].
        """
        self.aircraft = aircraft
        self.moved = moved

    async def open(self, url: str, *, baud: int) -> Port:
        """Open the port; see `mkdaemon.link.ports.port.open_port`."""
        del baud
        return CablePort(self, url)


class CablePort:
    """An open port to the boards; see `Port`."""

    def __init__(self, cable: Cable, name: str) -> None:
        self._cable = cable
        self._name = name
        self._inbox = bytearray()
        self._is_closed = False
        self._arrived = asyncio.Event()
        self._loop = asyncio.get_running_loop()
        self._timer = self._loop.call_later(TICK, self._tick)

    @property
    def name(self) -> str:
        """The address it was opened under."""
        return self._name

    @property
    def backlog(self) -> int:
        """Bytes that wait: none, the radio keeps what it was given."""
        return 0

    @property
    def descriptor(self) -> int | None:
        """None: there is no device."""
        return None

    @property
    def is_recording(self) -> bool:
        """False."""
        return False

    def discard(self) -> None:
        """Throw away what waits: nothing does."""

    async def read(self) -> bytes:
        """Return what arrived; see `Port.read`."""
        while not self._inbox:
            if self._is_closed:
                raise LinkLostError(f"{self._name}: closed")
            self._arrived.clear()
            await self._arrived.wait()
        chunk = bytes(self._inbox)
        self._inbox.clear()
        return chunk

    def write(self, data: bytes) -> None:
        """Take bytes to send; see `Port.write`."""
        if self._is_closed:
            raise LinkLostError(f"{self._name}: closed")
        self._cable.aircraft.write(data, max(self._loop.time(), self._cable.aircraft.now))

    async def drain(self) -> None:
        """Return at once: virtual bytes need no draining."""

    async def close(self) -> None:
        """End it."""
        self._is_closed = True
        self._timer.cancel()
        self._arrived.set()

    def _tick(self) -> None:
        self._timer = self._loop.call_later(TICK, self._tick)
        now = self._loop.time()
        arrived = b"".join(data for _, data in self._cable.aircraft.advance(now))
        self._cable.moved(now)
        if arrived:
            self._inbox += arrived
            self._arrived.set()


class LocalBus:
    """A bus inside the process, with one client at it; for the daemon it is a `Station`.

    Attributes:
        values: last value of every key.
        followers: hear of every value, with its key.
        lease: that the client took: its epoch and secret; empty before.
        takers: what takes the setpoints of a key, and what tells whose they are.
    """

    def __init__(self) -> None:
        self.open_endpoints: tuple[str, ...] = ()
        self.setpoint_root = "setpoint"
        self.values: dict[str, Any] = {}
        self.followers: list[Callable[[str, BaseModel], None]] = []
        self.lease: dict[str, Any] = {}
        self.loop = asyncio.get_running_loop()
        self._handlers: dict[str, Handler] = {}
        self.takers: dict[str, tuple[Taker, Verifier]] = {}
        self._watched: tuple[str, Watcher] | None = None
        self._sequence = 0

    # -- the daemon's side ----------------------------------------------------------------------------------------

    def publish(self, suffix: str, value: BaseModel, *, schema: type[BaseModel] | None = None) -> None:
        """Keep a value."""
        del schema
        self.values[suffix] = value
        for follow in self.followers:
            follow(suffix, value)

    def serve(self, root: str, handler: Handler) -> None:
        """Let a handler answer."""
        self._handlers[root] = handler

    def receive(self, suffix: str, take: Taker, verify: Verifier) -> None:
        """Take setpoints."""
        self.takers[suffix] = take, verify

    def receive_reports(self, suffix: str, take: Taker, verify: Verifier, secret: str | None) -> None:
        """Take reports of a source of poses."""
        del secret
        self.takers[suffix] = take, verify

    def watch_client(self, name: str | None, watcher: Watcher) -> None:
        """Tell of a client."""
        self._watched = None if name is None else (name, watcher)

    # -- the client's side ----------------------------------------------------------------------------------------

    def show_client(self, name: str, is_here: bool) -> None:
        """Let a client come or go."""
        if self._watched is not None and self._watched[0] == name:
            self._watched[1](name, is_here)

    async def ask(self, suffix: str, **fields: Any) -> CommandResult:
        """Ask the daemon, as a client does."""
        return await self._handlers[suffix.partition("/")[0]](suffix, msgpack.packb(fields))

    async def take_lease(self, holder: str = "pilot") -> None:
        """Take the lease, as the library does.

        Raises:
            CommandRejectedError: it is refused.
        """
        self.show_client(holder, True)
        session = FlightSession()
        session.take()
        while True:
            probe = await self.ask("do/lease", action="probe")
            assert isinstance(probe.reply, dict)
            granted = await self.ask("do/lease", action="take", holder=holder, echo=probe.reply["echo"])
            if isinstance(granted.reply, dict):
                self.lease = granted.reply
                return
            refusal = Answer.from_fields(granted.model_dump()).refusal
            if not session.refused(refusal):
                raise refusal
            await asyncio.sleep(PAUSE)

    def sign_next(self, kind: type[Setpoint], fields: Mapping[str, Any]) -> tuple[bytes, bytes]:
        """The next setpoint under the lease, as bytes, and its signature."""
        self._sequence += 1
        payload = encode(kind(epoch=self.lease["epoch"], sequence=self._sequence, ttl=0.3, **fields))
        return payload, sign(self.lease["secret"], kind.suffix, payload)

    def deliver(self, kind: type[Setpoint], at: float, payload: bytes, proof: bytes) -> None:
        """Bring a setpoint that arrived at a time [s] to the daemon."""
        take, verify = self.takers[kind.suffix]
        take(at, payload, verify(payload, proof))
