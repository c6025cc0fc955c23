"""Floods and clients that vanish: the pilot flies on, and whoever wants to release can.

The boards hang on a TCP port: what a pseudo terminal carries waits for a worker of the kernel, for 0.35 s beside a
flood on two cores, and that would be measured in the place of the daemon (docs/lab/attacks.md).
"""

from __future__ import annotations

import asyncio
import signal
import time
from collections.abc import AsyncIterator, Sequence
from contextlib import asynccontextmanager
from itertools import pairwise
from typing import Final

from lab.attack.attackers import Flood
from lab.attack.programs import DEAF_DAEMON
from lab.campaign import Row
from lab.cases import percentile
from lab.rigs.flown import Flown, flown, observed
from lab.rigs.pilot import Pilot
from lab.rigs.processes import VEHICLE, Program, Sticks
from lab.rigs.waiting import wait_until
from lab.stories.kill import steering
from mkdaemon.cli.mkctl.connection import Connection
from mkdaemon.cli.mkctl.release import release
from mkdaemon.daemon.priority import favour_loop, favour_threads

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


@asynccontextmanager
async def daemon_on_tcp(seed: int, *, program: Sequence[str] | None = None, keeps: bool = True) -> AsyncIterator[Flown]:
    """Run a daemon, or `program` in its place, before a FlightCtrl 2.08 on TCP while the context lasts."""
    favour_loop()  # who judges must not be starved by the machine's other programs
    simulation = observed(seed, "2.08", keeps=keeps)
    simulation.is_frozen = True  # until the daemon is there: on a busy machine the boards would cost it its start
    async with flown(simulation, on_tcp=True, program=program) as attacked:
        yield attacked


async def ride(kind: Flood, seed: int, *, dies: bool = False) -> Row:
    """Fly under attack, then release as a user would; or the pilot dies, and the attack goes on.

    Returns:
        `rates` that the attackers reached [1/s]; `gap_p99` and `gap_max` between two stick frames on the wire [s];
        `kept`, the FlightCtrl was under control from beginning to end; `neutral`, from the pilot's last setpoint to
        level sticks [s], None where he flies on until the release; `released`, from `mkctl release` or his last
        setpoint to a FlightCtrl that holds nothing [s]; `memory_mb`, most that the daemon held at any time [MiB];
        `log`, what it wrote to standard error [bytes/s]; `is_wrong`, it breaks a limit.

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
            neutral, released = await (_die if dies else _release)(pilot, attacked)
        rates = [(await one.output())[1].strip() for one in attackers]
    gaps = sorted(after - before for before, after in pairwise(times)) or [SECONDS]
    row = {"rates": rates, "gap_p99": percentile(gaps, 0.99), "gap_max": gaps[-1], "kept": is_kept}
    row |= {"neutral": neutral, "released": released, "memory_mb": round(memory, 1), "log": round(log)}
    return row | {"is_wrong": breaks_limit(row)}


def breaks_limit(row: Row) -> bool:
    """Whether a flight under attack breaks a limit; see `ride`."""
    is_slow = row["gap_p99"] > GAP_LIMIT or row["released"] > RELEASE_LIMIT
    if row["neutral"] is not None:
        is_slow |= row["neutral"] > NEUTRAL_LIMIT or row["released"] > LADDER_LIMIT
    return bool(is_slow or not row["kept"] or row["memory_mb"] > MEMORY_LIMIT_MB or row["log"] > LOG_LIMIT)


@asynccontextmanager
async def _attacked(kind: Flood, endpoint: str) -> AsyncIterator[list[Program]]:
    """Attackers that have begun, for as long as the context lasts and a little longer.

    On a busy machine they take seconds to load: a flight that did not wait for them was hardly attacked.
    """
    words = ("-m", "lab.attack.attackers", kind.value, endpoint, VEHICLE, str(SECONDS + 2.0))
    attackers = [await Program.start(*words) for _ in range(ATTACKERS)]
    try:
        for one in attackers:
            await one.first_line()
        yield attackers
    finally:
        for one in attackers if kind is Flood.STOPPED else ():
            one.send_signal(signal.SIGKILL)


async def _release(pilot: Pilot, attacked: Flown) -> tuple[None, float]:
    """Release as a user would; returns how long that took [s]."""
    called = time.monotonic()
    connection = Connection(vehicle=VEHICLE, connect=attacked.daemon.endpoint, json=True)
    asking = asyncio.create_task(release("the attack is over", connection=connection), name="release")
    await wait_until(lambda: not attacked.simulation.is_controlled)
    released = time.monotonic() - called
    await pilot.stop()
    await asking
    return None, round(released, 3)


async def _die(pilot: Pilot, attacked: Flown) -> tuple[float, float]:
    """Let the pilot fall silent; returns when the sticks were level and when the aircraft was released [s]."""
    await pilot.stop()
    died = pilot.puts[-1]
    await wait_until(lambda: attacked.simulation.sticks is not Sticks.STEERED)
    neutral = time.monotonic() - died
    await wait_until(lambda: attacked.simulation.sticks is Sticks.NOTHING)
    return round(neutral, 3), round(time.monotonic() - died, 3)
