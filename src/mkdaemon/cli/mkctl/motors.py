"""`mkctl board motors`: turn motors on the ground, propellers off; stop them where the firmware can be asked."""

from __future__ import annotations

import asyncio
import contextlib
import sys
from typing import Annotated, Final

from cyclopts import App, Parameter, validators

from mkdaemon.cli.mkctl.connection import HERE, Connection
from mkdaemon.client import Vehicle
from mkdaemon.errors import CommandRejectedError, ConfigError, MkError
from mkdaemon.protocol.messages import MotorTest
from mkdaemon.protocol.wire import Board
from mkdaemon.telemetry.refusals import Token

app = App(name="motors", help="Motor test, propellers off; and the motor stop of a public fork of the FlightCtrl.")

PERIOD: Final = 0.1
"""Between two frames [s]; each turns the motors for 0.5 s. Source: docs/firmware-notes, "Side effects"."""
STOPS: Final = 5
"""Frames of zeros at the end."""
GENTLE: Final = 40
"""Set point from which a second word is asked for; idle is about 17 of 255."""
SENTENCE: Final = "propellers off"
"""What has to be typed."""


@app.command
async def test(
    *motors: Annotated[
        int, Parameter(help="Motors 1..16; several run together.", validator=validators.Number(gte=1, lte=16))
    ],
    setpoint: Annotated[
        int,
        Parameter(
            help="Set point of each motor, 1..255; idle is about 17.", validator=validators.Number(gte=1, lte=255)
        ),
    ] = 20,
    seconds: Annotated[float, Parameter(help="Duration [s].", validator=validators.Number(gt=0, lte=30))] = 2.0,
    propellers_off: Annotated[bool, Parameter(help="I have taken the propellers off; do not ask.")] = False,
    connection: Connection = HERE,
) -> None:
    """Turn motors for some seconds, and stop them at the end whatever happens.

    The daemon refuses it while motors run: such values would take effect right after they stop.

    Example: mkctl board motors test 1 2 --setpoint 25 --seconds 3

    Raises:
        ConfigError: no motor was named, or the question about propellers was not answered with yes.
        MkError: the daemon refused it: motors run, for example.
    """
    if not motors:
        raise ConfigError("name the motors to turn, for example `mkctl board motors test 1 2`")
    if not propellers_off:
        _confirm(setpoint)
    points = tuple(setpoint if number in motors else 0 for number in range(1, 17))
    async with connection.open() as client:
        try:
            await _turn(client, points, seconds)
        finally:
            # Also after a refusal and after Ctrl-C: without zeros the motors stop 0.5 s after the last frame.
            await _stop(client)
    print("motors stopped")


@app.command
async def stop(
    *,
    in_flight: Annotated[bool, Parameter(help="I know that an aircraft in the air drops.")] = False,
    connection: Connection = HERE,
) -> None:
    """Stop the motors. Only a public fork of the FlightCtrl can be asked to; on any other the pilot's sticks do it.

    Example: mkctl board motors stop

    Raises:
        MkError: refused: an aircraft that flies, stock firmware, or `commands.fork_arming` is not set.
    """
    async with connection.open() as uav:
        await uav.stop(in_flight=in_flight)
    connection.show({"stopped": None}, "requested; only telemetry shows whether the motors have stopped")


async def _turn(client: Vehicle, points: tuple[int, ...], seconds: float) -> None:
    end = asyncio.get_running_loop().time() + seconds
    while asyncio.get_running_loop().time() < end:
        try:
            await client.request(Board.FC, MotorTest(motors=points), confirm=True)
        except CommandRejectedError as error:
            if error.token != Token.BUSY:  # the next frame follows at once
                raise
        await asyncio.sleep(PERIOD)


async def _stop(client: Vehicle) -> None:
    """Send zeros, in spite of a Ctrl-C; without them the motors stop by themselves after 0.5 s."""
    stop = asyncio.gather(*(_send_stop(client, number * PERIOD / 2) for number in range(STOPS)))
    with contextlib.suppress(asyncio.CancelledError):
        await asyncio.shield(stop)
    if not stop.done():
        await stop
    if not any(stop.result()):
        raise MkError("no stop was taken by the daemon; the FlightCtrl stops the motors 0.5 s after the last frame")


async def _send_stop(client: Vehicle, after: float) -> bool:
    await asyncio.sleep(after)
    with contextlib.suppress(MkError):
        await client.request(Board.FC, MotorTest(motors=(0,) * 16), confirm=True)
        return True
    return False


def _confirm(setpoint: int) -> None:
    """Ask for the words; more than a gentle set point asks for the number too."""
    if not sys.stdin.isatty():
        raise ConfigError("motors turn: take the propellers off and repeat with --propellers-off")
    wanted = SENTENCE if setpoint <= GENTLE else f"{SENTENCE} {setpoint}"
    if input(f"Motors will turn. Type '{wanted}' to go on: ").strip().lower() != wanted:
        raise ConfigError("not confirmed; nothing was sent")
