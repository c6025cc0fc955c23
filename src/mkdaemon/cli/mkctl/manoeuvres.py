"""`mkctl take-off`, `goto`, `hold`, `velocity`, `attitude`, `stick`, `land`, `abort`: one flight each."""

from __future__ import annotations

import math
from typing import Annotated, Final, Literal

from cyclopts import Parameter, validators

from mkdaemon.cli.arguments import Finite, Length, fitting
from mkdaemon.cli.mkctl.connection import HERE, Connection
from mkdaemon.cli.mkctl.flightshow import (
    Position,
    conclude,
    flying,
    leased,
    metres,
    read_position,
)
from mkdaemon.cli.mkctl.navi import PATIENCE, fly_to
from mkdaemon.cli.printing import json_line

LONGEST_STAY: Final = 255
"""How long the NaviCtrl stays at a place at home [s]; its points take no more."""
STAY: Final = 10.0
"""Default time for which the aircraft holds a place [s]."""
BRIEF: Final = 0.2
"""Time flown to learn where the aircraft is [s]."""

Force = Annotated[bool, Parameter(help="Take the lease from its holder.")]
TargetName = Annotated[
    str, Parameter(name="--target", help="Name of the target, or of a place in a map; by default the one in sight.")
]
Yaw = Annotated[Finite | None, Parameter(help="Heading, counter-clockwise from x [deg]; default: unchanged.")]
Within = Annotated[Length, Parameter(help="Exit code 0 only if the final distance is at most this [m].")]
Seconds = Annotated[Length, Parameter(name=["--seconds", "-s"], help="Duration from the engagement [s].")]


async def goto(
    x: Finite,
    y: Finite,
    z: Finite,
    /,
    *,
    yaw: Yaw = None,
    frame: Annotated[Literal["pad", "body", "home"], Parameter(help="Origin of x, y and z.")] = "pad",
    target: TargetName = "",
    seconds: Annotated[
        Length | None,
        Parameter(name=["--seconds", "-s"], help="Hold time at the goal [s]; default 10, with home 255."),
    ] = None,
    within: Within = 0.3,
    force: Force = False,
    patience: Annotated[Length, Parameter(help="Frame home: longest time for switch and flight [s].")] = PATIENCE,
    confirm: Annotated[bool, Parameter(help="Frame home: I know that the NaviCtrl flies there.")] = False,
    connection: Connection = HERE,
) -> int:
    """Fly to a place over the target in sight, hold it, then release.

    In frame `pad`: x to the right of its print, y to its top, z up. In frame `body`: forward, left and up from where
    the aircraft is; yaw from its heading. Ctrl-C releases at once. The pilot must have handed over: docs/flying.md.

    In frame `home`: east, north and up of home, and yaw from east, flown by the NaviCtrl with GPS, which is good for 2
    to 3 m. In flight, GPS switch at free or hold: the daemon stores the place and reads it back, then the pilot turns
    the switch to coming home, so it takes --confirm. The height is flown only with height control, else by the pilot's
    throttle. Ctrl-C ends the waiting, not the flight: the switch does.

    Example: mkctl goto 0 0.5 2 --within 0.1

    Args:
        x: Metres from the middle of the target, or east of home.
        y: Metres from the middle of the target, or north of home.
        z: Metres above the target, or above the start.

    Raises:
        ConfigError: a number cannot be, or `--confirm` is missing.
        MkError: the daemon refused, did not engage, or released early; at home the place was not reached.
    """
    if frame == "home":
        compass = None if yaw is None else round(90.0 - yaw - 1.0) % 360 + 1
        stay = LONGEST_STAY if seconds is None else min(round(seconds), LONGEST_STAY)
        await fly_to((x, y, z), compass, stay, confirm=confirm, patience=patience, connection=connection)
        return 0
    seconds = STAY if seconds is None else seconds
    heading = None if yaw is None else math.remainder(math.radians(yaw), math.tau)
    goal = (x, y, z) if frame == "pad" else None
    async with flying(connection, lambda: goal, force=force) as (_, lease, shown):
        await lease.goto(x, y, z, yaw=heading, frame=frame, target=target, seconds=seconds)
    return conclude(shown, goal or shown.goal, within, connection)


async def hold(
    *,
    height: Annotated[Finite | None, Parameter(help="Height above the target [m]; default: the present one.")] = None,
    target: TargetName = "",
    seconds: Seconds = 10.0,
    within: Within = 0.3,
    force: Force = False,
    connection: Connection = HERE,
) -> int:
    """Hold the place where the aircraft is when the daemon engages, then release.

    Example: mkctl hold --height 2 --seconds 30

    Raises:
        ConfigError: a number cannot be.
        MkError: the daemon refused, did not engage, or released early.
    """
    goal: Position | None = None
    async with flying(connection, lambda: goal, force=force) as (uav, lease, shown):
        await lease.velocity(0.0, 0.0, 0.0, target=target, seconds=BRIEF)
        x, y, z = shown.position or await read_position(uav)
        goal = (x, y, z if height is None else height)
        await lease.goto(*goal, target=target, seconds=seconds)
    return conclude(shown, goal, within, connection)


async def velocity(
    x: Finite,
    y: Finite,
    z: Finite,
    /,
    *,
    frame: Annotated[Literal["pad", "body"], Parameter(help="Axes of the target, or forward and left.")] = "pad",
    target: TargetName = "",
    seconds: Seconds = 2.0,
    force: Force = False,
    connection: Connection = HERE,
) -> None:
    """Fly at a velocity against the target in sight, then release.

    Example: mkctl velocity 0.2 0 0 --seconds 3

    Args:
        x: Metres per second along the first axis.
        y: Metres per second along the second.
        z: Metres per second up.

    Raises:
        ConfigError: a number cannot be.
        MkError: the daemon refused, did not engage, or released early.
    """
    async with flying(connection, force=force) as (_, lease, shown):
        await lease.velocity(x, y, z, frame=frame, target=target, seconds=seconds)
    connection.show({"position": shown.position}, f"now at {metres(shown.position)}")


async def land(
    *,
    yaw: Yaw = None,
    target: TargetName = "",
    force: Force = False,
    connection: Connection = HERE,
) -> None:
    """Land on the target in sight; ends when it has landed and the aircraft is released.

    The motors still turn then: the pilot stops them.

    Example: mkctl land --yaw 90

    Raises:
        ConfigError: a number cannot be.
        MkError: the daemon refused, did not engage, or released before the touchdown.
    """
    heading = None if yaw is None else math.remainder(math.radians(yaw), math.tau)
    async with flying(connection, lambda: (0.0, 0.0, 0.0), force=force) as (_, lease, shown):
        await lease.land(yaw=heading, target=target)
    connection.show({"position": shown.position}, f"{lease.reason}; the pilot stops the motors")


async def take_off(
    height: Annotated[float, Parameter(validator=validators.Number(gte=0.5, lte=10.0))],
    /,
    *,
    seconds: Annotated[Length, Parameter(name=["--seconds", "-s"], help="Hold time at the goal [s].")] = 10.0,
    target: TargetName = "",
    force: Force = False,
    connection: Connection = HERE,
) -> None:
    """Take off from the target to a height over its middle, hold there, then release.

    The pilot has started the motors and opened the gate, throttle at its lowest. For three seconds ours stays at its
    lowest too: in that time he raises his above hover. Ctrl-C releases at once; docs/flying.md.

    Example: mkctl take-off 2 --seconds 30

    Args:
        height: Metres above the target.

    Raises:
        ConfigError: a number cannot be.
        MkError: the daemon refused, did not engage, or the take-off failed; says why.
    """
    async with flying(connection, force=force) as (_, lease, shown):
        await lease.take_off(height, target=target)
        await lease.hold(target=target, seconds=seconds)
    connection.show({"position": shown.position}, f"took off; now at {metres(shown.position)}")


async def attitude(
    *,
    pitch: Annotated[Finite, Parameter(help="Nose down positive [deg].")] = 0.0,
    roll: Annotated[Finite, Parameter(help="Right side down positive [deg].")] = 0.0,
    yaw_rate: Annotated[Finite, Parameter(help="Nose left positive [deg/s].")] = 0.0,
    thrust: Annotated[Finite, Parameter(help="Share of the weight.")] = 1.0,
    seconds: Seconds = 2.0,
    force: Force = False,
    connection: Connection = HERE,
) -> None:
    """Fly by attitude and thrust for some seconds, then release; nothing holds a place.

    Example: mkctl attitude --pitch 5 --seconds 1

    Raises:
        ConfigError: a number cannot be.
        MkError: the daemon refused, did not engage, or released early.
    """
    async with connection.open() as uav, leased(uav, connection, force=force) as lease:
        await lease.attitude(
            pitch=math.radians(pitch),
            roll=math.radians(roll),
            yaw_rate=math.radians(yaw_rate),
            thrust=thrust,
            seconds=seconds,
        )
        output = await uav.control.output.latest()
        is_limited = output is not None and bool(output.value.limited)
        words = f"{lease.setpoints} setpoints{'; the limiter cut the last stick frame' if is_limited else ''}"
        connection.show({"setpoints": lease.setpoints, "limited": is_limited}, words)


async def abort(reason: str = "asked for by mkctl", *, connection: Connection = HERE) -> None:
    """Stop the manoeuvre of any client: the aircraft holds its place, or is level without a target.

    The holder keeps the lease, and the next call of its program ends the abort and flies on. The aircraft is released
    when the holder stops streaming. A landing below 13 cm goes on; a take-off that has not left the ground is released.

    To give the aircraft back to the pilot at once, use `mkctl release`. Neither stops motors: `mkctl release --help`.

    Example: mkctl abort

    Args:
        reason: Published with the change of phase.

    Raises:
        MkError: nothing is flown, or no daemon.
    """
    async with connection.open() as uav:
        await uav.abort(reason)
    connection.show({"aborted": True}, "aborted: the aircraft holds, or is level")


FULL = 127
"""Full stick [count]."""
Stick = Annotated[float, fitting(lambda value: abs(value) <= FULL, f"give a number from -{FULL} to {FULL}")]
AXES = ("pitch", "roll", "yaw", "throttle")


async def stick(
    *,
    pitch: Stick = 0.0,
    roll: Stick = 0.0,
    yaw: Stick = 0.0,
    throttle: Stick,
    seconds: Annotated[Length, Parameter(name=["--seconds", "-s"])] = 2.0,
    rate: Length = 50.0,
    force: bool = False,
    connection: Connection = HERE,
) -> None:
    """Take the lease, stream neutral sticks until the daemon engages, then these for some seconds, then release.

    Counts as on the receiver, full deflection about 125; every frame passes the limiter. Ctrl-C releases at once.
    Exit code 1 when they did not fly to the end.

    Example: mkctl stick --pitch 8 --throttle 0 --seconds 2

    Args:
        pitch: Nose down positive.
        roll: Right side down positive.
        yaw: Nose left positive.
        throttle: From the centre, more lift positive; stock firmware takes the smaller of this and the pilot's.
        seconds: How long after the neutral lead.
        rate: Setpoints a second.
        force: Take the lease from its holder.

    Raises:
        ConfigError: a stick is beyond its range, or no number.
        MkError: the daemon refused the lease, did not engage, or released early.
    """
    async with connection.open() as uav, leased(uav, connection, force=force) as lease:
        await lease.stick(pitch=pitch, roll=roll, yaw=yaw, throttle=throttle, seconds=seconds, rate=rate)
        output = await uav.control.output.latest()
    sent = {name: None if output is None else getattr(output.value, name) for name in (*AXES, "limited")}
    if connection.json:
        print(json_line({"epoch": lease.epoch, "setpoints": lease.setpoints, "last_output": sent}))
    else:
        sticks = ", ".join(f"{axis} {sent[axis]}" for axis in AXES)
        print(f"{lease.setpoints} setpoints; last stick frame: {sticks}{' (limited)' if sent['limited'] else ''}")
