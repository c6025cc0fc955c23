"""A client dies while it flies: how long until the sticks are neutral and the aircraft is released.

Every death is measured from the last setpoint the daemon could use: on the wire (last character of the frame out) and
in the simulated FlightCtrl. A second client polls labels all the while, which keeps old sticks alive on old boards.
"""

from __future__ import annotations

import asyncio
import random
from collections.abc import Callable
from contextlib import suppress
from typing import Final

from lab.campaign import Row
from lab.cases import judged
from lab.rigs.boardport import TICK_TIME
from lab.rigs.cockpit import Boards, Cockpit, Held, cockpit
from lab.rigs.waiting import in_virtual_time, running
from lab.stories.dyingclient import Death, DyingClient
from mkdaemon.errors import CommandRejectedError, LinkError
from mkdaemon.link.link import Link
from mkdaemon.link.session.traffic import Purpose, ReleaseResult, Sent
from mkdaemon.protocol.messages import LabelRequest
from mkdaemon.telemetry.control import ReleaseOutcome
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


class SilentRelease(Link):
    """A link that takes "stop sending" for a release: no release frames, and polling goes on."""

    async def release(self, reason: str) -> ReleaseResult:
        """Claim to have let go."""
        return ReleaseResult(ReleaseOutcome.NOT_SENT, 0, 0, reason)


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
        Of each its `death`, and what `measure_loss` finds.
    """
    losses = []
    async with (
        cockpit(boards, seed, link_class=link_class, tick=tick) as flown,
        running(_poll(flown, random.Random(f"{seed} poll"))),
    ):
        for number in range(deaths):
            rng = random.Random(f"{seed} {number}")
            death = ways[(seed * SESSION + number) % len(ways)]
            client = DyingClient(flown, rng, f"client{number}")
            await _take_turn(client, death, watched)
            losses.append({"death": death} | measure_loss(flown, client.last_usable))
            flown.forget()
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
