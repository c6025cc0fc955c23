"""The whole daemon in this process, in real time, on simulated boards behind a TCP port, and who watches it.

Not a pseudo terminal: what it carries waits for a worker of the kernel, up to 0.8 s beside other busy programs where
the kernel groups programs by session, and that ends a flight as a mute line must (docs/operations.md).
"""

from __future__ import annotations

import asyncio
from collections import defaultdict
from collections.abc import AsyncIterator, Callable, Sequence
from contextlib import asynccontextmanager
from typing import Any, Final, TypeVar

from lab.rigs.boardport import ADAPTER_TIME
from lab.rigs.processes import connected, wait_for_control
from lab.rigs.waiting import PATIENCE, following, wait_for
from mkdaemon.bus.endpoint import reserved_endpoint
from mkdaemon.client import Sample, Vehicle, connect
from mkdaemon.config.bus import BusConfig
from mkdaemon.config.commands import CommandsConfig
from mkdaemon.config.control import ControlConfig, LeaseConfig
from mkdaemon.config.link import LinkConfig
from mkdaemon.config.record import RecordConfig
from mkdaemon.config.root import Config
from mkdaemon.config.vehicle import VehicleConfig
from mkdaemon.daemon import run
from mksim.config import PilotPlan, SimConfig
from mksim.runtime import Runtime
from mksim.simulation import Simulation

VEHICLE: Final = "cockpit"
LOOK: Final = 0.01
"""Between two looks at what was received [s]."""

_Found = TypeVar("_Found")


class LiveDaemon:
    """A simulator, a daemon, and what an observer received from it.

    Attributes:
        endpoint: where the daemon's bus listens.
    """

    def __init__(self, runtime: Runtime, endpoint: str, stop: asyncio.Event, task: asyncio.Task[None]) -> None:
        self.runtime = runtime
        self.endpoint = endpoint
        self.samples: list[Sample] = []
        self._by_suffix: defaultdict[str, list[dict[str, Any]]] = defaultdict(list)
        self._stop = stop
        self._task = task

    @asynccontextmanager
    async def client(self) -> AsyncIterator[Vehicle]:
        """A client of its own session, as another program would have."""
        async with connect(VEHICLE, self.endpoint) as client:
            yield client

    def keep(self, sample: Sample) -> None:
        """Take what was received."""
        self.samples.append(sample)
        self._by_suffix[sample.suffix].append(sample.fields)

    def values(self, suffix: str) -> Sequence[dict[str, Any]]:
        """Everything received under a key so far."""
        return self._by_suffix[suffix]

    async def until(self, find: Callable[[], _Found]) -> _Found:
        """Wait until a look at what was received finds something, and return it.

        Raises:
            TimeoutError: it found nothing.
        """
        return await wait_for(find, step=LOOK)

    async def until_phase(self, phase: str) -> dict[str, Any]:
        """Wait until control is in a phase, and return its status.

        Raises:
            TimeoutError: it never was.
        """

        def status() -> dict[str, Any]:
            known = self.values("control/status")
            return known[-1] if known and known[-1]["phase"] == phase else {}

        return await self.until(status)

    async def end(self) -> None:
        """End the daemon in order.

        Raises:
            TimeoutError: it went on.
        """
        self._stop.set()
        async with asyncio.timeout(PATIENCE):
            await self._task


@asynccontextmanager
async def live_daemon(
    *, commands: CommandsConfig | None = None, bus: BusConfig | None = None, **sim: Any
) -> AsyncIterator[LiveDaemon]:
    """A daemon that runs as long as the context lasts, as soon as external control is possible.

    Args:
        bus: a router that the daemon connects to, at which it is reached then; it listens itself by default.

    Raises:
        TimeoutError: external control was not possible in time.
    """
    settings = {"board": "fc", "pilot_plan": PilotPlan.NOTHING, "calibrated": True} | sim
    with reserved_endpoint() as endpoint, reserved_endpoint() as port:
        where = port.removeprefix("tcp/")
        async with Runtime(Simulation(SimConfig(**settings)), listen=where, tick=ADAPTER_TIME).serve() as runtime:
            cfg = Config(
                vehicle=VehicleConfig(name=VEHICLE),
                link=LinkConfig(port=f"tcp:{where}"),
                bus=bus or BusConfig(listen=(endpoint,), lease=30.0),
                control=ControlConfig(lease=LeaseConfig(ttl=60.0)),
                commands=commands or CommandsConfig(),
                record=RecordConfig(enabled=False),
            )
            stop = asyncio.Event()
            live = LiveDaemon(
                runtime, bus.connect[0] if bus else endpoint, stop, asyncio.create_task(run(cfg, stop), name="daemon")
            )
            async with connected(live.endpoint, VEHICLE) as client, following(client, live.keep, "**"):
                await wait_for_control(client)
                try:
                    yield live
                finally:
                    await live.end()
