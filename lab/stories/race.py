"""Two clients race for the lease over Zenoh sessions of their own: no frame of the old epoch on the wire.

Each streams without a pause, whoever holds the lease; one tilts forward, the other back, so that every stick frame on
the wire tells whose it is. Every transmission is seen with its number, so that none can have slipped by.
"""

from __future__ import annotations

import asyncio
import random
import time
from typing import Final, NamedTuple

from lab.campaign import Row
from lab.cases import judged
from lab.rigs.flown import flown, observed
from lab.rigs.pilot import Pilot
from lab.rigs.processes import connected
from lab.rigs.waiting import following
from mkdaemon.client import Sample
from mkdaemon.protocol.framing import Frame, FrameDecoder
from mkdaemon.protocol.messages import ExternControlV2

TILT: Final = 30.0
ENGAGE: Final = 1.3
"""Neutral for so long after taking the lease [s]; the daemon wants 1.0."""
SIDES: Final = {"forward": 1, "back": -1}


class Grant(NamedTuple):
    """One lease.

    Attributes:
        asked: when it was asked for [s].
        granted: when the answer came [s].
    """

    asked: float
    granted: float
    name: str


class _Observer:
    """Keeps the stick frames and epochs that the daemon shows."""

    def __init__(self) -> None:
        self.sticks: list[tuple[float, int]] = []
        self.epochs: list[int] = []
        self.numbers: list[int] = []

    def take(self, sample: Sample) -> None:
        """Keep what it shows."""
        if sample.suffix == "control/output":
            self.epochs.append(sample.fields["epoch"])
            return
        self.numbers.append(sample.fields["sequence"])
        for item in FrameDecoder().feed(sample.fields["raw"]):
            if isinstance(item, Frame) and item.id == "b" and sample.fields["purpose"] == "setpoint":
                self.sticks.append((sample.fields["stamp"]["monotonic"], ExternControlV2.decode(item.payload).pitch))


async def race(seconds: float, seed: int) -> Row:
    """Let two clients take the lease from each other for so long [s].

    Returns:
        `takes`, leases granted; `refused`, because the other held one; `frames`, stick frames on the wire; `tilted`, of
        those with somebody's tilt; `foreign`, tilted ones of somebody who did not hold the lease; `backwards`, outputs
        whose epoch is older than one before; `unseen`, transmissions that did not reach the observer; `is_empty`,
        nothing was raced for.
    """
    observer = _Observer()
    grants: list[Grant] = []
    async with (
        flown(observed(seed)) as raced,
        connected(raced.daemon.endpoint) as one,
        connected(raced.daemon.endpoint) as other,
        following(raced.client, observer.take, "raw/tx", "control/output"),
    ):
        refusals = await asyncio.gather(
            *(
                _contend(Pilot(client, name), seconds, random.Random(f"{seed} {name}"), grants)
                for client, name in zip((one, other), SIDES, strict=True)
            )
        )
        await asyncio.sleep(0.5)
    tilted = [(at, 1 if pitch > 0 else -1) for at, pitch in observer.sticks if pitch]
    return judged(
        {"foreign": 0, "backwards": 0, "unseen": 0, "is_empty": False},
        takes=len(grants),
        refused=sum(refusals),
        frames=len(observer.sticks),
        tilted=len(tilted),
        foreign=sum(not may_steer(grants, at, side) for at, side in tilted),
        backwards=sum(after < before for before, after in zip(observer.epochs, observer.epochs[1:], strict=False)),
        is_empty=len(grants) < 2 or not tilted,
        unseen=observer.numbers[-1] - observer.numbers[0] + 1 - len(observer.numbers),
    )


async def _contend(pilot: Pilot, seconds: float, rng: random.Random, grants: list[Grant]) -> int:
    """Take the lease again and again, half of the time by force; returns how often it was refused."""
    refused = 0
    ends = time.monotonic() + seconds
    async with pilot:
        while time.monotonic() < ends:
            await asyncio.sleep(rng.uniform(0.0, 2.0))
            asked = time.monotonic()
            if not await pilot.take(force=rng.random() < 0.5):
                refused += 1
                continue
            grants.append(Grant(asked, time.monotonic(), pilot.name))
            pilot.sticks["pitch"] = 0.0
            await asyncio.sleep(ENGAGE)
            # From here on the tilt is streamed whether the lease is still held or not.
            pilot.sticks["pitch"] = SIDES[pilot.name] * TILT
    return refused


def may_steer(grants: list[Grant], at: float, side: int) -> bool:
    """Whether the client of this side held the lease at a time, or may just have got it."""
    settled = [grant for grant in grants if grant.granted <= at]
    holder = max(settled, key=lambda grant: grant.granted, default=None)
    mine = next(name for name, sign in SIDES.items() if sign == side)
    asking = any(grant.name == mine and grant.asked <= at < grant.granted for grant in grants)
    return asking or (holder is not None and holder.name == mine)
