"""Floods and clients that vanish: the pilot flies on, and whoever wants to release can.

The boards hang on a TCP port: what a pseudo terminal carries waits for a worker of the kernel, for 0.35 s beside a
flood on two cores, and that would be measured in the place of the daemon (docs/lab/attacks.md).
"""

from __future__ import annotations

import asyncio
import os
import signal
import sys
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

from lab.attack.attackers import Flood
from lab.attack.flown import daemon_on_tcp
from lab.attack.programs import DEAF_DAEMON
from lab.cases import percentile
from lab.rigs.pilot import Pilot
from lab.rigs.processes import (
    VEHICLE,
    ObservedSimulation,
    Sticks,
)
from lab.rigs.waiting import wait_until
from lab.stories.kill import steering
from mkdaemon.cli.mkctl.connection import Connection
from mkdaemon.cli.mkctl.release import release
from mkdaemon.daemon.priority import favour_threads

GAP_LIMIT: Final = 0.06
"""Between two stick frames, 99th percentile [s]."""
MEMORY_LIMIT_MB: Final = 150.0
LOG_LIMIT: Final = 10_000.0
"""What the daemon writes to standard error [bytes/s]."""
RELEASE_LIMIT: Final = 2.5
"""From `mkctl release` to a FlightCtrl that holds nothing [s]: 1 s for the bus, then the Unix socket."""
NEUTRAL_LIMIT: Final = 0.35
"""From the pilot's last setpoint to level sticks [s]: 0.3 s, and what the daemon and the line take."""
LADDER_LIMIT: Final = 1.1
"""From there to a FlightCtrl that holds nothing [s]: 1 s, and the same."""
ATTACKERS: Final = 2
SECONDS: Final = 5.0
"""How long an attack lasts [s]."""


@dataclass(frozen=True, slots=True)
class Ride:
    """One flight under attack.

    Attributes:
        rates: what each attacker reached [1/s].
        gap_p50: between two stick frames on the wire [s].
        gap_p99: the same, 99th percentile [s].
        gap_max: the same, longest [s].
        kept: the FlightCtrl was under control from beginning to end.
        neutral: from the pilot's last setpoint to level sticks [s]; None where he flies on until the release.
        released: from `mkctl release`, or from the pilot's last setpoint, to a FlightCtrl that holds nothing [s].
        memory_mb: most that the daemon held at any time [MiB].
        log: what it wrote to standard error [bytes/s].
        load: of the machine, over one minute.
    """

    rates: tuple[str, ...]
    gap_p50: float
    gap_p99: float
    gap_max: float
    kept: bool
    neutral: float | None
    released: float
    memory_mb: float
    log: float
    load: float

    @property
    def is_wrong(self) -> bool:
        """Whether it breaks a limit."""
        is_slow = self.gap_p99 > GAP_LIMIT or self.released > RELEASE_LIMIT
        if self.neutral is not None:
            is_slow |= self.neutral > NEUTRAL_LIMIT or self.released > LADDER_LIMIT
        return is_slow or not self.kept or self.memory_mb > MEMORY_LIMIT_MB or self.log > LOG_LIMIT


async def ride(kind: Flood, seed: int, *, dies: bool = False) -> Ride:
    """Fly under attack, then release as a user would; or the pilot dies, and the attack goes on.

    Raises:
        TimeoutError: the flight did not begin, or the aircraft was never released.
    """
    program = ("-c", DEAF_DAEMON) if kind is Flood.BLOCKED else None
    async with daemon_on_tcp(seed, program=program) as attacked, Pilot(attacked.client, "pilot") as pilot:
        simulation, daemon = attacked.simulation, attacked.daemon
        await pilot.engage(lambda: simulation.is_controlled)
        pilot.sticks |= {"pitch": 40.0}
        await asyncio.sleep(0.5)
        favour_threads()
        is_kept = True
        async with _attacked(kind, daemon.endpoint) as attackers:
            written, began = len(daemon.errors), time.monotonic()
            simulation.heard.clear()
            while time.monotonic() - began < SECONDS:
                await asyncio.sleep(0.02)
                is_kept &= simulation.is_controlled
            times = [at for at, data in simulation.heard if steering(data)]
            log = (len(daemon.errors) - written) / (time.monotonic() - began)
            memory = daemon.most_resident_mb()
            neutral, released = await (_die if dies else _release)(pilot, simulation, daemon.endpoint)
        rates = tuple([(await one.communicate())[0].decode().strip() for one in attackers])
    gaps = sorted(after - before for before, after in pairwise(times)) or [SECONDS]
    return Ride(
        rates,
        round(percentile(gaps, 0.5) or 0.0, 4),
        round(percentile(gaps, 0.99) or 0.0, 4),
        round(gaps[-1], 4),
        is_kept,
        neutral,
        released,
        round(memory, 1),
        round(log),
        round(os.getloadavg()[0], 1),
    )


@asynccontextmanager
async def _attacked(kind: Flood, endpoint: str) -> AsyncIterator[list[asyncio.subprocess.Process]]:
    """Attackers that have begun, for as long as the context lasts and a little longer.

    On a busy machine they take seconds to load: a flight that did not wait for them was hardly attacked.
    """
    words = ("-m", "lab.attack.attackers", kind.value, endpoint, VEHICLE, str(SECONDS + 2.0))
    attackers = [
        await asyncio.create_subprocess_exec(sys.executable, *words, stdout=asyncio.subprocess.PIPE)
        for _ in range(ATTACKERS)
    ]
    try:
        for one in attackers:
            assert one.stdout is not None
            await one.stdout.readline()
        yield attackers
    finally:
        for one in attackers:
            with suppress(ProcessLookupError):
                if kind is Flood.STOPPED:
                    one.send_signal(signal.SIGKILL)


async def _release(pilot: Pilot, simulation: ObservedSimulation, endpoint: str) -> tuple[None, float]:
    """Release as a user would; returns how long that took [s]."""
    called = time.monotonic()
    connection = Connection(vehicle=VEHICLE, connect=endpoint, json=True)
    asking = asyncio.create_task(release("the attack is over", connection=connection), name="release")
    await wait_until(lambda: not simulation.is_controlled)
    released = time.monotonic() - called
    await pilot.stop()
    await asking
    return None, round(released, 3)


async def _die(pilot: Pilot, simulation: ObservedSimulation, endpoint: str) -> tuple[float, float]:
    """Let the pilot fall silent; returns when the sticks were level and when the aircraft was released [s]."""
    del endpoint
    await pilot.stop()
    died = pilot.puts[-1]
    await wait_until(lambda: simulation.sticks is not Sticks.STEERED)
    neutral = time.monotonic() - died
    await wait_until(lambda: simulation.sticks is Sticks.NOTHING)
    return round(neutral, 3), round(time.monotonic() - died, 3)
