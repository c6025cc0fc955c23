"""Faults of the line by name, at a random moment: the right word about the link in half a second, and up again after.

In virtual time, over the fault port of `boardport`, in front of a FlightCtrl and of a NaviCtrl.
"""

from __future__ import annotations

import asyncio
import math
import random
from collections.abc import Mapping
from types import MappingProxyType
from typing import Final

from lab.campaign import Row
from lab.cases import judged
from lab.rigs.boardport import TICK_TIME, LineFault
from lab.rigs.cockpit import Boards, Cockpit, cockpit
from lab.rigs.waiting import in_virtual_time
from mkdaemon.telemetry.link import LinkCondition

VERDICT: Final = 0.5
"""The right word must be said within this time [s]."""
LASTS: Final = 2.5
"""How long a fault lasts [s]."""
BACK: Final = 15.0
"""Longest wait for the link to be up again [s]; losses leave the moving window after ten."""


HARMED: Final = {LineFault.BYTE_LOSS: 0.05, LineFault.BIT_FLIPS: 0.03}
"""Share of the bytes that such a fault spoils."""
FAULTS: Final[Mapping[LineFault, frozenset[LinkCondition]]] = MappingProxyType(
    {
        LineFault.BYTE_LOSS: frozenset({LinkCondition.DEGRADED, LinkCondition.GARBAGE}),
        LineFault.BIT_FLIPS: frozenset({LinkCondition.DEGRADED, LinkCondition.GARBAGE}),
        LineFault.ONE_BYTE_AT_A_TIME: frozenset({LinkCondition.UP}),
        LineFault.STUCK_WRITER: frozenset({LinkCondition.DOWN}),
        LineFault.DEVICE_FULL: frozenset({LinkCondition.DOWN}),
        LineFault.SILENCE: frozenset({LinkCondition.MUTE}),
        LineFault.ONE_WAY: frozenset({LinkCondition.ONE_WAY}),
        LineFault.ECHO_ONLY: frozenset({LinkCondition.DEGRADED}),
        LineFault.GARBAGE: frozenset({LinkCondition.GARBAGE}),
        LineFault.TEXT_FLOOD: frozenset({LinkCondition.GARBAGE}),
        LineFault.REBOOT: frozenset({LinkCondition.MUTE}),
        LineFault.UNPLUGGED: frozenset({LinkCondition.DOWN, LinkCondition.ABSENT}),
        LineFault.GONE_DURING_WRITE: frozenset({LinkCondition.DOWN, LinkCondition.ABSENT}),
    }
)
"""What the link must say about every fault of the port but none: any of these words."""


@in_virtual_time
async def judge_fault(boards: Boards, fault: LineFault, seed: int, tick: float = TICK_TIME) -> Row:
    """Inject a fault at a random moment, and take the times; bytes are carried every `tick` [s].

    Returns:
        `verdict`: time until one of the right words was said [s]; `back`: until the link was up after the fault had
        ended [s]; None for never.
    """
    verdict, back = await _suffer(boards, fault, seed, tick)
    return judged({"verdict": VERDICT, "back": math.inf}, verdict=verdict, back=back)


async def _suffer(boards: Boards, fault: LineFault, seed: int, tick: float) -> tuple[float | None, float | None]:
    rng = random.Random(f"{seed} {fault.value}")
    async with cockpit(boards, seed, tick=tick) as flown:
        await asyncio.sleep(rng.uniform(1.0, 2.5))
        await flown.until(lambda: _word(flown) is LinkCondition.UP)
        words, port = FAULTS[fault], flown.socket.port
        assert port is not None
        port.inject(fault, HARMED.get(fault, 0.0))
        if LinkCondition.UP in words:
            worse = await flown.until(lambda: _word(flown) is not LinkCondition.UP, LASTS)
            return (0.0, 0.0) if worse is None else (None, None)
        verdict = await flown.until(lambda: _word(flown) in words, 2.0, step=0.002)
        await asyncio.sleep(LASTS)
        flown.socket.is_present = True
        if not port.is_closed:
            port.inject(LineFault.NONE)
        return verdict, await flown.until(lambda: _word(flown) is LinkCondition.UP, BACK)


def _word(flown: Cockpit) -> LinkCondition:
    """What the link told its listeners last: not what it may know and keep to itself."""
    return flown.sink.states[-1].condition
