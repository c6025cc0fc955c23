"""A client that flies a cockpit by streamed setpoints, and every way in which it dies."""

from __future__ import annotations

import asyncio
import math
import random
from enum import StrEnum
from typing import Final

from lab.rigs.cockpit import Cockpit
from lab.stories.standstills import Streamer
from mkdaemon.link.session.traffic import Purpose
from mkdaemon.telemetry.control import Phase

STICK_HZ: Final = 50.0
TOKEN_LEASE: Final = 2.0
"""After this the bus takes a frozen client for gone [s]; `BusConfig.lease`."""


class Death(StrEnum):
    """How a client ends."""

    KILLED = "killed"
    """Its process dies: the stream ends, and its token vanishes within 30 ms."""
    FROZEN = "frozen"
    """Its process is stopped: the stream ends, its token stays until the bus misses it."""
    MID_FRAME = "mid_frame"
    """Its last setpoint is cut short anywhere; then it is silent."""
    STALE = "stale"
    """It sends its last setpoint again and again."""
    NOT_A_NUMBER = "not_a_number"
    """It goes on with NaN, infinity and sticks beyond every range."""
    OLD_EPOCH = "old_epoch"
    """It goes on with the epoch of an earlier lease."""
    GARBAGE = "garbage"
    """It goes on with random bytes."""
    TOKEN = "token"
    """Its token vanishes while it goes on streaming."""


class DyingClient(Streamer):
    """Flies by streamed setpoints, then dies.

    Attributes:
        last_usable: when it put the last setpoint that the daemon could use [s].
    """

    def __init__(self, flown: Cockpit, rng: random.Random, name: str) -> None:
        super().__init__(flown, name)
        self.sticks["throttle"] = 0.0
        self.last_usable = math.nan
        self._rng = rng
        self._raw = b""

    async def fly_and_die(self, death: Death, watched: float) -> None:
        """Take the lease, engage with neutral sticks, fly at random, die, and stay dead for the time it is watched [s].

        Raises:
            CommandRejectedError: the lease was refused.
        """
        rng, flown = self._rng, self._flown
        await self.take()
        loop = asyncio.get_running_loop()
        ends = None
        await asyncio.sleep(rng.uniform(0, 0.02))
        while ends is None or loop.time() < ends:
            self._stream(self.packed())
            if flown.flight.phase is Phase.FLYING and self._is_seen():
                ends = ends or loop.time() + rng.uniform(0.2, 1.5)
                self.sticks = {axis: self._draw(axis) for axis in self.sticks}
            await asyncio.sleep(self._pause())
        self.sticks = {axis: self._draw(axis) for axis in self.sticks}
        self._stream(self.packed())
        await asyncio.sleep(rng.uniform(0, 1 / STICK_HZ))
        await self._die(death, watched)

    def _is_seen(self) -> bool:
        """Whether its sticks have reached the wire."""
        return any(frame.purpose is Purpose.SETPOINT for frame in reversed(self._flown.sink.tx))

    def _draw(self, axis: str) -> float:
        if axis == "throttle":
            return self._rng.uniform(-60.0, 60.0)
        return self._rng.choice((-1, 1)) * self._rng.uniform(10.0, 60.0)

    def _pause(self) -> float:
        """Time to the next setpoint, with the jitter of a network [s]."""
        return max(0.0, 1 / STICK_HZ + self._rng.gauss(0.0, 0.002))

    def _stream(self, raw: bytes, *, usable: bool = True) -> None:
        now = asyncio.get_running_loop().time()
        if usable:
            self._raw, self.last_usable = raw, now
        self._flown.stream(raw, secret=self._secret)

    async def _die(self, death: Death, watched: float) -> None:
        rng, flown = self._rng, self._flown
        loop = asyncio.get_running_loop()
        ends = loop.time() + watched
        if death in {Death.KILLED, Death.FROZEN}:
            await asyncio.sleep(TOKEN_LEASE if death is Death.FROZEN else rng.uniform(0.001, 0.030))
            flown.flight.client_changed(self.name, is_here=False)
        elif death is Death.MID_FRAME:
            raw = self.packed()
            self._stream(raw[: rng.randrange(1, len(raw))], usable=False)
        else:
            if death is Death.TOKEN:
                self.last_usable = loop.time()
                flown.flight.client_changed(self.name, is_here=False)
            while loop.time() < ends:
                self._stream(self._strange(death), usable=False)
                await asyncio.sleep(self._pause())
        await asyncio.sleep(max(0.0, ends - loop.time()))

    def _strange(self, death: Death) -> bytes:
        """What a client in this state sends."""
        rng = self._rng
        if death is Death.NOT_A_NUMBER:
            axis = rng.choice(list(self.sticks))
            return self.packed(**{axis: rng.choice((math.nan, math.inf, -math.inf, 1e9, -128.0))})
        if death is Death.OLD_EPOCH:
            return self.packed(epoch=self._epoch - rng.randrange(1, 4))
        if death is Death.GARBAGE:
            return rng.randbytes(rng.randrange(1, 80))
        return self.packed() if death is Death.TOKEN else self._raw
