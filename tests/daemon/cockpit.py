"""The whole daemon in this process, flying the simulated boards over a pseudo terminal, and a client that flies it."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass, field
from typing import Any

import msgpack
import zenoh

from mkdaemon.client import Sample, Vehicle, connect
from mkdaemon.config.commands import CommandsConfig
from mkdaemon.config.control import ControlConfig, LeaseConfig
from mkdaemon.config.link import LinkConfig
from mkdaemon.config.root import Config
from mkdaemon.config.sim import PilotPlan, SimConfig
from mkdaemon.config.vehicle import VehicleConfig
from mkdaemon.daemon import run
from mkdaemon.errors import MkError
from mkdaemon.sim.runtime import Runtime
from mkdaemon.sim.simulation import Simulation
from tests.bus.support import bus_config, free_endpoint

PATIENCE = 60.0
"""Longest wait for anything [s]; a loaded machine is slow, not wrong."""


@dataclass
class Cockpit:
    """A flying set-up: simulator, daemon, and what an observer heard."""

    runtime: Runtime
    endpoint: str
    stop: asyncio.Event
    daemon: asyncio.Task[None]
    heard: list[Sample] = field(default_factory=list)
    news: asyncio.Event = field(default_factory=asyncio.Event)

    @asynccontextmanager
    async def client(self) -> AsyncIterator[Vehicle]:
        """A client of its own session, as another program would have."""
        async with connect("cockpit", self.endpoint) as client:
            yield client

    def values(self, suffix: str) -> list[dict[str, Any]]:
        """Everything heard under a key so far."""
        return [sample.fields for sample in self.heard if sample.suffix == suffix]

    async def until(self, claim: Callable[[], Any]) -> Any:
        """Wait until a claim about what was heard holds, and return its value."""
        async with asyncio.timeout(PATIENCE):
            while not (value := claim()):
                self.news.clear()
                await self.news.wait()
        return value

    async def until_phase(self, phase: str) -> dict[str, Any]:
        """Wait until control is in a phase now."""

        def now() -> dict[str, Any] | None:
            known = self.values("control/status")
            return known[-1] if known and known[-1]["phase"] == phase else None

        return await self.until(now)

    async def land(self) -> None:
        """End the daemon in order."""
        self.stop.set()
        async with asyncio.timeout(PATIENCE):
            await self.daemon


class Stream:
    """Setpoints at a steady rate for as long as the context lasts."""

    def __init__(self, client: Vehicle, epoch: int, rate: float = 50.0) -> None:
        self.sticks = {"pitch": 0.0, "roll": 0.0, "yaw": 0.0, "throttle": 0.0}
        self.epoch = epoch
        self.sequence = 0
        self._publisher = client.stream("setpoint/stick")
        self._period = 1 / rate
        self._task: asyncio.Task[None] | None = None

    async def __aenter__(self) -> Stream:
        self._task = asyncio.create_task(self._run(), name="stream")
        return self

    async def __aexit__(self, *_: object) -> None:
        self.end()

    def end(self) -> None:
        """Fall silent."""
        if self._task is not None:
            self._task.cancel()

    def put(self) -> None:
        """One setpoint."""
        self.sequence += 1
        self._publisher.put(msgpack.packb({**self.sticks, "epoch": self.epoch, "sequence": self.sequence, "ttl": 0.3}))

    async def _run(self) -> None:
        with suppress(zenoh.ZError):  # the session may be closed while it streams: that is what some tests are about
            while True:
                self.put()
                await asyncio.sleep(self._period)


@asynccontextmanager
async def cockpit(*, commands: CommandsConfig | None = None, **sim: Any) -> AsyncIterator[Cockpit]:
    """Simulator, daemon and observer; waits until external control is possible."""
    settings = {"board": "fc", "pilot_plan": PilotPlan.NOTHING, "calibrated": True} | sim
    runtime = Runtime(Simulation(SimConfig(**settings)))
    async with runtime.serve():
        endpoint = free_endpoint()
        cfg = Config(
            vehicle=VehicleConfig(name="cockpit"),
            link=LinkConfig(port=f"pty:{runtime.port}"),
            bus=bus_config(endpoint),
            control=ControlConfig(lease=LeaseConfig(ttl=60.0)),
            commands=commands or CommandsConfig(),
        )
        stop = asyncio.Event()
        daemon = asyncio.create_task(run(cfg, stop), name="daemon")
        flown = Cockpit(runtime, endpoint, stop, daemon)
        async with _observer(flown):
            await flown.until(
                lambda: (
                    any(state["external_control"] for state in flown.values("link/state"))
                    and flown.values("link/state")[-1]["condition"] in {"up", "degraded"}
                )
            )
            try:
                yield flown
            finally:
                await flown.land()


@asynccontextmanager
async def _observer(flown: Cockpit) -> AsyncIterator[None]:
    async with asyncio.timeout(PATIENCE):
        while True:
            try:
                session = connect("cockpit", flown.endpoint)
                client = await session.__aenter__()
                break
            except MkError:
                if flown.daemon.done():
                    await flown.daemon
                await asyncio.sleep(0.02)

    async def listen() -> None:
        async with client.watch("**") as samples:
            async for sample in samples:
                flown.heard.append(sample)
                flown.news.set()

    listening = asyncio.create_task(listen(), name="observer")
    try:
        for sample in (await client.get_all("link/state")).values():
            flown.heard.append(sample)
        yield
    finally:
        listening.cancel()
        await asyncio.gather(listening, return_exceptions=True)
        await session.__aexit__(None, None, None)
