"""The guard is killed in flight: who flies goes on, the daemon says so at once, and nobody gets a new lease."""

from __future__ import annotations

import asyncio
import os
import signal
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from lab.rigs.pilot import Pilot
from lab.rigs.processes import ObservedSimulation, connected, daemon_process, wait_for_control
from lab.rigs.waiting import wait_until
from mkdaemon import guard
from mkdaemon.bus.endpoint import reserved_endpoint
from mkdaemon.client import Vehicle
from mkdaemon.config.sim import PilotPlan, SimConfig
from mkdaemon.sim.runtime import Runtime
from mkdaemon.telemetry.refusals import Token

NOTICE_LIMIT: Final = 0.5
"""The daemon says that its guard is gone within this time [s]."""
WATCH: Final = 3.0
"""How long the flight goes on [s]."""


@dataclass(frozen=True, slots=True)
class GuardDeath:
    """One guard killed.

    Attributes:
        noticed: until `event/log` said so [s].
        token: of the refusal that a second client got; None where it got the lease.
        kept: the FlightCtrl was under control all the while.
    """

    noticed: float
    token: str | None
    kept: bool

    @property
    def is_wrong(self) -> bool:
        """Whether it breaks a limit."""
        return self.noticed > NOTICE_LIMIT or self.token != Token.GUARD_DEAD or not self.kept


async def kill_guard(seed: int) -> GuardDeath:
    """Fly, and kill the guard.

    Raises:
        TimeoutError: the flight did not begin, or nothing was said.
    """
    fields = {"board": "fc", "fc": "2.08", "pilot_plan": PilotPlan.NOTHING, "calibrated": True, "seed": seed}
    simulation = ObservedSimulation(SimConfig.model_validate(fields))
    with reserved_endpoint() as port, tempfile.TemporaryDirectory() as name:
        where = port.removeprefix("tcp/")
        async with (
            Runtime(simulation, listen=where).serve(),
            daemon_process(f"tcp:{where}", Path(name)) as daemon,
            connected(daemon.endpoint) as client,
            Pilot(client, "pilot") as pilot,
        ):
            await wait_for_control(client)
            await pilot.engage(lambda: simulation.is_controlled)
            events: list[str] = []
            listening = asyncio.create_task(_listen(client, events), name="events")
            await asyncio.sleep(0.5)
            began = time.monotonic()
            os.kill(_guard_of(daemon.pid), signal.SIGKILL)
            await wait_until(lambda: any("guard is gone" in text for text in events))
            noticed = time.monotonic() - began
            request = {"action": "take", "holder": "another", "force": True}
            answer = await client.command("do", "lease", request)
            is_kept = True
            while time.monotonic() - began < WATCH:
                await asyncio.sleep(0.02)
                is_kept &= simulation.is_controlled
            listening.cancel()
            return GuardDeath(round(noticed, 3), answer.token, is_kept)


async def _listen(client: Vehicle, events: list[str]) -> None:
    async with client.watch("event/log") as samples:
        async for sample in samples:
            events += [str(sample.fields["text"])]


def _guard_of(pid: int) -> int:
    """The guard of a daemon.

    Raises:
        LookupError: it has none.
    """
    for task in Path(f"/proc/{pid}/task").iterdir():
        for child in (task / "children").read_text(encoding="ascii").split():
            if str(guard.__file__) in Path(f"/proc/{child}/cmdline").read_text(encoding="utf-8"):
                return int(child)
    msg = f"process {pid} has no guard"
    raise LookupError(msg)
