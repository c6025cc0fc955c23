"""`mkctl fly`: a flight from a file, step by step."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated, Final

from cyclopts import Parameter

from mkdaemon.cli.mkctl.connection import HERE, Connection
from mkdaemon.cli.mkctl.flightshow import flying, metres
from mkdaemon.cli.mkctl.manoeuvres import Force
from mkdaemon.client import Lease, Vehicle
from mkdaemon.errors import ManoeuvreError
from mkdaemon.missions.script import (
    GotoStep,
    HoldStep,
    LandStep,
    PathStep,
    Step,
    TakeOffStep,
    VelocityStep,
    WaitStep,
    read_script,
)
from mkdaemon.telemetry.path import PathStored

LOOK: Final = 0.5
"""Between two looks at a value that is waited for [s]."""


async def fly(
    script: Path,
    /,
    *,
    check: Annotated[bool, Parameter(help="Only check the file.")] = False,
    force: Force = False,
    connection: Connection = HERE,
) -> None:
    """Fly the steps of a TOML file one after the other, then release.

    The whole file is checked before anything flies. A step that fails ends the flight with a release. Ctrl-C releases
    at once. The pilot's part is that of `mkctl take-off`, `goto` and `land`: docs/flying.md.

    Example: mkctl fly flight.toml --check

    Args:
        script: The file; docs/flying.md shows one.

    Raises:
        ConfigError: the file is wrong; names the step.
        MkError: a step was refused or failed; names the step.
    """
    steps = read_script(script)
    if check:
        connection.show({"steps": len(steps)}, f"{script}: {len(steps)} steps, nothing wrong")
        return
    async with flying(connection, force=force) as (uav, lease, shown):
        # All paths before anything flies: one that this aircraft cannot fly is refused on the ground.
        paths = {number: await upload(uav, step) for number, step in enumerate(steps, 1) if isinstance(step, PathStep)}
        for number, step in enumerate(steps, 1):
            if not connection.json:
                path = f": {path_words(paths[number])}" if number in paths else ""
                shown.print_line(f"step {number} of {len(steps)}: {step.do}{path}")
            await fly_step(uav, lease, step, paths.get(number))
    connection.show({"steps": len(steps), "position": shown.position}, f"done; now at {metres(shown.position)}")


async def fly_step(uav: Vehicle, lease: Lease, step: Step, path: PathStored | None = None) -> None:
    """Fly one step to its end; `path` is that of the step, if it is uploaded already.

    Raises:
        MkError: see the methods of `Lease`.
    """
    match step:
        case TakeOffStep():
            await lease.take_off(step.height, patience=step.patience)
        case HoldStep():
            await lease.hold(seconds=step.seconds)
        case GotoStep():
            yaw = None if step.yaw_deg is None else math.radians(step.yaw_deg)
            await lease.goto(*step.position, yaw=yaw, frame=step.frame, patience=step.patience)
        case VelocityStep():
            await lease.velocity(*step.velocity, frame=step.frame, seconds=step.seconds)
        case PathStep():
            await lease.follow(path or step.request, target=step.target)
        case WaitStep():
            await _wait(uav, lease, step)
        case LandStep():
            yaw = None if step.yaw_deg is None else math.radians(step.yaw_deg)
            await lease.land(yaw=yaw, patience=step.patience)


async def upload(uav: Vehicle, step: PathStep) -> PathStored:
    """Upload the path of a step.

    Raises:
        CommandRejectedError: `path_refused`: the aircraft cannot fly it.
        MkError: see `Vehicle`.
    """
    request = step.request
    return await uav.paths.upload(request.points, request.pieces)


def path_words(path: PathStored) -> str:
    """What a path asks for."""
    size = f"{path.length:.1f} m in {path.duration:.1f} s"
    return f"{size}, up to {path.speed:.2f} m/s and {path.acceleration:.2f} m/s2"


async def _wait(uav: Vehicle, lease: Lease, step: WaitStep) -> None:
    """Hold, or before the flight keep the lease, until the condition is met.

    Raises:
        ManoeuvreError: not in time.
    """
    looks = max(1, math.ceil(step.patience / LOOK))
    for _ in range(looks):
        sample = await uav.get(step.key)
        if sample is not None and step.holds(sample.fields.get(step.field)):
            return
        if lease.is_engaged:
            await lease.hold(seconds=LOOK)
        else:
            await lease.pause(LOOK)
    raise ManoeuvreError(f"wait: {step.key} {step.field} was not as wanted within {step.patience:g} s")
