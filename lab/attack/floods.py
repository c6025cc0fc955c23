"""Floods and clients that vanish: the pilot flies on, and whoever wants to release can; or the holder itself floods.

The boards hang on a TCP port: what a pseudo terminal carries waits for a worker of the kernel, for 0.35 s beside a
flood on two cores, and that would be measured in the place of the daemon (docs/lab/attacks.md).
"""

from __future__ import annotations

import asyncio
import signal
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from itertools import pairwise
from typing import Final

from lab.attack.attackers import Flood
from lab.campaign import Row
from lab.cases import judged, percentile
from lab.rigs.flown import Flown, flown, observed
from lab.rigs.pilot import Pilot
from lab.rigs.processes import VEHICLE, ObservedSimulation, Program, Sticks
from lab.rigs.sticks import steering
from lab.rigs.waiting import PATIENCE, wait_until
from mkdaemon.cli.mkctl.connection import Connection
from mkdaemon.cli.mkctl.release import release
from mkdaemon.daemon.priority import favour_loop, favour_threads

LIMITS: Final = {"gap_p99": 0.06, "lost": 0, "memory_mb": 150.0, "log": 10_000.0, "released": 2.5}
"""Of a flight under attack, see `ride`; a release takes 1 s for the bus, then goes by the Unix socket."""
DEADLY: Final = {"neutral": 0.35, "released": 1.1}
"""From the last setpoint of a pilot or a holder [s]: 0.3 and 1 s, and what the daemon and the line take."""
ATTACKERS: Final = 2
SECONDS: Final = 5.0
"""How long an attack lasts [s]."""
CALM: Final = 1.5
"""Nothing is held for so long after a release [s]."""


@asynccontextmanager
async def daemon_on_tcp(seed: int, *, keeps: bool = True) -> AsyncIterator[Flown]:
    """Run a daemon before a FlightCtrl 2.08 on TCP while the context lasts."""
    favour_loop()  # who judges must not be starved by the machine's other programs
    simulation = observed(seed, "2.08", keeps=keeps)
    simulation.is_frozen = True  # until the daemon is there: on a busy machine the boards would cost it its start
    async with flown(simulation, on_tcp=True) as attacked:
        yield attacked


async def ride(kind: Flood, seed: int, *, dies: bool = False) -> Row:
    """Fly under attack, then release as a user would; or the pilot dies, and the attack goes on.

    Returns:
        `rates` that the attackers reached [1/s]; `gap_p99` and `gap_max` between two stick frames on the wire [s];
        `lost`, the FlightCtrl was not under control from beginning to end; `neutral`, from the pilot's last setpoint to
        level sticks [s], None where he flies on until the release; `released`, from `mkctl release` or his last
        setpoint to a FlightCtrl that holds nothing [s]; `memory_mb`, most that the daemon held at any time [MiB];
        `log`, what it wrote to standard error [bytes/s].

    Raises:
        TimeoutError: the flight did not begin, or the aircraft was never released.
    """
    async with daemon_on_tcp(seed) as attacked, Pilot(attacked.client, "pilot") as pilot:
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
            if dies:
                await pilot.stop()
                neutral, released = await let_go(simulation, pilot.puts[-1])
            else:
                neutral, released = None, await _release(pilot, attacked)
        rates = [(await one.output())[1].strip() for one in attackers]
    gaps = sorted(after - before for before, after in pairwise(times)) or [SECONDS]
    found = {"rates": rates, "gap_p99": percentile(gaps, 0.99), "gap_max": gaps[-1], "lost": not is_kept}
    found |= {"neutral": neutral, "released": released, "memory_mb": round(memory, 1), "log": round(log)}
    return judged(LIMITS | (DEADLY if dies else {}), **found)


async def let_go(simulation: ObservedSimulation, since: float) -> tuple[float, float]:
    """When tilted sticks were held last, and when anything was, from a time on [s; monotonic].

    Raises:
        TimeoutError: the aircraft was never released.
    """
    tilted = held = since
    while (now := time.monotonic()) < held + CALM:
        tilted = now if simulation.sticks is Sticks.STEERED else tilted
        held = now if simulation.sticks is not Sticks.NOTHING else held
        if now > since + PATIENCE:
            raise TimeoutError("the aircraft was never released")
        await asyncio.sleep(0.002)
    return round(tilted - since, 3), round(held - since, 3)


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


async def _release(pilot: Pilot, attacked: Flown) -> float:
    """Release as a user would; returns how long that took [s]."""
    called = time.monotonic()
    connection = Connection(vehicle=VEHICLE, connect=attacked.daemon.endpoint, json=True)
    asking = asyncio.create_task(release("the attack is over", connection=connection), name="release")
    await wait_until(lambda: not attacked.simulation.is_controlled)
    released = time.monotonic() - called
    await pilot.stop()
    await asking
    return round(released, 3)


async def flood_and_end(is_killed: bool, seed: int) -> Row:
    """Let the holder of the lease flood with tilted sticks, as many as go, and kill it or let it fall silent.

    Returns:
        `neutral` and `released`, from its last put until no tilted sticks were held, and until nothing was [s].

    Raises:
        TimeoutError: the flight did not begin, or the aircraft was never released.
    """
    async with daemon_on_tcp(seed, keeps=False) as attacked:
        words = ("-m", "lab.attack.attackers", Flood.HOLDER.value, attacked.daemon.endpoint, VEHICLE, str(SECONDS))
        holder = await Program.start(*words)
        try:
            if not await holder.first_line():
                raise TimeoutError("the flood did not begin")
            if is_killed:
                await asyncio.sleep(SECONDS - 1.0)
                holder.send_signal(signal.SIGKILL)
                last = time.monotonic()
            else:
                last = float(await holder.first_line())
            neutral, released = await let_go(attacked.simulation, last)
        finally:
            await holder.end(signal.SIGKILL)
    return judged(DEADLY, neutral=neutral, released=released)
