"""Procedures in virtual time: a real link, simulated boards, a journal in a real folder."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable
from concurrent.futures import Executor, Future
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import msgpack
from pydantic import BaseModel

from lab.rigs.boardport import ADAPTER_TIME, Socket
from lab.rigs.waiting import wait_until
from mkdaemon.clock import Clock
from mkdaemon.config.commands import CommandsConfig
from mkdaemon.config.control import ControlConfig
from mkdaemon.config.link import LinkConfig
from mkdaemon.daemon.deck import Deck
from mkdaemon.daemon.flight import FlightControl
from mkdaemon.daemon.procedures import Interlock, Journal, ProcedureRunner
from mkdaemon.daemon.requests import BoardRequests
from mkdaemon.errors import CommandRejectedError
from mkdaemon.link.discovery import discover
from mkdaemon.link.labels import LabelCache
from mkdaemon.link.link import Link
from mkdaemon.telemetry.command import CommandResult, refused
from mkdaemon.telemetry.control import Phase
from mksim.simulation import Simulation
from tests.control.admission.situations import situation_of


class PromptDisk(Executor):
    """Works at once and without a thread, which virtual time would not wait for."""

    def submit(self, work: Any, /, *arguments: Any, **named: Any) -> Future[Any]:
        done: Future[Any] = Future()
        try:
            done.set_result(work(*arguments, **named))
        except OSError as error:
            done.set_exception(error)
        return done


class Bus:
    """What is published."""

    def __init__(self) -> None:
        self.published: list[tuple[str, BaseModel]] = []
        self.follower: Callable[[str, BaseModel], None] = lambda suffix, value: None

    def publish(self, suffix: str, value: BaseModel, *, schema: type[BaseModel] | None = None) -> None:
        self.published.append((suffix, value))
        self.follower(suffix, value)

    def values(self, suffix: str) -> list[Any]:
        return [value for key, value in self.published if key == suffix]

    def texts(self) -> list[str]:
        return [value.text for value in self.values("event/log")]


class Guard(BoardRequests):
    """The daemon's guard; a test may refuse more."""

    refusal: Callable[[Any], None] = staticmethod(lambda message: None)

    async def check_step(self, board: Any, message: Any) -> None:
        self.refusal(message)
        await super().check_step(board, message)


class ProcedureRig:
    """One daemon's procedures on a line."""

    def __init__(self, socket: Socket, folder: Path) -> None:
        loop = asyncio.get_running_loop()
        self.socket, self.bus, self.phase = socket, Bus(), Phase.FREE
        clock = Clock(monotonic=loop.time)
        deck = Deck(ControlConfig(), self.bus, clock, first_epoch=1)
        facts, audit = deck.core.vehicle, deck.audit
        self.facts = facts
        cfg = LinkConfig.model_validate({"port": "/dev/rig"})
        self.link = Link(cfg, deck.sink, opener=socket.open, clock=clock, motors_running=facts.motors_running)
        self.control = FlightControl(deck, self.link, clock=clock)
        self.interlock = Interlock(lambda: situation_of(facts, clock.now(), self.phase))
        self.journal = Journal(folder, PromptDisk())
        self.guard = Guard(CommandsConfig(), self.link, facts, deck.feed, audit, clock, self.interlock)
        self.runner = ProcedureRunner(
            self.link,
            facts,
            deck.feed,
            self.bus,
            audit,
            self.guard,
            self.interlock,
            self.journal,
            LabelCache(None),
            clock,
        )
        self.tasks: list[asyncio.Task[None]] = []

    @property
    def flight(self) -> Any:
        """The simulated FlightCtrl."""
        return self.socket.aircraft.flight

    async def ask(self, verb: str, **fields: Any) -> CommandResult:
        """Ask for a verb, as the bus would."""
        try:
            return await self.runner.verbs[verb](msgpack.packb(fields))
        except CommandRejectedError as error:
            return refused(error)

    async def until(self, claim: Callable[[], Any], within: float = 30.0) -> None:
        """Wait for something to become true."""
        await wait_until(claim, within, step=0.005)

    async def until_ready(self) -> None:
        """Wait for the daemon to know its boards."""
        await self.until(lambda: self.link.is_up and self.link.dialect.fc_release is not None)

    def steps(self) -> list[tuple[str, str]]:
        """Verb and state of every progress published, repetitions left out."""
        told = [(value.verb, value.state.value) for value in self.bus.values("event/progress")]
        return [step for n, step in enumerate(told) if n == 0 or told[n - 1] != step]

    async def die(self) -> None:
        """End as a killed process does: nothing is left of it but the journal, not even a farewell on the line."""
        for task in self.tasks:
            task.cancel()
            task.cancel()
        port = self.socket.port
        assert port is not None
        port.lose("killed")
        await asyncio.gather(*self.tasks, return_exceptions=True)
        self.tasks.clear()


@asynccontextmanager
async def procedure_rig(socket: Socket, folder: Path) -> AsyncIterator[ProcedureRig]:
    """Run the procedures of a daemon on a line while the context lives."""
    rig = ProcedureRig(socket, folder)
    rig.tasks = [asyncio.create_task(rig.runner.run()), asyncio.create_task(rig.link.run(discover))]
    try:
        yield rig
    finally:
        for task in rig.tasks:
            task.cancel()
            await asyncio.gather(task, return_exceptions=True)


def plug_in(make: Callable[[], Simulation], seed: int = 1) -> Socket:
    """Simulated boards whose five parameter sets all differ."""
    socket = Socket(make, seed=seed, tick=ADAPTER_TIME)
    flight = socket.aircraft.flight
    for slot, raw in list(flight.eeprom.sets.items()):
        flight.eeprom.sets[slot] = raw[:50] + bytes((slot,)) + raw[51:]
    flight.load(flight.eeprom.active)
    return socket
