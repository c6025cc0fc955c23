"""A whole daemon in virtual time that records itself: simulated boards on its port, a client at its bus."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Sequence
from concurrent.futures import Executor, Future
from pathlib import Path
from typing import Any, Final, ParamSpec, TypeVar

import msgpack
from pydantic import BaseModel

from lab.rigs.boardport import TICK_TIME, Socket
from mkdaemon.bus.codec import encode, encoding_of
from mkdaemon.bus.commandserver import Handler
from mkdaemon.bus.gateway import Watcher
from mkdaemon.bus.intake import Taker, Verifier
from mkdaemon.clock import Clock
from mkdaemon.config.root import Config
from mkdaemon.control.events import Feed
from mkdaemon.daemon.eyes import Eyes
from mkdaemon.daemon.procedures import Journal
from mkdaemon.daemon.wiring import Wiring
from mkdaemon.record.entry import Entry, Notice, TimeBase
from mkdaemon.record.layout import Session
from mkdaemon.record.queue import EntryQueue
from mkdaemon.record.tap import Tap
from mkdaemon.record.writer import RecordingWriter
from mkdaemon.stamp import Stamp
from mkdaemon.telemetry.command import CommandResult
from mkdaemon.telemetry.setpoint import Setpoint
from mkdaemon.telemetry.signature import sign
from mksim.simulation import Simulation

WALL: Final = 1.7e9
"""Unix time when virtual time is zero [s]."""
SOURCE: Final = "5eed"
"""Id of the client's session."""
ROOM: Final = 1 << 30
"""Nothing is lost [bytes]."""
_Parameters = ParamSpec("_Parameters")
_Result = TypeVar("_Result")
HANDED_OVER: Final = 8e-5
"""Time from the arrival of a setpoint at the bus to its arrival at the loop [s]."""


class AtOnce(Executor):
    """Does everything at once: a thread would take time that virtual time does not know."""

    def submit(
        self, fn: Callable[_Parameters, _Result], /, *args: _Parameters.args, **kwargs: _Parameters.kwargs
    ) -> Future[_Result]:
        """Do it."""
        future: Future[_Result] = Future()
        try:
            future.set_result(fn(*args, **kwargs))
        except OSError as error:
            future.set_exception(error)
        return future


class Tape:
    """The recorder's own tap, and what it took."""

    def __init__(self, vehicle: str, clock: Clock) -> None:
        self.base = TimeBase.of(clock.stamp())
        self._queue = EntryQueue(ROOM)
        self.tap = Tap(self._queue, clock, vehicle, self.base)

    def entries(self) -> list[Entry]:
        """Return what was recorded, once."""
        taken = (item if isinstance(item, Entry) else item() for item in self._queue.take(len(self._queue)))
        return [entry for entry in taken if entry is not None]


class ClientSide:
    """The bus of this daemon, with its one client.

    Attributes:
        values: last value of every key.
    """

    def __init__(self, tap: Tap) -> None:
        self.open_endpoints: tuple[str, ...] = ()
        self.values: dict[str, Any] = {}
        self._tap = tap
        self._loop = asyncio.get_running_loop()
        self._handlers: dict[str, Handler] = {}
        self._takers: dict[str, tuple[Taker, Verifier]] = {}
        self._watchers: list[Watcher] = []
        self._exchanges = 0
        self._sequence = 0
        self.lease: dict[str, Any] = {}

    def publish(self, suffix: str, value: BaseModel, *, schema: type[BaseModel] | None = None) -> None:
        """Keep a value."""
        self.values[suffix] = value
        stamp = getattr(value, "stamp", None)
        assert stamp is None or isinstance(stamp, Stamp)
        self._tap.sample(suffix, encode(value), encoding_of(schema or type(value)), stamp)

    def serve(self, root: str, handler: Handler) -> None:
        """Let a handler answer."""
        self._handlers[root] = handler

    def receive(self, suffix: str, take: Taker, verify: Verifier) -> None:
        """Take setpoints."""
        self._takers[suffix] = take, verify

    def watch_clients(self, watcher: Watcher) -> None:
        """Tell of clients."""
        self._watchers.append(watcher)

    async def ask(self, suffix: str, **fields: Any) -> CommandResult:
        """Ask the daemon, as a client does."""
        self._exchanges += 1
        number = self._exchanges
        payload = msgpack.packb(fields)
        self._tap.query(suffix, payload, number, SOURCE)
        began = self._loop.time()
        result = await self._handlers[suffix.partition("/")[0]](suffix, payload)
        result = result.model_copy(update={"duration": round(self._loop.time() - began, 6)})
        self._tap.reply(suffix, encode(result), encoding_of(CommandResult), number)
        return result

    async def take_lease(self, holder: str = "pilot") -> None:
        """Take the lease, as the library does."""
        for watcher in self._watchers:
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
            watcher(holder, False)

    async def stream(self, kind: type[Setpoint], seconds: float, *, period: float = 0.02, **fields: Any) -> None:
        """Stream a setpoint, by default at 50 Hz."""
        end = self._loop.time() + seconds
        while self._loop.time() < end:
            self._sequence += 1
            setpoint = kind(epoch=self.lease["epoch"], sequence=self._sequence, ttl=0.3, **fields)
            payload, at = encode(setpoint), self._loop.time()
            proof = sign(self.lease["secret"], kind.suffix, payload)
            self._loop.call_later(HANDED_OVER, self._arrive, kind.suffix, at, payload, proof)
            await asyncio.sleep(period)

    def _arrive(self, suffix: str, at: float, payload: bytes, proof: bytes) -> None:
        self._tap.setpoint(suffix, payload, "application/msgpack", proof, at=at, source=SOURCE, is_holder=True)
        take, verify = self._takers[suffix]
        take(at, payload, verify(payload, proof))


class RecordedDaemon:
    """A daemon in the time of the running loop.

    Attributes:
        cfg: its configuration.
        clock: its clock.
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
        tick: float = TICK_TIME,
        age: float = 0.0,
        make_eyes: Callable[[Feed, RecordedDaemon], Eyes] = lambda feed, daemon: Eyes(None),
    ) -> None:
        """Put it together.

        Args:
            cfg: of the daemon.
            make: powers the boards up.
            seed: of the line.
            tick: how often bytes are carried [s].
            age: the boards have been powered up for so long [s].
            make_eyes: makes the cameras.
        """
        loop = asyncio.get_running_loop()
        clock = Clock(
            monotonic=loop.time, wall=lambda: WALL + loop.time(), synchronised=lambda: True, suspended=lambda: 0.0
        )
        self.cfg, self.clock = cfg, clock
        self.tape = Tape(cfg.vehicle.name, clock)
        self.client = ClientSide(self.tape.tap)
        self.socket = Socket(make, seed=seed, tick=tick, age=age)
        self.wiring = Wiring(
            cfg,
            self.client,
            clock,
            make_eyes=lambda feed: make_eyes(feed, self),
            opener=self.socket.open,
            tap=self.tape.tap,
            journal=Journal(cfg.vehicle.state_folder or Path(), AtOnce()),
        )

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
        self.wiring.guard_changed(True)
        return [
            loop.create_task(self.wiring.run_line(), name="link"),
            *self.wiring.start(loop),
        ]

    async def stop(self, tasks: Sequence[asyncio.Task[None]]) -> None:
        """End in order."""
        self.tape.tap.notice(Notice.STOP)
        link, *above = tasks
        for task in above:
            task.cancel()
        await asyncio.wait(above)
        link.cancel()
        await asyncio.wait([link])

    def session(self, name: str = "flight") -> Session:
        """What the file says about itself."""
        config = self.cfg.model_dump_json(exclude={"sim": True, "vehicle": {"state_folder"}})
        base = self.tape.base
        return Session("blackbox", name, 0, "mkdaemon", "lab", base.boot, base.offset_ns, self.cfg.vehicle.name, config)

    def write(self, path: Path) -> None:
        """Write the recording."""
        with path.open("wb") as file:
            writer = RecordingWriter(file, self.session())
            for entry in self.tape.entries():
                writer.add(entry)
            writer.finish()
