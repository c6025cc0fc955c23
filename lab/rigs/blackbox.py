"""A whole daemon in virtual time that records itself: simulated boards on its port, a client at its bus."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Final, cast

import msgpack
from pydantic import BaseModel

from lab.rigs.boardport import Socket
from mkdaemon.bus.codec import encode, encoding_of
from mkdaemon.bus.gateway import Handler, Watcher
from mkdaemon.bus.intake import Prover, Taker
from mkdaemon.clock import Clock, Wake
from mkdaemon.config.root import Config
from mkdaemon.control.core import FlightCore
from mkdaemon.daemon.eyes import Eyes
from mkdaemon.daemon.procedures import Journal
from mkdaemon.daemon.wiring import Wiring
from mkdaemon.errors import LinkLostError
from mkdaemon.link.ports.port import Port
from mkdaemon.record.entry import Entry, Kind, TimeBase
from mkdaemon.record.layout import Session
from mkdaemon.record.notices import Notice
from mkdaemon.record.writer import RecordingWriter
from mkdaemon.replay.run import AtOnce
from mkdaemon.sim.simulation import Simulation
from mkdaemon.stamp import Stamp
from mkdaemon.telemetry.command import CommandResult
from mkdaemon.telemetry.setpoint import Setpoint
from mkdaemon.telemetry.signature import sign

WALL: Final = 1.7e9
"""Unix time when virtual time is zero [s]."""
HANDED_OVER: Final = 8e-5
"""Time from the arrival of a setpoint at the bus to its arrival at the loop [s]."""


class Tape:
    """What is recorded."""

    def __init__(self, vehicle: str, clock: Clock) -> None:
        self.entries: list[Entry] = []
        self._vehicle, self._clock = vehicle, clock
        self.base = TimeBase.of(clock.stamp())
        self._sequences: dict[tuple[Kind, str], int] = {}

    def add(
        self, kind: Kind, suffix: str, payload: bytes = b"", encoding: str = "", at: float | None = None, **more: Any
    ) -> None:
        """Keep an entry."""
        taken = self._clock.now() if at is None else at
        sequence = self._sequences[kind, suffix] = self._sequences.get((kind, suffix), 0) + 1
        key, wall = f"mk/{self._vehicle}/{suffix}", self._clock.stamp(taken).wall
        self.entries.append(Entry(kind, key, payload, encoding, taken, wall, self.base, sequence, **more))

    def note(self, notice: Notice, at: float | None = None, **said: Any) -> None:
        """Keep a notice."""
        self.add(Kind.NOTICE, notice.suffix, msgpack.packb(said) if said else b"", at=at)

    def woke(self, who: Wake, at: float) -> None:
        """Keep that somebody woke."""
        self.note({Wake.CONTROL: Notice.CONTROL_WOKE, Wake.LINE: Notice.LINE_WOKE}[who], at)


class TapedPort:
    """A port whose bytes are kept."""

    def __init__(self, port: Port, tape: Tape) -> None:
        self._port, self._tape = port, tape

    def __getattr__(self, name: str) -> Any:
        return getattr(self._port, name)

    async def read(self) -> bytes:
        """Return what arrived, kept."""
        try:
            chunk = await self._port.read()
        except LinkLostError as error:
            self._tape.add(Kind.PORT_LOST, "port", msgpack.packb({"reason": str(error)}))
            raise
        self._tape.add(Kind.PORT_READ, "port", chunk)
        return chunk

    def write(self, data: bytes) -> None:
        """Keep and write."""
        self._port.write(data)
        self._tape.add(Kind.PORT_WRITTEN, "port", data)


class ClientSide:
    """The bus of this daemon, with its one client.

    Attributes:
        values: last value of every key.
    """

    def __init__(self, tape: Tape) -> None:
        self.open_endpoints: tuple[str, ...] = ()
        self.values: dict[str, Any] = {}
        self._tape = tape
        self._loop = asyncio.get_running_loop()
        self._handlers: dict[str, Handler] = {}
        self._takers: dict[str, Taker] = {}
        self._watchers: list[Watcher] = []
        self._exchanges = 0
        self._sequence = 0
        self.lease: dict[str, Any] = {}

    def publish(self, suffix: str, value: BaseModel, *, schema: type[BaseModel] | None = None) -> None:
        """Keep a value."""
        self.values[suffix] = value
        stamp = getattr(value, "stamp", None)
        assert stamp is None or isinstance(stamp, Stamp)
        self._tape.add(Kind.SAMPLE, suffix, encode(value), encoding_of(schema or type(value)))

    def serve(self, root: str, handler: Handler) -> None:
        """Let a handler answer."""
        self._handlers[root] = handler

    def receive(self, suffix: str, take: Taker, is_proven: Prover) -> None:
        """Take setpoints."""
        self._takers[suffix] = take

    def watch_clients(self, watcher: Watcher) -> None:
        """Tell of clients."""
        self._watchers.append(watcher)

    async def ask(self, suffix: str, **fields: Any) -> CommandResult:
        """Ask the daemon, as a client does."""
        self._exchanges += 1
        number = self._exchanges
        hidden = fields | ({"secret": "..."} if "secret" in fields else {})
        self._tape.add(Kind.QUERY, suffix, msgpack.packb(hidden), exchange=number)
        began = self._loop.time()
        result = await self._handlers[suffix.partition("/")[0]](suffix, msgpack.packb(fields))
        result = result.model_copy(update={"duration": round(self._loop.time() - began, 6)})
        reply = dict(result.reply) if isinstance(result.reply, dict) else result.reply
        if isinstance(reply, dict) and "secret" in reply:
            reply["secret"] = "..."
        shown = result.model_copy(update={"reply": reply})
        self._tape.add(Kind.REPLY, suffix, encode(shown), encoding_of(CommandResult), exchange=number)
        return result

    async def take_lease(self, holder: str = "pilot") -> None:
        """Take the lease, as the library does."""
        for watcher in self._watchers:
            self._tape.note(Notice.CLIENT, name=holder, is_here=True)
            watcher(holder, True)
        probe = await self.ask("do/lease", action="probe")
        assert isinstance(probe.reply, dict)
        granted = await self.ask("do/lease", action="take", holder=holder, echo=probe.reply["echo"])
        assert isinstance(granted.reply, dict), granted
        self.lease = granted.reply

    async def give_back(self) -> None:
        """Give the lease back."""
        await self.ask("do/lease", action="release", epoch=self.lease["epoch"], secret=self.lease["secret"])

    async def vanish(self, holder: str = "pilot") -> None:
        """End the client without a word."""
        for watcher in self._watchers:
            self._tape.note(Notice.CLIENT, name=holder, is_here=False)
            watcher(holder, False)

    async def stream(self, kind: type[Setpoint], seconds: float, **fields: Any) -> None:
        """Stream a setpoint at 50 Hz."""
        end = self._loop.time() + seconds
        while self._loop.time() < end:
            self._sequence += 1
            setpoint = kind(epoch=self.lease["epoch"], sequence=self._sequence, ttl=0.3, **fields)
            payload, at = encode(setpoint), self._loop.time()
            proof = sign(self.lease["secret"], kind.suffix, payload)
            self._loop.call_later(HANDED_OVER, self._arrive, kind.suffix, at, payload, proof)
            await asyncio.sleep(0.02)

    def _arrive(self, suffix: str, at: float, payload: bytes, proof: bytes) -> None:
        self._tape.add(Kind.SETPOINT, suffix, payload, "application/msgpack", at, attachment=proof)
        self._takers[suffix](at, payload, proof)


class RecordedDaemon:
    """A daemon in the time of the running loop.

    Attributes:
        client: at its bus.
        wiring: its parts.
        tape: what it recorded.
        socket: the boards.
    """

    def __init__(
        self,
        cfg: Config,
        make: Callable[[], Simulation],
        *,
        seed: int,
        make_eyes: Callable[[FlightCore, Tape, Clock, ClientSide], Eyes] = lambda core, tape, clock, bus: Eyes(None),
    ) -> None:
        """Put it together."""
        loop = asyncio.get_running_loop()
        clock = Clock(
            monotonic=loop.time, wall=lambda: WALL + loop.time(), synchronised=lambda: True, suspended=lambda: 0.0
        )
        self.cfg = cfg
        self.tape = Tape(cfg.vehicle.name, clock)
        clock.on_wake = self.tape.woke
        self.client = ClientSide(self.tape)
        self.socket = Socket(make, seed=seed)
        self.wiring = Wiring(
            cfg,
            self.client,
            clock,
            make_eyes=lambda core: make_eyes(core, self.tape, clock, self.client),
            opener=self._open,
            journal=Journal(cfg.vehicle.state_folder or Path(), AtOnce()),
        )

    async def _open(self, url: str, *, baud: int) -> Port:
        port = await self.socket.open(url, baud=baud)
        self.tape.add(Kind.PORT_OPENED, "port", msgpack.packb({"port": port.name, "baud": baud}))
        return cast("Port", TapedPort(port, self.tape))

    async def until(self, claim: Callable[[], bool], within: float = 20.0) -> None:
        """Wait for a claim.

        Raises:
            TimeoutError: it did not hold in time.
        """
        async with asyncio.timeout(within):
            while not claim():  # noqa: ASYNC110 - a state, not an event
                await asyncio.sleep(0.02)

    @property
    def can_fly(self) -> bool:
        """Whether a lease would be granted."""
        return self.wiring.link.is_up and self.wiring.link.dialect.extern_control is not None

    def start(self) -> list[asyncio.Task[None]]:
        """Start everything; returns the tasks, the line first."""
        loop = asyncio.get_running_loop()
        self.wiring.flight.guard_changed(True)
        self.tape.note(Notice.GUARD_ALIVE, is_alive=True)
        return [
            loop.create_task(self.wiring.link.run(), name="link"),
            *self.wiring.start(loop),
        ]

    async def stop(self, tasks: Sequence[asyncio.Task[None]]) -> None:
        """End in order."""
        self.tape.note(Notice.STOP)
        link, *above = tasks
        for task in above:
            task.cancel()
        await asyncio.wait(above)
        link.cancel()
        await asyncio.wait([link])

    def session(self, name: str = "flight") -> Session:
        """What the file says about itself."""
        config = self.cfg.model_dump_json(exclude={"sim"})
        base = self.tape.base
        return Session("blackbox", name, 0, "mkdaemon", "lab", base.boot, base.offset_ns, self.cfg.vehicle.name, config)

    def write(self, path: Path) -> None:
        """Write the recording."""
        with path.open("wb") as file:
            writer = RecordingWriter(file, self.session())
            for entry in self.tape.entries:
                writer.add(entry)
            writer.finish()
