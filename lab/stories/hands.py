"""Pads, terminals and programs lost in flight: how soon the sticks are neutral, and the aircraft is released.

The pure teleop, the session, the client library, the flight core, the link and the simulated boards, in virtual time.
Times count from the loss: neutral on the wire (last character out), `Config` cleared in the simulated FlightCtrl.
"""

from __future__ import annotations

import asyncio
import random
from collections.abc import Callable
from enum import StrEnum
from typing import Final

from lab.campaign import Row
from lab.cases import judged
from lab.rigs.boardport import TICK_TIME
from lab.rigs.cockpit import Boards, Cockpit, cockpit
from lab.rigs.cockpitclient import CockpitClient
from lab.rigs.handpad import HandKeyboard, HandPad
from lab.rigs.waiting import in_virtual_time
from lab.stories.deaths import LIMITS, measure_loss
from mkdaemon.cli.mkctl.teleop.session import TeleopSession
from mkdaemon.client.leasekeeper import LeaseKeeper
from mkdaemon.link.session.traffic import Purpose
from mkdaemon.telemetry.control import Phase

HANDS: Final = 10
"""Losses between two discoveries of the boards."""
WATCH: Final = 2.5
"""How long each loss is watched [s]."""
TOKEN_LEASE: Final = 2.0
"""After this the bus takes a stopped program for gone [s]; `BusConfig.lease`."""
PATIENCE: Final = 10.0
"""Longest wait for what takes two seconds [s; virtual]."""


class Way(StrEnum):
    """How hands are lost."""

    UNPLUG = "unplug"
    """The pad is unplugged; the kernel tells, or it is found out when the pad is asked."""
    FREEZE = "freeze"
    """The pad says nothing new, or the whole program is stopped."""
    KILL = "kill"
    """The program is killed: nothing is given back, and its token is gone in 30 ms."""
    SSH = "ssh"
    """The connection to the terminal breaks without a word, keys held."""
    TWO_PADS = "two_pads"
    """The pad that flies is unplugged while a second one is held and moved."""
    STUCK = "stuck"
    """The pad is unplugged and plugged in again with its enable button pressed and its sticks moved."""


class _Operator:
    """One program with its hands on one cockpit."""

    def __init__(self, flown: Cockpit, name: str, rng: random.Random) -> None:
        self.flown, self.rng, self.name = flown, rng, name
        self.client = CockpitClient(flown, name, rng)
        self.session = TeleopSession(LeaseKeeper(self.client.lease))
        self.stop = asyncio.Event()
        self.pad = HandPad(self.session)
        self.second = HandPad(self.session, "second")
        self.keyboard = HandKeyboard(self.session)
        self.task = asyncio.create_task(self.session.run(self.stop), name="teleop")

    async def fly(self, way: Way) -> None:
        """Plug in, make ready, hold the enable button, and fly at random for a while."""
        flown, rng = self.flown, self.rng
        if way is Way.SSH:
            self.keyboard.plug_in()
            await asyncio.sleep(0.1)
            for key in "me":
                self.keyboard.type(key)
        else:
            self.pad.plug_in()
            if way is Way.TWO_PADS:
                self.second.plug_in()
            await asyncio.sleep(0.1)
            self._make_ready(self.pad)
            await asyncio.sleep(0.05)
            self.pad.move(BTN_TL=1, ABS_Y=0)
        if await flown.until(lambda: flown.flight.phase is Phase.FLYING and self._is_seen(), PATIENCE) is None:
            raise TimeoutError(f"{way}: {self.session.output.reason}; {self.session.notice}")
        await asyncio.sleep(rng.uniform(0.05, 0.5))
        if way is Way.SSH:
            await self._type(rng.uniform(0.3, 1.0))
        else:
            self._move(self.pad)
            await asyncio.sleep(rng.uniform(0.2, 1.0))
            self._move(self.pad)
            await asyncio.sleep(rng.uniform(0.03, 0.06))

    def _is_seen(self) -> bool:
        return any(frame.purpose is Purpose.SETPOINT for frame in self.flown.sink.tx)

    def _make_ready(self, pad: HandPad) -> None:
        pad.move(ABS_Y=1.0)
        pad.move(ABS_Y=0.0)

    def _move(self, pad: HandPad) -> None:
        tilts = {axis: self.rng.choice((-1, 1)) * self.rng.uniform(0.3, 1.0) for axis in ("ABS_RX", "ABS_RY", "ABS_X")}
        pad.move(**tilts, ABS_Y=self.rng.uniform(-1.0, 1.0))

    async def _type(self, seconds: float) -> None:
        """Hold an arrow, as a keyboard repeats it."""
        loop = asyncio.get_running_loop()
        ends = loop.time() + seconds
        while loop.time() < ends:
            self.keyboard.type("up")
            await asyncio.sleep(self.rng.uniform(0.025, 0.040))

    async def lose(self, way: Way) -> float:
        """Lose the hands; returns when, and goes on as these hands would for the time it is watched [s]."""
        loop = asyncio.get_running_loop()
        ends = loop.time() + WATCH
        lost_at = loop.time()
        hands: Callable[[], None] = lambda: None  # noqa: E731 - what goes on moving
        if way is Way.UNPLUG:
            self.pad.unplug(is_noticed=self.rng.random() < 0.5)
        elif way is Way.FREEZE and self.rng.random() < 0.5:
            self.pad.freeze()
        elif way in {Way.FREEZE, Way.KILL}:
            self.client.die()
            self.task.cancel()
            gone = TOKEN_LEASE if way is Way.FREEZE else self.rng.uniform(0.001, 0.03)
            loop.call_later(gone, self.flown.flight.client_changed, self.name, False)
        elif way is Way.SSH:
            self.keyboard.drop()
            hands = lambda: self.keyboard.type("up")  # noqa: E731
        elif way is Way.TWO_PADS:
            self._make_ready(self.second)
            self.second.move(BTN_TL=1)
            self.pad.unplug(is_noticed=True)
            hands = lambda: self._move(self.second)  # noqa: E731
        else:
            self.pad.unplug(is_noticed=True)
            again = HandPad(self.session)
            again.move(BTN_TL=1)
            loop.call_later(self.rng.uniform(0.05, 1.0), again.plug_in)
            hands = lambda: self._move(again)  # noqa: E731
        while loop.time() < ends:
            hands()
            await asyncio.sleep(0.02)
        return lost_at

    async def end(self) -> None:
        """End the program."""
        self.stop.set()
        await asyncio.gather(self.task, return_exceptions=True)


@in_virtual_time
async def lose_hands(boards: Boards, way: Way, losses: int, seed: int, tick: float = TICK_TIME) -> list[Row]:
    """Discover the boards once, then lose one operator after another in the same way.

    Bytes are carried every `tick` [s].

    Returns:
        Of each what `measure_loss` finds from the loss on, and `foreign`: stick frames of a second pad while the first
        flew.
    """
    found = []
    async with cockpit(boards, seed, tick=tick) as flown:
        for number in range(losses):
            rng = random.Random(f"{seed} {way} {number}")
            operator = _Operator(flown, f"operator{number}", rng)
            await operator.fly(way)
            foreign = await _fly_beside(operator) if way is Way.TWO_PADS else 0
            lost_at = await operator.lose(way)
            loss = measure_loss(flown, lost_at)
            found.append(judged(LIMITS | {"foreign": 0}, **loss | {"foreign": foreign}))
            await operator.end()
            await flown.until(lambda: flown.flight.phase is Phase.FREE, PATIENCE)
            flown.forget()
    return found


async def _fly_beside(operator: _Operator) -> int:
    """Hold the first pad still and move the second one, enable button held; returns stick frames that are not level."""
    operator.pad.move(ABS_RX=0, ABS_RY=0, ABS_X=0)
    await asyncio.sleep(0.4)
    before = len(operator.flown.sink.tx)
    operator.second.move(ABS_Y=1.0)
    operator.second.move(ABS_Y=0.0)
    operator.second.move(BTN_TL=1)
    for _ in range(25):
        operator.second.move(ABS_RX=operator.rng.uniform(-1, 1), ABS_RY=operator.rng.uniform(-1, 1))
        await asyncio.sleep(0.02)
    operator.second.move(BTN_TL=0)
    frames = [frame.message for frame in operator.flown.sink.tx[before:] if frame.purpose is Purpose.SETPOINT]
    moved = sum(any(getattr(frame, axis) for axis in ("pitch", "roll", "yaw")) for frame in frames)
    operator.pad.move(ABS_RX=0.8, ABS_RY=-0.8)
    await asyncio.sleep(0.1)
    return moved
