"""`mkctl stick`: fly by sticks from the command line, for bench checks."""

from __future__ import annotations

import asyncio
from typing import Annotated, Any

import msgpack
from cyclopts import Parameter

from mkdaemon.cli.lease import own_name
from mkdaemon.cli.printing import json_line
from mkdaemon.cli.session import HERE, Client, Connection

NEUTRAL_LEAD = 1.3
"""Neutral sticks streamed before the daemon engages [s]; it wants a live stream of 1 s."""
TTL = 0.3
"""Time each setpoint holds [s]."""


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
) -> None:
    """Take the lease, stream neutral sticks until the daemon engages, then these for some seconds, then release.

    Counts as on the receiver, full deflection about 125; every frame passes the limiter. Ctrl-C releases at once.

    Parameters
    ----------
    pitch
        Nose down positive.
    roll
        Right side down positive.
    yaw
        Nose left positive.
    throttle
        From the centre, more lift positive; stock firmware takes the smaller of this and the pilot's.
    seconds
        How long after the neutral lead.
    rate
        Setpoints a second.
    force
        Take the lease from whoever holds it.
    """
    name = own_name()
    wanted = {"pitch": pitch, "roll": roll, "yaw": yaw, "throttle": throttle}
    neutral = {"pitch": 0.0, "roll": 0.0, "yaw": 0.0, "throttle": throttle}
    async with Client.open(connection) as client, client.token(name):
        take = {"action": "take", "holder": name, "force": force}
        lease = (await client.command("do", "lease", take)).require()
        epoch = lease["epoch"]
        try:
            sent = await _stream(client, epoch, neutral, NEUTRAL_LEAD, rate, first=1)
            sent = await _stream(client, epoch, wanted, seconds, rate, first=sent)
            outputs = (await client.get("control/output")).get("control/output")
        finally:
            await asyncio.shield(client.command("do", "lease", {"action": "release", "epoch": epoch}))
    reached = {} if outputs is None else {key: outputs.fields[key] for key in (*wanted, "epoch", "limited")}
    report: dict[str, Any] = {"epoch": epoch, "setpoints": sent - 1, "last_output": reached}
    if connection.json:
        print(json_line(report))
    elif reached.get("epoch") == epoch:
        sticks = ", ".join(f"{key} {reached[key]}" for key in wanted)
        print(f"{sent - 1} setpoints; last stick frame: {sticks}{' (limited)' if reached['limited'] else ''}")
    else:
        print(f"{sent - 1} setpoints, but the daemon never engaged: see `mkctl get control/status event/command`")


async def _stream(
    client: Client, epoch: int, sticks: dict[str, float], seconds: float, rate: float, *, first: int
) -> int:
    """Publish setpoints at a steady rate; returns the next sequence number."""
    publisher = client.stream("setpoint/stick")
    loop = asyncio.get_running_loop()
    start, sequence = loop.time(), first
    while (due := start + (sequence - first) / rate) < start + seconds:
        await asyncio.sleep(max(due - loop.time(), 0.0))
        publisher.put(msgpack.packb({**sticks, "epoch": epoch, "sequence": sequence, "ttl": TTL}))
        sequence += 1
    return sequence
