"""Deaths of the daemon in virtual time: the guard's own rules and frames, the link and the boards; no process.

What is left out is what only real processes have: the socket between daemon and guard, the descriptor of the port, the
scheduler. `lab.attack.deaths` has those.
"""

from __future__ import annotations

import asyncio
import math
import random
from dataclasses import dataclass
from enum import StrEnum
from typing import Final

from lab.attack.deaths import NEUTRAL_LIMIT, RELEASE_LIMIT
from lab.rigs.boardport import ADAPTER_TIME, LineFault
from lab.rigs.cockpit import Boards, Cockpit, cockpit
from lab.rigs.virtualguard import VirtualGuard
from lab.stories.deaths import settled
from lab.stories.standstills import Streamer, is_tilted
from mkdaemon.virtualtime import run_virtually

WATCH: Final = 3.0
"""How long the boards are watched after the death [s]."""
CUT: Final = 0.5
"""Share of the flights in which the daemon's last frame is cut short."""


class Silence(StrEnum):
    """What the guard notices."""

    CLOSED = "channel closed"
    """The daemon is gone: killed, aborted, out of memory."""
    AGED = "heartbeat aged"
    """It stands still, and its end of the channel is open."""


@dataclass(frozen=True, slots=True)
class VirtualDeath:
    """One death.

    Attributes:
        seed: of the flight.
        neutral: until the FlightCtrl held neutral sticks or nothing [s].
        released: until it held nothing for good [s].
        is_cut: the daemon's last frame was cut short.
    """

    seed: int
    neutral: float
    released: float
    is_cut: bool

    @property
    def is_wrong(self) -> bool:
        """Whether it breaks a limit."""
        return self.neutral > NEUTRAL_LIMIT or self.released > RELEASE_LIMIT


async def fly_virtually(boards: Boards, silence: Silence, seed: int) -> VirtualDeath:
    """Fly in virtual time on a thread of its own, and let the daemon die."""
    return await asyncio.to_thread(run_virtually, _fly(boards, silence, seed))


async def _fly(boards: Boards, silence: Silence, seed: int) -> VirtualDeath:
    rng = random.Random(f"{seed} {boards.name} {silence}")
    guard = VirtualGuard()
    async with cockpit(boards, seed, guard=guard, tick=ADAPTER_TIME) as flown:
        guard.write = lambda data: flown.aircraft.write(data, flown.socket.now())
        client = asyncio.create_task(Streamer(flown, "pilot").fly(), name="client")
        if await flown.until(lambda: flown.aircraft.is_controlled and is_tilted(flown.sink.tx[-40:])) is None:
            msg = "the flight did not begin"
            raise TimeoutError(msg)
        await asyncio.sleep(rng.uniform(0.2, 0.8))
        is_cut = rng.random() < CUT
        began = _let_die(flown, guard, silence, rng if is_cut else None)
        await asyncio.sleep(WATCH)
        client.cancel()
        guard.stop()
        held = flown.aircraft.held
        ends = settled(held, lambda one: one.is_neutral), settled(held, lambda one: not one.is_valid)
    neutral, released = (math.inf if end is None else round(end - began, 3) for end in ends)
    return VirtualDeath(seed, neutral, released, is_cut)


def _let_die(flown: Cockpit, guard: VirtualGuard, silence: Silence, cut: random.Random | None) -> float:
    """Let nothing of the daemon reach the boards or the guard any more; returns when [s; of the boards].

    Args:
        flown: the flight.
        guard: its guard.
        silence: what the guard notices.
        cut: draws how much of one more frame leaves; None for nothing of it.
    """
    port, last = flown.socket.port, flown.sink.tx[-1].raw
    assert port is not None
    port.inject(LineFault.STUCK_WRITER)
    if cut is not None:
        flown.aircraft.write(last[: cut.randrange(1, len(last))], flown.socket.now())
    if silence is Silence.CLOSED:
        guard.daemon_died()
    else:
        guard.daemon_stopped()
    return flown.socket.now()
