"""The daemon stands still while a client flies, alone, together with the client, or with the whole machine.

In virtual time: the boards go on, and what they said meanwhile arrives at once afterwards. A client that went on has
streamed all the while, and its setpoints arrive at once too.
"""

from __future__ import annotations

import asyncio
import random
from contextlib import suppress
from enum import StrEnum
from typing import Final

from lab.campaign import Row
from lab.cases import judged
from lab.rigs.boardport import TICK_TIME
from lab.rigs.cockpit import Boards, Cockpit, cockpit
from lab.rigs.waiting import in_virtual_time, running
from mkdaemon.bus.codec import encode_map
from mkdaemon.errors import CommandRejectedError
from mkdaemon.link.session.traffic import Purpose, Sent
from mkdaemon.telemetry.control import Phase
from mkdaemon.virtualtime import VirtualLoop

LIMITS: Final = {"tilted": 0, "cleared": 1.1}
"""Of one standstill; see `stand_still`."""
WATCH: Final = 2.5
"""How long the boards are watched after it [s]."""
STICK_TIME: Final = 0.02
TILT: Final = 40.0


class Stopped(StrEnum):
    """Who stands still."""

    DAEMON = "daemon"
    BOTH = "daemon and client"
    MACHINE = "machine suspended"


class Streamer:
    """A client that takes the lease once and streams sticks for ever, with a tilt once it flies.

    Attributes:
        sticks: what it streams [stick; FLU].
    """

    def __init__(self, flown: Cockpit, name: str, tilt: float = TILT) -> None:
        self.name = name
        self.sticks = {"pitch": 0.0, "roll": 0.0, "yaw": 0.0, "throttle": -10.0}
        self._flown, self._tilt = flown, tilt
        self._secret = ""
        self._epoch = self._sequence = 0

    async def take(self) -> None:
        """Take the lease.

        Raises:
            CommandRejectedError: it was refused.
        """
        self._epoch = await self._flown.take(self.name)
        self._secret = self._flown.secret

    async def fly(self) -> None:
        """Take the lease as soon as it is granted, engage, then tilt."""
        while not self._epoch:
            with suppress(CommandRejectedError):
                await self.take()
            await asyncio.sleep(STICK_TIME)
        while True:
            if self._flown.flight.phase is Phase.FLYING:
                self.sticks |= {"pitch": self._tilt, "roll": -self._tilt}
            self.put()
            await asyncio.sleep(STICK_TIME)

    def put(self, count: int = 1) -> None:
        """Stream the next setpoints, all at once."""
        for _ in range(count):
            self._flown.stream(self.packed(), secret=self._secret)

    def packed(self, **strange: float) -> bytes:
        """The next setpoint, with some fields as they should not be."""
        self._sequence += 1
        return encode_map({**self.sticks, "epoch": self._epoch, "sequence": self._sequence, "ttl": 0.3, **strange})


@in_virtual_time
async def stand_still(
    boards: Boards, who: Stopped, seconds: float, count: int, seed: int, tick: float = TICK_TIME
) -> list[Row]:
    """Stop one session again and again for so long [s]; bytes are carried every `tick` [s].

    Returns:
        Of each `tilted`, frames with the valid bit and a tilt written after it; `cleared`, when the FlightCtrl held no
        command any more, from its end [s], None where it did at the end of the watch.
    """
    found = []
    async with cockpit(boards, seed, tick=tick, rates={"osd": 200} if boards.nc else "off") as flown:
        for number in range(count):
            rng = random.Random(f"{seed} {who} {seconds} {number}")
            client = Streamer(flown, f"client{number}")
            async with running(client.fly()):
                await flown.until(lambda: flown.aircraft.is_controlled and is_tilted(flown.sink.tx[-40:]))
                await asyncio.sleep(rng.uniform(0.1, 0.5))
                found.append(await _stop(flown, client, who, seconds))
            await flown.until(lambda: flown.may_fly and flown.flight.phase is Phase.FREE)
    return found


async def _stop(flown: Cockpit, client: Streamer, who: Stopped, seconds: float) -> Row:
    loop = asyncio.get_running_loop()
    assert isinstance(loop, VirtualLoop)
    if who is Stopped.MACHINE:
        flown.socket.slept += seconds
    else:
        loop.let_pass(seconds)
    if who is Stopped.DAEMON:
        client.put(int(seconds / STICK_TIME))
    woken = flown.socket.now()
    flown.sink.tx.clear()
    await asyncio.sleep(WATCH)
    tilted = sum(is_tilted([frame]) for frame in flown.sink.tx)
    held = flown.aircraft.held
    since = max((state.at for state in held if state.is_valid), default=0.0)
    end = min((state.at for state in held if state.at > since), default=woken)
    cleared = None if flown.aircraft.is_controlled else max(0.0, end - woken)
    flown.aircraft.held.clear()
    return judged(LIMITS, tilted=tilted, cleared=cleared)


def is_tilted(frames: list[Sent]) -> bool:
    """Whether one of them steers with a tilt."""
    sticks = [frame.message for frame in frames if frame.purpose in {Purpose.SETPOINT, Purpose.RELEASE}]
    return any(
        int(getattr(message, "config", 0)) & 1 and any(getattr(message, axis) for axis in ("pitch", "roll", "yaw"))
        for message in sticks
    )
