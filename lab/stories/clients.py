"""Client processes that are killed or stopped while they fly, over real Zenoh sessions.

The counterpart of `lab.stories.deaths` in real time: how soon the bus itself tells that a client is gone.
"""

from __future__ import annotations

import asyncio
import random
import signal
import sys
import time
from contextlib import suppress
from dataclasses import dataclass
from typing import Final

from lab.rigs.flown import flown, observed
from lab.rigs.pilot import Pilot
from lab.rigs.processes import ObservedSimulation, connected
from lab.rigs.waiting import wait_until
from lab.stories.deaths import NEUTRAL_TIME, RELEASE_TIME

TILT: Final = 40.0
SIGNALS: Final = (signal.SIGKILL, signal.SIGSTOP)
_LATE: Final = 10.0
"""Longer than every limit and every dead-man: what takes so long never happens [s]."""
_CLIENT: Final = "import asyncio, sys; from lab.stories.clients import fly; asyncio.run(fly(*sys.argv[1:]))"


@dataclass(frozen=True, slots=True)
class Loss:
    """One client process lost; times from the signal, its last setpoint is up to 20 ms older.

    Attributes:
        signal: `SIGKILL` or `SIGSTOP`.
        neutral: level sticks, or none at all, in the FlightCtrl [s].
        released: Config cleared in the FlightCtrl [s].
    """

    signal: str
    neutral: float
    released: float

    @property
    def is_wrong(self) -> bool:
        """Whether it breaks a limit; the wire takes part of it, and the FlightCtrl samples later."""
        return self.neutral > NEUTRAL_TIME or self.released > RELEASE_TIME


async def fly(endpoint: str, name: str) -> None:
    """Be a client: take the lease, show the token, engage, then hold a tilt for ever."""
    async with connected(endpoint) as client, client.token(name), Pilot(client, name) as pilot:
        while True:
            if await pilot.take():
                await asyncio.sleep(1.2)
                pilot.sticks["pitch"] = TILT
                await asyncio.sleep(3600)
            await asyncio.sleep(0.1)


async def lose_clients(fc: str, runs: int, seed: int) -> list[Loss]:
    """Lose one client process after another to the same daemon."""
    rng = random.Random(f"{seed} {fc} clients")
    losses = []
    async with flown(observed(seed, fc)) as one:
        for number in range(runs):
            how = SIGNALS[number % len(SIGNALS)]
            losses.append(await _lose(one.daemon.endpoint, one.simulation, how, f"client{number}", rng))
    return losses


async def _lose(
    endpoint: str, simulation: ObservedSimulation, how: signal.Signals, name: str, rng: random.Random
) -> Loss:
    process = await asyncio.create_subprocess_exec(sys.executable, "-c", _CLIENT, endpoint, name)
    try:
        await wait_until(lambda: _tilts(simulation))
        await asyncio.sleep(rng.uniform(0.1, 0.5))
        began = time.monotonic()
        process.send_signal(how)
        neutral = await wait_until(lambda: not _tilts(simulation), _LATE)
        await wait_until(lambda: not simulation.is_controlled, _LATE)
        return Loss(how.name, round(neutral, 3), round(time.monotonic() - began, 3))
    finally:
        with suppress(ProcessLookupError):
            process.kill()
        await process.wait()


def _tilts(simulation: ObservedSimulation) -> bool:
    """Whether the FlightCtrl obeys the client's tilt."""
    return simulation.is_controlled and simulation.flight.external.held.pitch != 0
