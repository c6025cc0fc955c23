"""`mkctl board motor-controllers`: configuration of the motor controllers, through the FlightCtrl."""

from __future__ import annotations

from typing import Annotated, Any

from cyclopts import App, Parameter, validators

from mkdaemon.cli.mkctl.connection import HERE, Connection
from mkdaemon.errors import ConfigError
from mkdaemon.protocol.messages import MotorController
from mkdaemon.telemetry.settings import ControllerSettings

app = App(
    name="motor-controllers",
    help="Configuration of BL-Ctrl 2.0 and later, through a FlightCtrl 0.80 and later; motors off.",
)

Motor = Annotated[int, Parameter(help="Motor 1..16.", validator=validators.Number(gte=1, lte=16))]
Byte = validators.Number(gte=0, lte=255)


@app.command
async def read(motor: Motor, /, *, connection: Connection = HERE) -> None:
    """Show a motor controller's configuration.

    Example: mkctl board motor-controllers read 1
    """
    async with connection.open() as uav:
        [found] = (await uav.motor_controllers.read([motor])).controllers
    _show(connection, found)


@app.command
async def write(
    motor: Motor,
    /,
    *,
    pwm_scaling: Annotated[int | None, Parameter(help="Limits the largest PWM.", validator=Byte)] = None,
    current_limit: Annotated[int | None, Parameter(help="[A]", validator=Byte)] = None,
    temperature_limit: Annotated[int | None, Parameter(help="[degC]", validator=Byte)] = None,
    current_scaling: Annotated[int | None, Parameter(help="Gain of the current measurement.", validator=Byte)] = None,
    reverse: Annotated[bool | None, Parameter(help="Sense of rotation.")] = None,
    save: Annotated[bool, Parameter(help="Keep it in the controller's EEPROM.")] = False,
    confirm: Annotated[
        bool, Parameter(help="I know that a wrong sense of rotation or limit crashes the aircraft.")
    ] = False,
    connection: Connection = HERE,
) -> None:
    """Change some items of a motor controller, read them back and compare. All others stay as they are.

    Example: mkctl board motor-controllers write 1 --current-limit 20 --confirm --save

    Raises:
        ConfigError: nothing to change, or it was not confirmed.
        MkError: the controller refused it, or holds something else afterwards.
    """
    given: dict[str, Any] = {
        "pwm_scaling": pwm_scaling,
        "current_limit": current_limit,
        "temperature_limit": temperature_limit,
        "current_scaling": current_scaling,
    }
    if all(value is None for value in given.values()) and reverse is None:
        raise ConfigError("nothing to change; give an item, for example --current-limit 20")
    if not confirm:
        raise ConfigError("a wrong sense of rotation or limit crashes the aircraft; check it and repeat with --confirm")
    async with connection.open() as uav:
        [stored] = (
            await uav.motor_controllers.write(motor, confirm=confirm, reverse=reverse, save=save, **given)
        ).controllers
    _show(connection, stored)


def _show(connection: Connection, found: ControllerSettings) -> None:
    fields = found.model_dump()
    known = MotorController.model_fields
    units = {name: MotorController.spec.wire(name).unit if name in known else "" for name in fields}
    connection.show(fields, "\n".join(f"{name:20} {fields[name]} {unit}".rstrip() for name, unit in units.items()))
