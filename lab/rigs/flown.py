"""A daemon process before simulated boards, and a client of its bus: what flights of real processes begin with."""

from __future__ import annotations

import tempfile
from collections.abc import AsyncIterator
from contextlib import ExitStack, asynccontextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lab.rigs.processes import START, DaemonProcess, ObservedSimulation, connected, daemon_process, wait_for_control
from mkdaemon.bus.endpoint import reserved_endpoint
from mkdaemon.client import Vehicle
from mksim.config import PilotPlan, SimConfig
from mksim.runtime import Runtime


@dataclass(frozen=True, slots=True)
class Flown:
    """What is flown.

    Attributes:
        folder: for files of the flight.
        port: URL of the boards' line.
    """

    simulation: ObservedSimulation
    daemon: DaemonProcess
    client: Vehicle
    folder: Path
    port: str


def observed(seed: int, fc: str = "2.12a", nc: str | None = None, **more: Any) -> ObservedSimulation:
    """Boards whose pilot does nothing; they keep nothing of what the host writes, unless `keeps` is given.

    Args:
        nc: of the NaviCtrl in front of it; None for none.
        more: `keeps`, or a field of the configuration.
    """
    keeps = more.pop("keeps", False)
    front = {"board": "fc"} if nc is None else {"board": "nc", "nc": nc}
    fields = {**front, "fc": fc, "pilot_plan": PilotPlan.NOTHING, "calibrated": True, "seed": seed, **more}
    return ObservedSimulation(SimConfig.model_validate(fields), keeps=keeps)


@asynccontextmanager
async def flown(
    simulation: ObservedSimulation,
    *,
    folder: Path | None = None,
    on_tcp: bool = False,
    waits: bool = True,
    **daemon: Any,
) -> AsyncIterator[Flown]:
    """Run a daemon before boards while the context lasts; boards that are frozen are let go when it is there.

    Args:
        on_tcp: the boards hang on a TCP port in place of a pseudo terminal.
        waits: it begins when the daemon would grant a lease.

    Raises:
        TimeoutError: the daemon did not come up.
    """
    with ExitStack() as stack:
        place = folder or Path(stack.enter_context(tempfile.TemporaryDirectory()))
        listen = stack.enter_context(reserved_endpoint()).removeprefix("tcp/") if on_tcp else None
        runtime = Runtime(simulation, listen=listen)
        port = f"pty:{runtime.port}" if listen is None else f"tcp:{listen}"
        async with (
            runtime.serve(),
            daemon_process(port, place, **daemon) as process,
            connected(process.endpoint, patience=START) as client,
        ):
            simulation.is_frozen = False
            if waits:
                await wait_for_control(client)
            yield Flown(simulation, process, client, place, port)
