"""What every attack in real processes is flown with: a daemon before simulated boards on TCP, and a client."""

from __future__ import annotations

import tempfile
from collections.abc import AsyncIterator, Sequence
from contextlib import asynccontextmanager
from dataclasses import dataclass
from pathlib import Path

from lab.rigs.processes import START, DaemonProcess, ObservedSimulation, connected, daemon_process, wait_for_control
from mkdaemon.bus.endpoint import reserved_endpoint
from mkdaemon.client import Vehicle
from mkdaemon.daemon.priority import favour_loop
from mksim.config import PilotPlan, SimConfig
from mksim.runtime import Runtime


@dataclass(frozen=True, slots=True)
class Attacked:
    """A daemon that would grant a lease.

    Attributes:
        simulation: its boards.
        daemon: the process.
        client: of its bus.
        folder: for files of the flight.
    """

    simulation: ObservedSimulation
    daemon: DaemonProcess
    client: Vehicle
    folder: Path


@asynccontextmanager
async def daemon_on_tcp(
    seed: int, *, program: Sequence[str] | None = None, keeps: bool = True
) -> AsyncIterator[Attacked]:
    """Run a daemon on a FlightCtrl 2.08 while the context lasts.

    Args:
        seed: of the boards.
        program: what Python runs in place of the daemon's own program.
        keeps: whether the simulation keeps what the daemon writes.

    Raises:
        TimeoutError: the daemon did not come up.
    """
    favour_loop()  # who judges must not be starved by the machine's other programs
    fields = {"board": "fc", "fc": "2.08", "pilot_plan": PilotPlan.NOTHING, "calibrated": True, "seed": seed}
    simulation = ObservedSimulation(SimConfig.model_validate(fields), keeps=keeps)
    simulation.is_frozen = True  # until the daemon is there: on a busy machine the boards would cost it its start
    with reserved_endpoint() as port, tempfile.TemporaryDirectory() as name:
        where, folder = port.removeprefix("tcp/"), Path(name)
        async with (
            Runtime(simulation, listen=where).serve(),
            daemon_process(f"tcp:{where}", folder, program=program) as daemon,
            connected(daemon.endpoint, patience=START) as client,
        ):
            simulation.is_frozen = False
            await wait_for_control(client)
            yield Attacked(simulation, daemon, client, folder)
