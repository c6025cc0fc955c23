"""`mkctl take-off`, `attitude`, `abort`, `stop`: what begins, bypasses and ends a flight against a target."""

from __future__ import annotations

import math
from typing import Annotated

from cyclopts import Parameter, validators

from mkdaemon.cli.arguments import require_length
from mkdaemon.cli.mkctl.connection import HERE, Connection
from mkdaemon.cli.mkctl.flight import Force, Seconds
from mkdaemon.cli.mkctl.flightshow import leased, metres, print_end, require_finite, showing


async def take_off(
    height: Annotated[float, Parameter(validator=validators.Number(gte=0.5, lte=10.0))],
    /,
    *,
    seconds: Annotated[float, Parameter(name=["--seconds", "-s"], help="How long it holds there.")] = 10.0,
    force: Force = False,
    connection: Connection = HERE,
) -> None:
    """Take off from the target to a height over its middle, hold there, then release.

    The pilot has started the motors and opened the gate, throttle at its lowest. For three seconds ours stays at its
    lowest too: in that time he raises his above hover. Ctrl-C releases at once; docs/flying.md.

    Args:
        height: Metres above the target.

    Raises:
        ConfigError: a number cannot be.
        MkError: the daemon refused, did not engage, or the take-off failed; says why.
    """
    require_length(seconds, "--seconds")
    async with connection.open() as uav, leased(uav, connection, force=force) as lease:
        async with showing(uav, lease, connection, lambda: None) as shown:
            await lease.take_off(height)
            await lease.hold(seconds=seconds)
        print_end({"position": shown.position}, f"took off; now at {metres(shown.position)}", connection)


async def attitude(
    *,
    pitch: Annotated[float, Parameter(help="Nose down positive [deg].")] = 0.0,
    roll: Annotated[float, Parameter(help="Right side down positive [deg].")] = 0.0,
    yaw_rate: Annotated[float, Parameter(help="Nose left positive [deg/s].")] = 0.0,
    thrust: Annotated[float, Parameter(help="Share of the weight.")] = 1.0,
    seconds: Seconds = 2.0,
    force: Force = False,
    connection: Connection = HERE,
) -> None:
    """Fly by attitude and thrust for some seconds, then release; nothing holds a place.

    Raises:
        ConfigError: a number cannot be.
        MkError: the daemon refused, did not engage, or let go on the way.
    """
    require_finite(pitch=pitch, roll=roll, yaw_rate=yaw_rate, thrust=thrust)
    require_length(seconds, "--seconds")
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
        print_end({"setpoints": lease.setpoints, "limited": is_limited}, words, connection)


async def abort(reason: str = "asked for by mkctl", *, connection: Connection = HERE) -> None:
    """Stop the manoeuvre that is flown, whoever flies: the aircraft holds its place, or is level without a target.

    Its holder keeps the lease; the aircraft is released when he stops to stream. A landing below 13 cm goes on; a
    take-off that has not left the ground is released. `mkctl release` lets go at once.

    Args:
        reason: Published with the change of phase.

    Raises:
        MkError: nothing is flown, or no daemon.
    """
    async with connection.open() as uav:
        await uav.abort(reason)
    print_end({"aborted": True}, "aborted: the aircraft holds, or is level", connection)


async def stop(
    *,
    in_flight: Annotated[bool, Parameter(negative=(), help="I know that an aircraft in the air falls.")] = False,
    connection: Connection = HERE,
) -> None:
    """Stop the motors. Only a public fork of the FlightCtrl can be asked to; on any other the pilot's sticks do it.

    Raises:
        MkError: refused: an aircraft that flies, stock firmware, or `commands.fork_arming` is not set.
    """
    async with connection.open() as uav:
        await uav.stop(in_flight=in_flight)
    print_end({"stopped": None}, "asked for; only telemetry tells whether the motors stand", connection)
