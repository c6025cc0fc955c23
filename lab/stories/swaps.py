"""Another aircraft at the same port: no frame in the layout of the one before, and the right one is discovered.

In virtual time, with a caller that sends sticks in whatever layout the link takes, as often as it takes them.
"""

from __future__ import annotations

import asyncio
import random
from contextlib import suppress
from enum import StrEnum
from typing import Final

from lab.campaign import Row
from lab.cases import judged
from lab.rigs.boardport import LineFault
from lab.rigs.linkrig import Rig, navi_ctrl, rig
from lab.rigs.sticks import build_sticks
from lab.rigs.waiting import in_virtual_time, running
from mkdaemon.link.session.identity import GAP
from mkdaemon.protocol.messages import ExternControlV1, ExternControlV2
from mkdaemon.protocol.wire import WireMessage

LAYOUTS: Final[dict[str, type[WireMessage]]] = {"2.12a": ExternControlV2, "2.08": ExternControlV1}
LONGEST: Final = 2.0
"""The longest exchange [s]; the shortest is as long as a silence that the daemon takes for one."""
FOUND: Final = 20.0
"""The new aircraft is known so long after the swap, or after its motors stop [s]."""


class Swap(StrEnum):
    """How the aircraft changes."""

    CABLE = "the cable is pulled and plugged into the other"
    SILENCE = "the port stays open"
    IN_FLIGHT = "the port stays open, the first one flies"
    BOTH_FLY = "the port stays open, both fly"


@in_virtual_time
async def swap_aircraft(runs: int, seed: int) -> list[Row]:
    """Exchange the aircraft at one port so often there and back, FlightCtrl 2.12a and 2.08 in turn.

    Returns:
        Of each `swap`, how; `wrong`, frames with the valid bit in the layout of another aircraft than the one at the
        port; `right`, frames with it in its own; `found`, the release that was discovered in time, empty for none;
        `is_missed`, it is not the right one, or nothing was flown.
    """
    found = []
    words = tuple(LAYOUTS)
    async with rig(navi_ctrl("0.24", words[0], seed, gate_parameter=200), seed=seed) as r, running(fly_as_allowed(r)):
        await r.until(lambda: r.link.dialect.extern_control is LAYOUTS[words[0]], FOUND)
        for number in range(2 * runs):
            rng = random.Random(f"{seed} swap {number}")
            await asyncio.sleep(rng.uniform(1.0, 2.0))
            found.append(await _exchange(r, list(Swap)[number % len(Swap)], words[(number + 1) % 2], number, rng))
    return found


async def fly_as_allowed(r: Rig) -> None:
    """Stream sticks in whatever layout the link takes, for ever."""
    while True:
        layout = r.link.dialect.extern_control
        if layout is not None:
            deadline = asyncio.get_running_loop().time() + 0.1
            r.link.send_setpoint(build_sticks(layout, throttle=60, pitch=20), deadline=deadline)
        await asyncio.sleep(0.025)


async def _exchange(r: Rig, swap: Swap, word: str, number: int, rng: random.Random) -> Row:
    if swap in {Swap.IN_FLIGHT, Swap.BOTH_FLY}:
        _take_off(r)
        await asyncio.sleep(5.0)
    port = r.socket.port
    assert port is not None
    if swap is Swap.CABLE:
        r.socket.unplug()
    else:
        port.inject(LineFault.SILENCE)
    await asyncio.sleep(rng.uniform(GAP, LONGEST))
    r.socket.replace(navi_ctrl("0.24", word, number, gate_parameter=200))
    r.log.tx.clear()
    if swap is Swap.CABLE:
        r.socket.is_present = True
        await r.until(lambda: r.link.doubt is not None and r.link.doubt.token == "other_aircraft", FOUND)
        r.log.tx.clear()
        r.link.accept_aircraft()
    else:
        await asyncio.sleep(0.3)
        if swap is Swap.BOTH_FLY:
            _take_off(r)
        port.inject(LineFault.NONE)
    if swap is Swap.BOTH_FLY:
        await asyncio.sleep(5.0)
        r.socket.aircraft.flight.core.stop()
    with suppress(AssertionError):
        await r.until(lambda: r.link.dialect.extern_control is LAYOUTS[word], FOUND)
    await asyncio.sleep(1.0)
    sent = [frame.message for frame in r.log.tx if frame.message is not None]
    valid = [type(message) for message in sent if message.spec.id == "b" and int(getattr(message, "config", 0)) & 1]
    right = valid.count(LAYOUTS[word])
    found = str(r.link.dialect.fc_release or "")
    is_missed = not right or not found.startswith(word)
    limits = {"wrong": 0, "is_missed": False}
    return judged(limits, swap=swap, wrong=len(valid) - right, right=right, found=found, is_missed=is_missed)


def _take_off(r: Rig) -> None:
    r.socket.aircraft.world.pilot.gas = 60
    r.socket.aircraft.flight.core.start()
