"""Floods and clients that vanish: the pilot flies on, and whoever wants to release can.

The boards hang on a TCP port: what a pseudo terminal carries waits for a worker of the kernel, for 0.35 s beside a
flood on two cores, and that would be measured in the place of the daemon (docs/security.md).
"""

from __future__ import annotations

import asyncio
import os
import signal
import sys
import tempfile
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Final

from lab.attack.attackers import Flood
from lab.attack.programs import DEAF_DAEMON
from lab.rigs.pilot import Pilot
from lab.rigs.processes import START, VEHICLE, ObservedSimulation, connected, daemon_process, wait_for_control
from lab.rigs.waiting import wait_until
from lab.stories.kill import steering
from lab.stories.losses import percentile
from mkdaemon.bus.endpoint import reserved_endpoint
from mkdaemon.cli.mkctl.connection import Connection
from mkdaemon.cli.mkctl.release import release
from mkdaemon.daemon.priority import favour_loop, favour_threads
from mksim.config import PilotPlan, SimConfig
from mksim.runtime import Runtime

GAP_LIMIT: Final = 0.06
"""Between two stick frames, 99th percentile [s]."""
MEMORY_LIMIT_MB: Final = 150.0
LOG_LIMIT: Final = 10_000.0
"""What the daemon writes to standard error [bytes/s]."""
RELEASE_LIMIT: Final = 2.5
"""From `mkctl release` to a FlightCtrl that holds nothing [s]: 1 s for the bus, then the Unix socket."""
ATTACKERS: Final = 2
SECONDS: Final = 5.0
"""How long an attack lasts [s]."""


@dataclass(frozen=True, slots=True)
class Ride:
    """One flight under attack.

    Attributes:
        kind: the attack.
        rates: what each attacker reached [1/s].
        gap_p50: between two stick frames on the wire [s].
        gap_p99: the same, 99th percentile [s].
        gap_max: the same, longest [s].
        kept: the FlightCtrl was under control from beginning to end.
        released: from `mkctl release` to a FlightCtrl that holds nothing [s].
        memory_mb: most that the daemon held at any time [MiB].
        log: what it wrote to standard error [bytes/s].
        load: of the machine, over one minute.
    """

    kind: str
    rates: tuple[str, ...]
    gap_p50: float
    gap_p99: float
    gap_max: float
    kept: bool
    released: float
    memory_mb: float
    log: float
    load: float

    @property
    def is_wrong(self) -> bool:
        """Whether it breaks a limit."""
        is_slow = self.gap_p99 > GAP_LIMIT or self.released > RELEASE_LIMIT
        return is_slow or not self.kept or self.memory_mb > MEMORY_LIMIT_MB or self.log > LOG_LIMIT


async def ride(kind: Flood, seed: int) -> Ride:
    """Fly under attack, then release as a user would.

    Raises:
        TimeoutError: the flight did not begin, or the aircraft was never released.
    """
    favour_loop()
    fields = {"board": "fc", "fc": "2.08", "pilot_plan": PilotPlan.NOTHING, "calibrated": True, "seed": seed}
    program = ("-c", DEAF_DAEMON) if kind is Flood.BLOCKED else None
    simulation = ObservedSimulation(SimConfig.model_validate(fields))
    with reserved_endpoint() as port, tempfile.TemporaryDirectory() as name:
        where = port.removeprefix("tcp/")
        async with (
            Runtime(simulation, listen=where).serve(),
            daemon_process(f"tcp:{where}", Path(name), program=program) as daemon,
            connected(daemon.endpoint, patience=START) as client,
            Pilot(client, "pilot") as pilot,
        ):
            await wait_for_control(client)
            await pilot.engage(lambda: simulation.is_controlled)
            pilot.sticks |= {"pitch": 40.0}
            await asyncio.sleep(0.5)
            favour_threads()
            simulation.heard.clear()
            written, began = len(daemon.errors), time.monotonic()
            is_kept = True
            async with _attacked(kind, daemon.endpoint) as attackers:
                while time.monotonic() - began < SECONDS:
                    await asyncio.sleep(0.02)
                    is_kept &= simulation.is_controlled
                times = [at for at, data in simulation.heard if steering(data)]
                log = (len(daemon.errors) - written) / (time.monotonic() - began)
                memory = daemon.most_resident_mb()
                called = time.monotonic()
                asking = asyncio.create_task(_release(daemon.endpoint), name="release")
                await wait_until(lambda: not simulation.is_controlled)
                released = time.monotonic() - called
                await pilot.stop()
                await asking
            rates = tuple([(await one.communicate())[0].decode().strip() for one in attackers])
    gaps = sorted(after - before for before, after in pairwise(times)) or [SECONDS]
    return Ride(
        kind.value,
        rates,
        round(percentile(gaps, 0.5) or 0.0, 4),
        round(percentile(gaps, 0.99) or 0.0, 4),
        round(gaps[-1], 4),
        is_kept,
        round(released, 3),
        round(memory, 1),
        round(log),
        round(os.getloadavg()[0], 1),
    )


@asynccontextmanager
async def _attacked(kind: Flood, endpoint: str) -> AsyncIterator[list[asyncio.subprocess.Process]]:
    """Attackers for as long as the context lasts, and a little longer."""
    words = ("-m", "lab.attack.attackers", kind.value, endpoint, VEHICLE, str(SECONDS + 2.0))
    attackers = [
        await asyncio.create_subprocess_exec("nice", "-n", "5", sys.executable, *words, stdout=asyncio.subprocess.PIPE)
        for _ in range(ATTACKERS)
    ]
    try:
        yield attackers
    finally:
        for one in attackers:
            with suppress(ProcessLookupError):
                if kind is Flood.STOPPED:
                    one.send_signal(signal.SIGKILL)


async def _release(endpoint: str) -> None:
    await release("the attack is over", connection=Connection(vehicle=VEHICLE, connect=endpoint, json=True))
