"""`mkctl stick`: fly by sticks from the command line, for bench checks."""

from __future__ import annotations

import asyncio
import sys
from collections.abc import AsyncIterator
from typing import Annotated, Any

import msgpack
from cyclopts import Parameter

from mkdaemon.cli.arguments import require_length
from mkdaemon.cli.mkctl.connection import HERE, Connection
from mkdaemon.cli.mkctl.lease import own_name
from mkdaemon.cli.printing import json_line
from mkdaemon.cli.program import EXIT_FAILURE
from mkdaemon.client import Sample, Vehicle
from mkdaemon.errors import ConfigError

ENGAGING = 5.0
"""Longest time neutral sticks are streamed until the daemon engages [s]; it wants a live stream of 1 s."""
TTL = 0.3
"""Time each setpoint holds [s]."""
FULL = 127
"""Full stick [count]."""


async def stick(
    *,
    pitch: float = 0.0,
    roll: float = 0.0,
    yaw: float = 0.0,
    throttle: float,
    seconds: Annotated[float, Parameter(name=["--seconds", "-s"])] = 2.0,
    rate: float = 50.0,
    force: Annotated[bool, Parameter(negative=())] = False,
    connection: Connection = HERE,
) -> int:
    """Take the lease, stream neutral sticks until the daemon engages, then these for some seconds, then release.

    Counts as on the receiver, full deflection about 125; every frame passes the limiter. Ctrl-C releases at once.
    Exit code 1 when they did not fly to the end.

    Args:
        pitch: Nose down positive.
        roll: Right side down positive.
        yaw: Nose left positive.
        throttle: From the centre, more lift positive; stock firmware takes the smaller of this and the pilot's.
        seconds: How long after the neutral lead.
        rate: Setpoints a second.
        force: Take the lease from whoever holds it.
    """
    wanted = {"pitch": pitch, "roll": roll, "yaw": yaw, "throttle": throttle}
    _check(wanted)
    require_length(seconds, "--seconds")
    require_length(rate, "--rate")
    name = own_name()
    neutral = {"pitch": 0.0, "roll": 0.0, "yaw": 0.0, "throttle": throttle}
    async with connection.open() as client, client.token(name), client.watch("control/status") as news:
        take = {"action": "take", "holder": name, "force": force}
        epoch = (await client.command("do", "lease", take)).require()["epoch"]
        stream = _Stream(client, epoch, rate)
        try:
            flying = asyncio.create_task(_until_flying(news, epoch), name="flying")
            await stream.put(neutral, flying, ENGAGING)
            flying.cancel()
            if flying.done() and not flying.cancelled():
                await stream.put(wanted, asyncio.get_running_loop().create_future(), seconds)
            outputs = await client.get("control/output")
            held = (await client.command("do", "lease", {"action": "show"})).require()
        finally:
            await asyncio.shield(client.command("do", "lease", {"action": "release", "epoch": epoch}))
    reached = {} if outputs is None else {key: outputs.fields[key] for key in (*wanted, "epoch", "limited")}
    has_flown = reached.get("epoch") == epoch
    to_the_end = has_flown and held.get("epoch") == epoch
    report: dict[str, Any] = {"epoch": epoch, "setpoints": stream.sequence, "last_output": reached}
    if connection.json:
        print(json_line(report | {"flown_to_the_end": to_the_end}))
    elif has_flown:
        sticks = ", ".join(f"{key} {reached[key]}" for key in wanted)
        print(f"{stream.sequence} setpoints; last stick frame: {sticks}{' (limited)' if reached['limited'] else ''}")
    if not has_flown:
        print("the daemon never engaged: see `mkctl get control/status event/command`", file=sys.stderr)
    elif not to_the_end:
        print("the lease was lost on the way: see `mkctl get control/status event/failsafe`", file=sys.stderr)
    return 0 if to_the_end else EXIT_FAILURE


def _check(sticks: dict[str, float]) -> None:
    """Refuse here what the daemon would refuse fifty times a second.

    Raises:
        ConfigError: a stick is beyond its range, or no number.
    """
    for name, value in sticks.items():
        if not abs(value) <= FULL:
            raise ConfigError(f"--{name} {value:g}: give a number from -{FULL} to {FULL}")


async def _until_flying(news: AsyncIterator[Sample], epoch: int) -> None:
    """Return when stick frames of this lease are sent."""
    async for sample in news:
        lease = sample.fields["lease"]
        if sample.fields["phase"] == "flying" and lease is not None and lease["epoch"] == epoch:
            return


class _Stream:
    """Setpoints of one lease at a steady rate."""

    def __init__(self, client: Vehicle, epoch: int, rate: float) -> None:
        self.sequence = 0
        self._publisher = client.stream("setpoint/stick")
        self._epoch = epoch
        self._period = 1 / rate

    async def put(self, sticks: dict[str, float], end: asyncio.Future[None], seconds: float) -> None:
        """Stream until `end` is done or the time is over."""
        loop = asyncio.get_running_loop()
        start = due = loop.time()
        while not end.done() and due < start + seconds:
            await asyncio.sleep(max(due - loop.time(), 0.0))
            self.sequence += 1
            setpoint = {**sticks, "epoch": self._epoch, "sequence": self.sequence, "ttl": TTL}
            self._publisher.put(msgpack.packb(setpoint))
            due += self._period
