"""A client dies while it flies: how long until the sticks are neutral and the aircraft is released.

Every death is measured from the last setpoint the daemon could use: on the wire (last character of the frame out) and
in the simulated FlightCtrl. A second client polls labels all the while, which keeps old sticks alive on old boards.
"""

from __future__ import annotations

import asyncio
import math
import random
from collections.abc import Awaitable, Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Final

from lab.rigs.boardport import TICK_TIME
from lab.rigs.cockpit import Boards, Cockpit, Held, cockpit
from lab.rigs.waiting import running
from mkdaemon.bus.codec import encode_map
from mkdaemon.errors import CommandRejectedError, LinkError
from mkdaemon.link.link import Link
from mkdaemon.link.session.traffic import Purpose, ReleaseResult, Sent
from mkdaemon.protocol.messages import LabelRequest
from mkdaemon.telemetry.control import Phase, ReleaseOutcome
from mkdaemon.virtualtime import run_virtually
from mksim.boards.line import HOST_CHAR

STICK_HZ: Final = 50.0
NEUTRAL_TIME: Final = 0.350
"""Neutral sticks on the wire this long after the last setpoint [s]."""
RELEASE_TIME: Final = 1.1
"""Config cleared in the FlightCtrl this long after the last setpoint [s]."""
WATCH: Final = 2.5
"""How long each death is watched [s]."""
TOKEN_LEASE: Final = 2.0
"""After this the bus takes a frozen client for gone [s]; `BusConfig.lease`."""
SESSION: Final = 20
"""Deaths a session, the last of a campaign may have fewer."""


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


@dataclass(frozen=True, slots=True)
class Loss:
    """One death, measured from the last usable setpoint.

    Attributes:
        seed: of the session.
        number: within the session.
        death: how.
        wire: neutral frame on the wire [s]; None where none came.
        neutral: neutral in the FlightCtrl [s]; None where it never was.
        applied: neutral at the motors' mixer [s].
        released: Config cleared in the FlightCtrl [s]; None where it still held a command at the end.
        relapses: stick frames, or commands in the FlightCtrl, that moved something after they had to be neutral.
    """

    seed: int
    number: int
    death: Death
    wire: float | None
    neutral: float | None
    applied: float | None
    released: float | None
    relapses: int

    @property
    def is_wrong(self) -> bool:
        """Whether it breaks a limit that holds for every single death."""
        is_late = self.wire is None or self.wire > NEUTRAL_TIME or self.released is None
        return is_late or self.relapses > 0 or (self.released or 0.0) > RELEASE_TIME


class SilentRelease(Link):
    """A link that takes "stop sending" for a release: no release frames, and polling goes on."""

    async def release(self, reason: str) -> ReleaseResult:
        """Claim to have let go."""
        return ReleaseResult(ReleaseOutcome.NOT_SENT, 0, 0, reason)


class _Client:
    """Flies by streamed setpoints, then dies."""

    def __init__(self, flown: Cockpit, rng: random.Random, name: str) -> None:
        self.name = name
        self.last_usable = math.nan
        self._flown = flown
        self._rng = rng
        self._epoch = 0
        self._secret = ""
        self._sequence = 0
        self._sticks = {"pitch": 0.0, "roll": 0.0, "yaw": 0.0, "throttle": 0.0}
        self._raw = b""

    async def fly(self) -> None:
        """Take the lease, engage with neutral sticks, fly at random."""
        rng, flown = self._rng, self._flown
        self._epoch = await flown.take(self.name)
        self._secret = flown.secret
        loop = asyncio.get_running_loop()
        ends = None
        await asyncio.sleep(rng.uniform(0, 0.02))
        while ends is None or loop.time() < ends:
            self._stream(self._packed())
            if flown.flight.phase is Phase.FLYING and self._is_seen():
                ends = ends or loop.time() + rng.uniform(0.2, 1.5)
                self._sticks = {axis: self._draw(axis) for axis in self._sticks}
            await asyncio.sleep(self._pause())
        self._sticks = {axis: self._draw(axis) for axis in self._sticks}
        self._stream(self._packed())
        await asyncio.sleep(rng.uniform(0, 1 / STICK_HZ))

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

    def _packed(self, **strange: float) -> bytes:
        self._sequence += 1
        return encode_map({**self._sticks, "epoch": self._epoch, "sequence": self._sequence, "ttl": 0.3, **strange})

    def _stream(self, raw: bytes, *, usable: bool = True) -> None:
        now = asyncio.get_running_loop().time()
        if usable:
            self._raw, self.last_usable = raw, now
        self._flown.stream(raw, secret=self._secret)

    async def die(self, death: Death, watched: float) -> None:
        """End in this way, and stay so for the time it is watched [s]."""
        rng, flown = self._rng, self._flown
        loop = asyncio.get_running_loop()
        ends = loop.time() + watched
        if death in {Death.KILLED, Death.FROZEN}:
            await asyncio.sleep(TOKEN_LEASE if death is Death.FROZEN else rng.uniform(0.001, 0.030))
            flown.flight.client_changed(self.name, is_here=False)
        elif death is Death.MID_FRAME:
            raw = self._packed()
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
            axis = rng.choice(list(self._sticks))
            return self._packed(**{axis: rng.choice((math.nan, math.inf, -math.inf, 1e9, -128.0))})
        if death is Death.OLD_EPOCH:
            return self._packed(epoch=self._epoch - rng.randrange(1, 4))
        if death is Death.GARBAGE:
            return rng.randbytes(rng.randrange(1, 80))
        return self._packed() if death is Death.TOKEN else self._raw


def fly_session(
    boards: Boards,
    seed: int,
    deaths: int = SESSION,
    *,
    link_class: type[Link] = Link,
    watched: float = WATCH,
    ways: tuple[Death, ...] = tuple(Death),
    tick: float = TICK_TIME,
) -> list[Loss]:
    """Discover the boards once, then lose one client after another; bytes are carried every `tick` [s]."""
    return run_virtually(_fly_session(boards, seed, deaths, link_class, watched, ways, tick))


async def _fly_session(
    boards: Boards,
    seed: int,
    deaths: int,
    link_class: type[Link],
    watched: float,
    ways: tuple[Death, ...],
    tick: float,
) -> list[Loss]:
    losses = []
    async with (
        cockpit(boards, seed, link_class=link_class, tick=tick) as flown,
        running(_poll(flown, random.Random(f"{seed} poll"))),
    ):
        for number in range(deaths):
            rng = random.Random(f"{seed} {number}")
            death = ways[(seed * SESSION + number) % len(ways)]
            client = _Client(flown, rng, f"client{number}")
            await _take_turn(flown, client.fly)
            await client.die(death, watched)
            losses.append(replace(measure_loss(flown, client.last_usable), seed=seed, number=number, death=death))
            flown.sink.tx.clear()
            flown.aircraft.held.clear()
            flown.aircraft.applied.clear()
    return losses


async def _take_turn(flown: Cockpit, fly: Callable[[], Awaitable[None]]) -> None:
    """Begin as soon as the one before has been let go of."""
    while True:
        with suppress(CommandRejectedError):
            await fly()
            return
        await asyncio.sleep(0.05)


async def _poll(flown: Cockpit, rng: random.Random) -> None:
    """Another client that only looks: on old FlightCtrls each of its requests keeps the last sticks alive."""
    board = flown.link.direct_board
    while True:
        with suppress(LinkError, CommandRejectedError):
            await flown.link.request(LabelRequest(index=rng.randrange(32)), board=board, retries=0)
        await asyncio.sleep(rng.uniform(0.02, 0.3))


def measure_loss(flown: Cockpit, since: float) -> Loss:
    """What happened since the last usable setpoint [s]."""
    sticks = [frame for frame in flown.sink.tx if frame.purpose in {Purpose.SETPOINT, Purpose.RELEASE}]
    moving = max((n for n, frame in enumerate(sticks) if not _is_neutral(frame)), default=-1)
    level = next((frame for frame in sticks[moving + 1 :]), None)
    wire = None if level is None else level.at + len(level.raw) * HOST_CHAR - since
    held, applied = flown.aircraft.held, flown.aircraft.applied
    neutral, released = _settled(held, lambda one: one.is_neutral), _settled(held, lambda one: not one.is_valid)
    mixed = _settled(applied, lambda one: one.is_neutral)
    begun = next((n for n, frame in enumerate(sticks) if frame.at > since and not _config(frame)), len(sticks))
    return Loss(
        seed=0,
        number=0,
        death=Death.KILLED,
        wire=wire,
        neutral=None if neutral is None else neutral - since,
        applied=None if mixed is None else mixed - since,
        released=None if released is None else released - since,
        relapses=sum(_config(frame) != 0 for frame in sticks[begun:]),
    )


def _is_neutral(frame: Sent) -> bool:
    message = frame.message
    tilt = (getattr(message, axis) for axis in ("pitch", "roll", "yaw"))
    return not _config(frame) or not any(tilt)


def _config(frame: Sent) -> int:
    return int(getattr(frame.message, "config", 0))


def _settled(states: list[Held], claim: Callable[[Held], bool]) -> float | None:
    """When a claim began to hold for the rest of the time; None where it does not hold at the end."""
    since = None
    for state in states:
        if not claim(state):
            since = None
        elif since is None:
            since = state.at
    return since
