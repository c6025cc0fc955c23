"""`mkctl stick`: fly by sticks from the command line, for bench checks."""

from __future__ import annotations

from typing import Annotated

from cyclopts import Parameter

from mkdaemon.cli.arguments import require_length
from mkdaemon.cli.mkctl.connection import HERE, Connection
from mkdaemon.cli.mkctl.flightshow import leased
from mkdaemon.cli.printing import json_line
from mkdaemon.errors import ConfigError

FULL = 127
"""Full stick [count]."""
AXES = ("pitch", "roll", "yaw", "throttle")


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
    Exit code 1 when they did not fly to the end.

    Args:
        pitch: Nose down positive.
        roll: Right side down positive.
        yaw: Nose left positive.
        throttle: From the centre, more lift positive; stock firmware takes the smaller of this and the pilot's.
        seconds: How long after the neutral lead.
        rate: Setpoints a second.
        force: Take the lease from whoever holds it.

    Raises:
        ConfigError: a stick is beyond its range, or no number.
        MkError: the daemon refused the lease, did not engage, or let go on the way.
    """
    wanted = {"pitch": pitch, "roll": roll, "yaw": yaw, "throttle": throttle}
    for name, value in wanted.items():
        if not abs(value) <= FULL:
            raise ConfigError(f"--{name} {value:g}: give a number from -{FULL} to {FULL}")
    require_length(seconds, "--seconds")
    require_length(rate, "--rate")
    async with connection.open() as uav, leased(uav, connection, force=force) as lease:
        await lease.stick(**wanted, seconds=seconds, rate=rate)
        output = await uav.control.output.latest()
    sent = {name: None if output is None else getattr(output.value, name) for name in (*AXES, "limited")}
    if connection.json:
        print(json_line({"epoch": lease.epoch, "setpoints": lease.setpoints, "last_output": sent}))
    else:
        sticks = ", ".join(f"{axis} {sent[axis]}" for axis in AXES)
        print(f"{lease.setpoints} setpoints; last stick frame: {sticks}{' (limited)' if sent['limited'] else ''}")
