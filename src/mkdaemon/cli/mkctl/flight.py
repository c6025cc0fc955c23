"""`mkctl goto`, `hold`, `velocity`, `land`: fly against a target in sight, from the command line."""

from __future__ import annotations

import asyncio
import math
import sys
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager, suppress
from typing import Annotated, Final, Literal

from cyclopts import Parameter

from mkdaemon.cli.arguments import require_length
from mkdaemon.cli.mkctl.connection import HERE, Connection
from mkdaemon.cli.printing import json_line
from mkdaemon.client import Lease, Vehicle
from mkdaemon.errors import ConfigError, MkError

PROGRESS_PERIOD: Final = 0.2
"""Between two lines of progress on a terminal [s]."""
LOG_PERIOD: Final = 1.0
"""The same where nobody looks, and with `--json` [s]."""
BRIEF: Final = 0.2
"""Time flown to learn where the aircraft is [s]."""

Position = tuple[float, float, float]
Force = Annotated[bool, Parameter(negative=(), help="Take the lease from whoever holds it.")]
Seconds = Annotated[float, Parameter(name=["--seconds", "-s"], help="How long from the engagement on.")]


async def goto(
    x: float,
    y: float,
    z: float,
    /,
    *,
    yaw: Annotated[float | None, Parameter(help="Heading, counter-clockwise from x [deg]; else it is kept.")] = None,
    seconds: Seconds = 10.0,
    within: Annotated[float, Parameter(help="Exit code 0 only if it is so close at the end [m].")] = 0.3,
    force: Force = False,
    connection: Connection = HERE,
) -> int:
    """Fly to a place over the target in sight, hold it, then release.

    The frame is the target's: x to the right of its print, y to its top, z up. Ctrl-C releases at once. The pilot
    must have handed over: docs/flying.md.

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
    heading = None if yaw is None else math.remainder(math.radians(yaw), math.tau)
    goal = (x, y, z)
    async with connection.open() as uav, uav.lease(force=force) as lease:
        async with _showing(uav, lease, connection, lambda: goal) as shown:
            await lease.position(*goal, yaw=heading, seconds=seconds)
        return _conclude(shown, goal, within, connection)


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
    async with connection.open() as uav, uav.lease(force=force) as lease:
        async with _showing(uav, lease, connection, lambda: goal) as shown:
            await lease.velocity(0.0, 0.0, 0.0, seconds=BRIEF)
            x, y, z = shown.position or await _position(uav)
            goal = (x, y, z if height is None else height)
            await lease.position(*goal, seconds=seconds)
        return _conclude(shown, goal, within, connection)


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
    async with connection.open() as uav, uav.lease(force=force) as lease:
        async with _showing(uav, lease, connection, lambda: None) as shown:
            await lease.velocity(x, y, z, frame=frame, seconds=seconds)
        _print_end({"position": shown.position}, f"now at {_metres(shown.position)}", connection)


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
    async with connection.open() as uav, uav.lease(force=force) as lease:
        async with _showing(uav, lease, connection, lambda: (0.0, 0.0, 0.0)) as shown:
            await lease.land(yaw=heading)
        _print_end({"position": shown.position}, f"{lease.reason}; the pilot stops the motors", connection)


def require_finite(**numbers: float | None) -> None:
    """Refuse numbers that are none.

    Raises:
        ConfigError: names the first.
    """
    for name, number in numbers.items():
        if number is not None and not math.isfinite(number):
            msg = f"{name} {number:g}: give a number"
            raise ConfigError(msg)


class _Shown:
    """What has been seen of the flight.

    Attributes:
        position: the newest estimate of where the aircraft is [m].
    """

    def __init__(self) -> None:
        self.position: Position | None = None


@asynccontextmanager
async def _showing(
    uav: Vehicle, lease: Lease, connection: Connection, goal: Callable[[], Position | None]
) -> AsyncIterator[_Shown]:
    """Show on standard error what the daemon waits for, then where the aircraft is."""
    shown = _Shown()
    is_terminal = sys.stderr.isatty() and not connection.json

    async def follow() -> None:
        async with uav.watch("control/estimate") as samples:
            async for sample in samples:
                x, y, z = sample.value.position
                shown.position = (x, y, z)

    async def show() -> None:
        last = ""
        while True:
            line = _line(lease, shown.position, goal())
            if is_terminal:
                print(f"\r{line}\x1b[K", end="", file=sys.stderr, flush=True)
            elif line != last:
                print(line, file=sys.stderr, flush=True)
            last = line
            await asyncio.sleep(PROGRESS_PERIOD if is_terminal else LOG_PERIOD)

    tasks = [asyncio.create_task(job(), name=f"flight {job.__name__}") for job in (follow, show)]
    try:
        yield shown
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
        if is_terminal:
            print(file=sys.stderr)


def _line(lease: Lease, position: Position | None, goal: Position | None) -> str:
    if not lease.is_engaged or position is None:
        return lease.reason
    if goal is None:
        return f"at {_metres(position)}"
    return f"at {_metres(position)}, {100 * math.dist(position, goal):.0f} cm from the goal"


def _metres(position: Position | None) -> str:
    return "an unknown place" if position is None else "x {:+.2f} y {:+.2f} z {:.2f} m".format(*position)


async def _position(uav: Vehicle) -> Position:
    with suppress(AttributeError):
        sample = await uav.get("control/estimate")
        x, y, z = sample.value.position  # type: ignore[union-attr]
        return (x, y, z)
    msg = "the daemon publishes no estimate: see `mkctl get control/status`"
    raise MkError(msg)


def _conclude(shown: _Shown, goal: Position, within: float, connection: Connection) -> int:
    """Print how far from the goal the flight ended; the exit code."""
    if shown.position is None:
        _print_end({"position": None, "error": None}, "no estimate was received", connection)
        return 1
    error = math.dist(shown.position, goal)
    words = f"ended at {_metres(shown.position)}, {100 * error:.0f} cm from the goal"
    _print_end({"position": shown.position, "error": error}, words, connection)
    return 0 if error <= within else 1


def _print_end(fields: dict[str, object], words: str, connection: Connection) -> None:
    print(json_line(fields) if connection.json else words)
