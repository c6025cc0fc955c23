"""The cable is pulled while a client flies and plugged in again, or the board reboots: telemetry back, sticks free.

In virtual time, with a client that notices nothing and goes on streaming.
"""

from __future__ import annotations

import asyncio
import itertools
import random
from collections.abc import Sequence
from enum import StrEnum
from typing import Final

from lab.campaign import Row
from lab.cases import judged
from lab.rigs.boardport import TICK_TIME, LineFault
from lab.rigs.cockpit import Boards, Cockpit, Held, cockpit
from lab.rigs.waiting import in_virtual_time, running
from lab.stories.standstills import Streamer
from mkdaemon.link.session.traffic import Purpose
from mkdaemon.protocol.decoder import MessageDecoder
from mkdaemon.protocol.framing import Frame, FrameDecoder
from mkdaemon.telemetry.control import Phase

BACK: Final = 3.0
"""Telemetry flows again so long after the device is back [s]."""
LIMITS: Final[dict[str, float | str]] = {"first": "release", "back": BACK, "obeyed": 1.1, "steered": 0, "is_held": 0}
"""Of one interruption; see `pull_cable`."""
WATCH: Final = 1.0
"""How long the boards are watched after that [s]."""


class Cut(StrEnum):
    """What happens to the line."""

    UNPLUGGED = "unplugged"
    """The device vanishes while it is read."""
    WHILE_WRITING = "while_writing"
    """The device vanishes while it is written."""
    REBOOT = "reboot"
    """The boards are reset: boot text, silence, everything forgotten but the first frame received meanwhile."""


QUESTIONS: Final = frozenset("voq")
"""What a port that came back is asked before anything else: version, position, parameter set."""


def first_words(written: bytes) -> str:
    """What bytes begin with: `release` for external control whose every bit is off, else the command letter."""
    for item in FrameDecoder().feed(written):
        if not isinstance(item, Frame):
            return "no frame"
        message = MessageDecoder().decode(item)
        if item.id != "b":
            return item.id
        return "release" if not any(item.payload[:4]) and getattr(message, "config", 0) == 0 else "sticks"
    return "nothing"


def last_words(written: bytes) -> str:
    """What bytes end with, as `first_words` says it."""
    frames = [item for item in FrameDecoder().feed(written) if isinstance(item, Frame)]
    return first_words(frames[-1].raw) if frames else "nothing"


def steering(written: bytes) -> int:
    """External control frames among these bytes that are no release."""
    frames = [item for item in FrameDecoder().feed(written) if isinstance(item, Frame) and item.id == "b"]
    return sum(first_words(frame.raw) != "release" for frame in frames)


@in_virtual_time
async def pull_cable(boards: Boards, seed: int, *, cycles: int, tick: float = TICK_TIME) -> list[Row]:
    """Interrupt one session again and again, in every way that its boards know.

    Args:
        tick: bytes are carried so often [s].

    Returns:
        Of each `cut`; `back`, streamed telemetry after the device came back [s], None where it did not; `first`, what
        was written first after the questions who is there; `steered`, stick frames with a control bit, from the opening
        to the end, although nobody took a lease since; `is_held`, whether the FlightCtrl still held a command at the
        end; `obeyed`, for how long it followed an old tilt after its reboot [s].
    """
    cuts = tuple(Cut) if boards.nc is None else (Cut.UNPLUGGED, Cut.WHILE_WRITING)
    found = []
    async with cockpit(boards, seed, tick=tick) as flown:
        for number in range(cycles):
            rng = random.Random(f"{seed} cable {number}")
            cut = cuts[number % len(cuts)]
            async with running(Streamer(flown, f"client{number}").fly()):
                await flown.until(lambda: flown.aircraft.is_controlled)
                await asyncio.sleep(rng.uniform(0.1, 0.6))
                found.append(await _interrupt(flown, cut, rng))
            await flown.until(lambda: flown.may_fly and flown.flight.phase is Phase.FREE)
    return found


async def _interrupt(flown: Cockpit, cut: Cut, rng: random.Random) -> Row:
    """Cut the line, restore it, and watch."""
    socket, port = flown.socket, flown.socket.port
    assert port is not None
    loop = asyncio.get_running_loop()
    written = len(socket.wire)
    if cut is Cut.REBOOT:
        port.inject(LineFault.REBOOT)
        await flown.until(lambda: port.fault is LineFault.NONE)
    else:
        port.inject(LineFault.UNPLUGGED if cut is Cut.UNPLUGGED else LineFault.GONE_DURING_WRITE)
        await flown.until(lambda: not socket.is_present)
        await asyncio.sleep(rng.uniform(0.02, 2.0))
        written = len(socket.wire)
        socket.is_present = True
    returned, restarted = loop.time(), flown.aircraft.now
    back = await flown.until(lambda: flown.sink.streamed_at > returned, step=0.002)
    await asyncio.sleep(WATCH)
    begun = returned - 0.5 if cut is Cut.REBOOT else returned
    steering = [frame for frame in flown.sink.tx if frame.purpose is Purpose.SETPOINT and frame.at >= begun]
    first = "release"
    if cut is not Cut.REBOOT:  # there the port stays open, and nothing begins
        words = [first_words(data) for _, data in socket.wire[written:]]
        first = next((word for word in words if word not in QUESTIONS), "nothing")
    flown.sink.tx.clear()
    obeyed = _tilted_time(flown.aircraft.applied, restarted, flown.aircraft.now) if cut is Cut.REBOOT else 0.0
    more = {"steered": len(steering), "is_held": flown.aircraft.is_controlled, "obeyed": obeyed}
    return judged(LIMITS, cut=cut, back=back, first=first, **more)


def _tilted_time(applied: Sequence[Held], begin: float, end: float) -> float:
    """How long a tilt was applied between two times [s]."""
    times = [*(max(begin, change.at) for change in applied), end]
    spans = zip(applied, itertools.pairwise(times), strict=True)
    return sum(after - at for change, (at, after) in spans if not change.is_neutral and after > at)
