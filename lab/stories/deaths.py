"""A client dies while it flies: how long until the sticks are neutral and the aircraft is released.

Every death is measured from the last setpoint the daemon could use: on the wire (last character of the frame out) and
in the simulated FlightCtrl. A second client polls labels all the while, which keeps old sticks alive on old boards.
"""

from __future__ import annotations

import asyncio
import math
import random
from collections.abc import Callable
from contextlib import suppress
from enum import StrEnum
from typing import Final

from lab.campaign import Row
from lab.cases import judged
from lab.rigs.boardport import TICK_TIME
from lab.rigs.cockpit import Boards, Cockpit, Held, cockpit
from lab.rigs.virtualguard import VirtualGuard
from lab.rigs.waiting import in_virtual_time, running
from lab.stories.standstills import Streamer
from mkdaemon.errors import CommandRejectedError, LinkError
from mkdaemon.link.link import Link
from mkdaemon.link.session.traffic import Purpose, Sent
from mkdaemon.protocol.messages import LabelRequest
from mkdaemon.telemetry.control import Phase
from mksim.boards.line import HOST_CHAR

NEUTRAL_TIME: Final = 0.350
"""Neutral sticks on the wire this long after the last setpoint [s]."""
RELEASE_TIME: Final = 1.1
"""Config cleared in the FlightCtrl this long after the last setpoint [s]."""
LIMITS: Final = {"wire": NEUTRAL_TIME, "released": RELEASE_TIME, "relapses": 0}
"""Of every single death; see `measure_loss`."""
WATCH: Final = 2.5
"""How long each death is watched [s]."""
SESSION: Final = 20
"""Deaths a session, the last of a campaign may have fewer."""


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


@in_virtual_time
async def fly_session(
    boards: Boards,
    seed: int,
    deaths: int = SESSION,
    *,
    link_class: type[Link] = Link,
    watched: float = WATCH,
    ways: tuple[Death, ...] = tuple(Death),
    tick: float = TICK_TIME,
) -> list[Row]:
    """Discover the boards once, then lose one client after another; bytes are carried every `tick` [s].

    Returns:
        Of each its `death`, what `measure_loss` finds, and `guard_wrote`, how often the guard has written anything.
    """
    losses, guard = [], VirtualGuard()
    async with (
        cockpit(boards, seed, link_class=link_class, tick=tick, guard=guard) as flown,
        running(_poll(flown, random.Random(f"{seed} poll"))),
    ):
        for number in range(deaths):
            rng = random.Random(f"{seed} {number}")
            death = ways[(seed * SESSION + number) % len(ways)]
            client = DyingClient(flown, rng, f"client{number}")
            await _take_turn(client, death, watched)
            loss = measure_loss(flown, client.last_usable)
            limits = LIMITS | {"guard_wrote": 0}  # the daemon lives, and does all of it
            losses.append(judged(limits, **loss | {"death": death, "guard_wrote": len(guard.written)}))
            flown.forget()
        guard.stop()
    return losses


async def _take_turn(client: DyingClient, death: Death, watched: float) -> None:
    """Begin as soon as the one before has been let go of."""
    while True:
        with suppress(CommandRejectedError):
            await client.fly_and_die(death, watched)
            return
        await asyncio.sleep(0.05)


async def _poll(flown: Cockpit, rng: random.Random) -> None:
    """Another client that only looks: on old FlightCtrls each of its requests keeps the last sticks alive."""
    board = flown.link.direct_board
    while True:
        with suppress(LinkError, CommandRejectedError):
            await flown.link.request(LabelRequest(index=rng.randrange(32)), board=board, retries=0)
        await asyncio.sleep(rng.uniform(0.02, 0.3))


def measure_loss(flown: Cockpit, since: float) -> Row:
    """What happened since the last usable setpoint, at `since` [s].

    Returns:
        Times from then on, None for never: `wire`, neutral frame on the wire [s]; `neutral`, in the FlightCtrl [s];
        `applied`, at the motors' mixer [s]; `released`, Config cleared in the FlightCtrl [s]. `relapses`: stick frames
        that moved something after the release had begun.
    """
    sticks = [frame for frame in flown.sink.tx if frame.purpose in {Purpose.SETPOINT, Purpose.RELEASE}]
    moving = max((n for n, frame in enumerate(sticks) if not _is_neutral(frame)), default=-1)
    level = next((frame for frame in sticks[moving + 1 :]), None)
    wire = None if level is None else level.at + len(level.raw) * HOST_CHAR - since
    held, applied = flown.aircraft.held, flown.aircraft.applied
    ends = {
        "neutral": settled(held, lambda one: one.is_neutral),
        "applied": settled(applied, lambda one: one.is_neutral),
        "released": settled(held, lambda one: not one.is_valid),
    }
    times = {name: None if at is None else at - since for name, at in ends.items()}
    begun = next((n for n, frame in enumerate(sticks) if frame.at > since and not _config(frame)), len(sticks))
    return judged(LIMITS, wire=wire, **times, relapses=sum(_config(frame) != 0 for frame in sticks[begun:]))


def _is_neutral(frame: Sent) -> bool:
    message = frame.message
    tilt = (getattr(message, axis) for axis in ("pitch", "roll", "yaw"))
    return not _config(frame) or not any(tilt)


def _config(frame: Sent) -> int:
    return int(getattr(frame.message, "config", 0))


def settled(states: list[Held], claim: Callable[[Held], bool]) -> float | None:
    """When a claim began to hold for the rest of the time; None where it does not hold at the end."""
    since = None
    for state in states:
        if not claim(state):
            since = None
        elif since is None:
            since = state.at
    return since
