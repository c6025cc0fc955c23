"""Procedures in virtual time: a real link, simulated boards, a journal in a real folder."""

from __future__ import annotations

import asyncio
import functools
import inspect
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import msgpack
from pydantic import BaseModel

from lab.rigs.boardport import ADAPTER_TIME, Socket
from lab.rigs.linkrig import virtually
from lab.rigs.waiting import wait_until
from mkdaemon.errors import CommandRejectedError
from mkdaemon.telemetry.command import CommandResult, refused
from mkdaemon.telemetry.control import Phase
from mksim.programs.virtualdaemon import VirtualDaemon
from mksim.simulation import Simulation
from tests.control.admission.situations import situation_of


class Bus:
    """What is published; nobody asks there."""

    open_endpoints: tuple[str, ...] = ()
    setpoint_root: str = "setpoint"

    def __init__(self) -> None:
        self.published: list[tuple[str, BaseModel]] = []
        self.follower: Callable[[str, BaseModel], None] = lambda suffix, value: None

    def publish(self, suffix: str, value: BaseModel, *, schema: type[BaseModel] | None = None) -> None:
        self.published.append((suffix, value))
        self.follower(suffix, value)

    def serve(self, root: str, handler: Any) -> None: ...

    def receive(self, suffix: str, take: Any, verify: Any) -> None: ...

    def receive_reports(self, suffix: str, take: Any, verify: Any, secret: str | None) -> None: ...

    def watch_client(self, name: str | None, watcher: Any) -> None: ...

    def values(self, suffix: str) -> list[Any]:
        return [value for key, value in self.published if key == suffix]

    def texts(self) -> list[str]:
        return [value.text for value in self.values("event/log")]


class ProcedureRig:
    """One daemon's procedures on a line."""

    def __init__(self, socket: Socket, folder: Path) -> None:
        self.socket, self.bus, self.phase = socket, Bus(), Phase.FREE
        self.refusal: Callable[[Any], None] = lambda message: None
        daemon = VirtualDaemon(self.bus, socket.open, journal=folder)
        clock, wiring, self.journal = daemon.clock, daemon.wiring, daemon.journal
        self.link, self.facts, self.control = wiring.link, wiring.facts, wiring.flight
        self.interlock, self.runner, self.run_line = wiring.interlock, wiring.procedures, wiring.run_line
        check_step = wiring.requests.check_step

        async def refuse_or_check(board: Any, message: Any) -> None:
            self.refusal(message)
            await check_step(board, message)

        wiring.requests.check_step = refuse_or_check
        self.interlock._situation = lambda: situation_of(self.facts, clock.now(), self.phase)
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
    rig.tasks = [asyncio.create_task(rig.runner.run()), asyncio.create_task(rig.run_line())]
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


def on_boards(make: Callable[[], Simulation]) -> Callable[[Callable[..., Any]], Callable[..., None]]:
    """Run a test in virtual time on a rig whose boards are known: the test's first argument."""

    def decorate(test: Callable[..., Any]) -> Callable[..., None]:
        @functools.wraps(test)
        async def run(tmp_path: Path, **arguments: Any) -> None:
            async with procedure_rig(plug_in(make), tmp_path) as rig:
                await rig.until_ready()
                folder = {"tmp_path": tmp_path} if "tmp_path" in wanted else {}
                await test(rig, **arguments, **folder)

        _, *others = inspect.signature(test).parameters.values()
        wanted = {one.name: one for one in others}
        folder = inspect.Parameter("tmp_path", inspect.Parameter.POSITIONAL_OR_KEYWORD)
        run.__signature__ = inspect.Signature(list(({"tmp_path": folder} | wanted).values()))  # type: ignore[attr-defined]
        return virtually(run)

    return decorate
