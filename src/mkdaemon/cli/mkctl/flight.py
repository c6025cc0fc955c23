"""`mkctl goto`, `hold`, `velocity`, `land`: fly against a target in sight, or to a place at home by the NaviCtrl."""

from __future__ import annotations

import math
from typing import Annotated, Final, Literal

from cyclopts import Parameter

from mkdaemon.cli.arguments import require_length
from mkdaemon.cli.mkctl.connection import HERE, Connection
from mkdaemon.cli.mkctl.flightshow import (
    Position,
    conclude,
    leased,
    metres,
    print_end,
    read_position,
    require_finite,
    showing,
)
from mkdaemon.cli.mkctl.navi import PATIENCE, fly_to

LONGEST_STAY: Final = 255
"""How long the NaviCtrl stays at a place at home [s]; its points take no more."""
BRIEF: Final = 0.2
"""Time flown to learn where the aircraft is [s]."""

Force = Annotated[bool, Parameter(negative=(), help="Take the lease from whoever holds it.")]
Seconds = Annotated[float, Parameter(name=["--seconds", "-s"], help="How long from the engagement on.")]


async def goto(
    x: float,
    y: float,
    z: float,
    /,
    *,
    yaw: Annotated[float | None, Parameter(help="Heading, counter-clockwise from x [deg]; else it is kept.")] = None,
    frame: Annotated[Literal["pad", "body", "home"], Parameter(help="Where x, y and z count from.")] = "pad",
    seconds: Seconds = 10.0,
    within: Annotated[float, Parameter(help="Exit code 0 only if it is so close at the end [m].")] = 0.3,
    force: Force = False,
    confirm: Annotated[bool, Parameter(negative=(), help="With frame home: see `mkctl navi goto --help`.")] = False,
    connection: Connection = HERE,
) -> int:
    """Fly to a place over the target in sight, hold it, then release.

    In frame `pad`: x to the right of its print, y to its top, z up. In frame `body`: forward, left and up from where
    the aircraft is; yaw from its heading. Ctrl-C releases at once. The pilot must have handed over: docs/flying.md.
    In frame `home`: east, north and up of home, flown by the NaviCtrl when the pilot turns the GPS switch to coming
    home: `mkctl navi goto`; takes --yaw (from east) and --confirm.

    Args:
        x: Metres from the middle of the target.
        y: Metres from the middle of the target.
        z: Metres above the target.

    Raises:
        ConfigError: a number cannot be.
        MkError: the daemon refused, did not engage, or let go on the way.
    """
    require_finite(x=x, y=y, z=z, yaw=yaw)
    require_length(seconds, "--seconds")
    require_length(within, "--within")
    if frame == "home":
        compass = None if yaw is None else round(90.0 - yaw - 1.0) % 360 + 1
        await fly_to((x, y, z), compass, LONGEST_STAY, confirm=confirm, patience=PATIENCE, connection=connection)
        return 0
    heading = None if yaw is None else math.remainder(math.radians(yaw), math.tau)
    goal = (x, y, z) if frame == "pad" else None
    async with connection.open() as uav, leased(uav, connection, force=force) as lease:
        async with showing(uav, lease, connection, lambda: goal) as shown:
            await lease.position(x, y, z, yaw=heading, frame=frame, seconds=seconds)
        return conclude(shown, goal or shown.goal, within, connection)


async def hold(
    *,
    height: Annotated[float | None, Parameter(help="Above the target [m]; else the present one.")] = None,
    seconds: Seconds = 10.0,
    within: Annotated[float, Parameter(help="Exit code 0 only if it is so close at the end [m].")] = 0.3,
    force: Force = False,
    connection: Connection = HERE,
) -> int:
    """Hold the place where the aircraft is when the daemon engages, then release.

    Raises:
        ConfigError: a number cannot be.
        MkError: the daemon refused, did not engage, or let go on the way.
    """
    require_finite(height=height)
    require_length(seconds, "--seconds")
    goal: Position | None = None
    async with connection.open() as uav, leased(uav, connection, force=force) as lease:
        async with showing(uav, lease, connection, lambda: goal) as shown:
            await lease.velocity(0.0, 0.0, 0.0, seconds=BRIEF)
            x, y, z = shown.position or await read_position(uav)
            goal = (x, y, z if height is None else height)
            await lease.position(*goal, seconds=seconds)
        return conclude(shown, goal, within, connection)


async def velocity(
    x: float,
    y: float,
    z: float,
    /,
    *,
    frame: Annotated[Literal["pad", "body"], Parameter(help="Axes of the target, or forward and left.")] = "pad",
    seconds: Seconds = 2.0,
    force: Force = False,
    connection: Connection = HERE,
) -> None:
    """Fly at a velocity against the target in sight, then release.

    Args:
        x: Metres per second along the first axis.
        y: Metres per second along the second.
        z: Metres per second up.

    Raises:
        ConfigError: a number cannot be.
        MkError: the daemon refused, did not engage, or let go on the way.
    """
    require_finite(x=x, y=y, z=z)
    require_length(seconds, "--seconds")
    async with connection.open() as uav, leased(uav, connection, force=force) as lease:
        async with showing(uav, lease, connection, lambda: None) as shown:
            await lease.velocity(x, y, z, frame=frame, seconds=seconds)
        print_end({"position": shown.position}, f"now at {metres(shown.position)}", connection)


async def land(
    *,
    yaw: Annotated[float | None, Parameter(help="Heading, counter-clockwise from x [deg]; else it is kept.")] = None,
    force: Force = False,
    connection: Connection = HERE,
) -> None:
    """Land on the target in sight; ends when the feet stand and the aircraft is released.

    The motors still turn then: the pilot stops them.

    Raises:
        ConfigError: a number cannot be.
        MkError: the daemon refused, did not engage, or let go before the feet stood.
    """
    require_finite(yaw=yaw)
    heading = None if yaw is None else math.remainder(math.radians(yaw), math.tau)
    async with connection.open() as uav, leased(uav, connection, force=force) as lease:
        async with showing(uav, lease, connection, lambda: (0.0, 0.0, 0.0)) as shown:
            await lease.land(yaw=heading)
        print_end({"position": shown.position}, f"{lease.reason}; the pilot stops the motors", connection)
