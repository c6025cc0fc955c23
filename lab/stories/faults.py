"""Faults of the line by name, at a random moment: the right word about the link in half a second, and up again after.

In virtual time, over the fault port of `boardport`, in front of a FlightCtrl and of a NaviCtrl.
"""

from __future__ import annotations

import asyncio
import random
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final

from lab.rigs.boardport import TICK_TIME, LineFault
from lab.rigs.cockpit import Boards, Cockpit, cockpit
from mkdaemon.telemetry.link import LinkCondition
from mkdaemon.virtualtime import run_virtually

VERDICT: Final = 0.5
"""The right word must be said within this time [s]."""
LASTS: Final = 2.5
"""How long a fault lasts [s]."""
BACK: Final = 15.0
"""Longest wait for the link to be up again [s]; losses leave the moving window after ten."""


@dataclass(frozen=True, slots=True)
class Expected:
    """What the link must say about a fault.

    Attributes:
        words: any of these.
        amount: how much of the fault.
    """

    words: frozenset[LinkCondition]
    amount: float = 0.0


def _any_of(*words: LinkCondition, amount: float = 0.0) -> Expected:
    return Expected(frozenset(words), amount)


FAULTS: Final[Mapping[LineFault, Expected]] = MappingProxyType(
    {
        LineFault.BYTE_LOSS: _any_of(LinkCondition.DEGRADED, LinkCondition.GARBAGE, amount=0.05),
        LineFault.BIT_FLIPS: _any_of(LinkCondition.DEGRADED, LinkCondition.GARBAGE, amount=0.03),
        LineFault.ONE_BYTE_AT_A_TIME: _any_of(LinkCondition.UP),
        LineFault.STUCK_WRITER: _any_of(LinkCondition.DOWN),
        LineFault.DEVICE_FULL: _any_of(LinkCondition.DOWN),
        LineFault.SILENCE: _any_of(LinkCondition.MUTE),
        LineFault.ONE_WAY: _any_of(LinkCondition.ONE_WAY),
        LineFault.ECHO_ONLY: _any_of(LinkCondition.DEGRADED),
        LineFault.GARBAGE: _any_of(LinkCondition.GARBAGE),
        LineFault.TEXT_FLOOD: _any_of(LinkCondition.GARBAGE),
        LineFault.REBOOT: _any_of(LinkCondition.MUTE),
        LineFault.UNPLUGGED: _any_of(LinkCondition.DOWN, LinkCondition.ABSENT),
        LineFault.GONE_DURING_WRITE: _any_of(LinkCondition.DOWN, LinkCondition.ABSENT),
    }
)
"""Every fault of the port but none."""


@dataclass(frozen=True, slots=True)
class Verdict:
    """What the link said about a fault.

    Attributes:
        verdict: time until one of the right words was said [s]; None for never.
        back: time until the link was up after the fault had ended [s]; None for never.
    """

    verdict: float | None
    back: float | None

    @property
    def is_wrong(self) -> bool:
        """Whether it breaks a limit."""
        return self.verdict is None or self.back is None or self.verdict > VERDICT


def judge_fault(boards: Boards, fault: LineFault, seed: int, tick: float = TICK_TIME) -> Verdict:
    """Inject a fault at a random moment, and take the times; bytes are carried every `tick` [s]."""
    return Verdict(*run_virtually(_suffer(boards, fault, seed, tick)))


async def _suffer(boards: Boards, fault: LineFault, seed: int, tick: float) -> tuple[float | None, float | None]:
    """Times until the right word, and until the link is up again after the fault [s]; None for never."""
    rng = random.Random(f"{seed} {fault.value}")
    async with cockpit(boards, seed, tick=tick) as flown:
        await asyncio.sleep(rng.uniform(1.0, 2.5))
        await flown.until(lambda: _word(flown) is LinkCondition.UP)
        expected = FAULTS[fault]
        port = flown.socket.port
        assert port is not None
        port.inject(fault, expected.amount)
        if LinkCondition.UP in expected.words:
            worse = await flown.until(lambda: _word(flown) is not LinkCondition.UP, LASTS)
            return (0.0, 0.0) if worse is None else (None, None)
        verdict = await flown.until(lambda: _word(flown) in expected.words, 2.0, step=0.002)
        await asyncio.sleep(LASTS)
        flown.socket.is_present = True
        if not port.is_closed:
            port.inject(LineFault.NONE)
        return verdict, await flown.until(lambda: _word(flown) is LinkCondition.UP, BACK)


def _word(flown: Cockpit) -> LinkCondition:
    """What the link told its listeners last: not what it may know and keep to itself."""
    return flown.sink.states[-1].condition
