"""A whole daemon in virtual time that records itself: simulated boards on its port, a client at its bus."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

import msgpack
from pydantic import BaseModel

from lab.rigs.boardport import TICK_TIME, Socket
from lab.rigs.waiting import wait_until
from mkdaemon.bus.codec import encode, encoding_of
from mkdaemon.clock import Clock
from mkdaemon.config.root import Config
from mkdaemon.control.events import Feed
from mkdaemon.daemon.eyes import Eyes
from mkdaemon.record.entry import Entry, Notice, TimeBase
from mkdaemon.record.layout import Session
from mkdaemon.record.queue import EntryQueue
from mkdaemon.record.tap import Tap
from mkdaemon.record.writer import RecordingWriter
from mkdaemon.stamp import Stamp
from mkdaemon.telemetry.command import CommandResult
from mkdaemon.telemetry.setpoint import Setpoint
from mksim.programs.virtualdaemon import VirtualDaemon, virtual_clock
from mksim.programs.virtualports import LocalBus
from mksim.simulation import Simulation

SOURCE: Final = "5eed"
"""Id of the client's session."""
ROOM: Final = 1 << 30
"""Nothing is lost [bytes]."""
HANDED_OVER: Final = 8e-5
"""Time from the arrival of a setpoint at the bus to its arrival at the loop [s]."""


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


class ClientSide(LocalBus):
    """The bus of this daemon, with its one client; all of it is recorded."""

    def __init__(self, tap: Tap) -> None:
        super().__init__()
        self._tap = tap
        self._exchanges = 0

    def publish(self, suffix: str, value: BaseModel, *, schema: type[BaseModel] | None = None) -> None:
        """Keep a value."""
        super().publish(suffix, value, schema=schema)
        stamp = getattr(value, "stamp", None)
        assert stamp is None or isinstance(stamp, Stamp)
        self._tap.sample(suffix, encode(value), encoding_of(schema or type(value)), stamp)

    async def ask(self, suffix: str, **fields: Any) -> CommandResult:
        """Ask the daemon, as a client does."""
        self._exchanges += 1
        number = self._exchanges
        self._tap.query(suffix, msgpack.packb(fields), number, SOURCE)
        began = self.loop.time()
        result = await super().ask(suffix, **fields)
        result = result.model_copy(update={"duration": round(self.loop.time() - began, 6)})
        self._tap.reply(suffix, encode(result), encoding_of(CommandResult), number)
        return result

    async def give_back(self) -> None:
        """Give the lease back."""
        await self.ask("do/lease", action="release", epoch=self.lease["epoch"], secret=self.lease["secret"])

    async def vanish(self, holder: str = "pilot") -> None:
        """End the client without a word."""
        self.show_client(holder, False)

    async def stream(self, kind: type[Setpoint], seconds: float, *, period: float = 0.02, **fields: Any) -> None:
        """Stream a setpoint, by default at 50 Hz."""
        end = self.loop.time() + seconds
        while self.loop.time() < end:
            self.loop.call_later(HANDED_OVER, self.deliver, kind, self.loop.time(), *self.sign_next(kind, fields))
            await asyncio.sleep(period)

    def deliver(self, kind: type[Setpoint], at: float, payload: bytes, proof: bytes) -> None:
        """Bring a setpoint that arrived at a time [s] to the daemon."""
        self._tap.setpoint(kind.suffix, payload, "application/msgpack", proof, at=at, source=SOURCE, is_holder=True)
        super().deliver(kind, at, payload, proof)


class RecordedDaemon(VirtualDaemon):
    """A daemon in the time of the running loop.

    Attributes:
        cfg: all of its configuration.
        client: its bus.
        socket: the cable to its boards.
        tape: what is recorded.
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
            tick: how often bytes are carried [s].
            age: the boards have been powered up for so long [s].
        """
        clock = virtual_clock()
        self.cfg, self.tape = cfg, Tape(cfg.vehicle.name, clock)
        self.client = ClientSide(self.tape.tap)
        self.socket = Socket(make, seed=seed, tick=tick, age=age)
        super().__init__(
            self.client,
            self.socket.open,
            config=cfg,
            clock=clock,
            eyes=lambda feed: make_eyes(feed, self),
            recorder=self.tape.tap,
            journal=cfg.vehicle.state_folder or Path(),
        )

    async def begin(self) -> None:
        """Start everything; returns when a lease would be granted.

        Raises:
            TimeoutError: it would not be in time.
        """
        self.wiring.guard_changed(True)
        self.start()
        link = self.wiring.link
        await wait_until(lambda: link.is_up and link.dialect.extern_control is not None, step=0.02)

    async def stop(self) -> None:
        """End in order."""
        self.tape.tap.notice(Notice.STOP)
        await super().stop()

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
