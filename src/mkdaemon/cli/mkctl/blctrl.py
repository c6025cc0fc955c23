"""`mkctl bl`: configuration of the motor controllers, through the FlightCtrl."""

from __future__ import annotations

import json
from typing import Annotated, Final

from cyclopts import App, Parameter, validators

from mkdaemon.cli.mkctl.connection import HERE, Connection
from mkdaemon.cli.mkctl.conversation import request
from mkdaemon.client import Vehicle
from mkdaemon.errors import ConfigError, MkError, RequestTimeoutError
from mkdaemon.protocol.flags import MotorControllerBits, MotorControllerItems, MotorControllerStatus
from mkdaemon.protocol.messages import (
    MotorController,
    MotorControllerRequest,
    MotorControllerWritten,
    WriteMotorController,
)
from mkdaemon.protocol.messages.blctrl import motor_controller_checksum
from mkdaemon.protocol.wire import Board

app = App(name="bl", help="Configuration of BL-Ctrl 2.0 and later, through a FlightCtrl 0.80 and later; motors off.")

ITEMS: Final = {
    "pwm_scaling": MotorControllerItems.PWM_SCALING,
    "current_limit": MotorControllerItems.CURRENT_LIMIT,
    "temperature_limit": MotorControllerItems.TEMPERATURE_LIMIT,
    "current_scaling": MotorControllerItems.CURRENT_SCALING,
    "bits": MotorControllerItems.BITS,
}
"""Fields that can be set, each with the bit that applies it."""

Motor = Annotated[int, Parameter(help="Motor 1..16.", validator=validators.Number(gte=1, lte=16))]
Byte = validators.Number(gte=0, lte=255)


@app.command
async def get(motor: Motor, /, *, connection: Connection = HERE) -> None:
    """Show a motor controller's configuration."""
    async with connection.open() as client:
        _show(connection, await _read(client, motor))


@app.command(name="set")
async def set_configuration(
    motor: Motor,
    /,
    *,
    pwm_scaling: Annotated[int | None, Parameter(help="Limits the largest PWM.", validator=Byte)] = None,
    current_limit: Annotated[int | None, Parameter(help="[A]", validator=Byte)] = None,
    temperature_limit: Annotated[int | None, Parameter(help="[degC]", validator=Byte)] = None,
    current_scaling: Annotated[int | None, Parameter(help="Gain of the current measurement.", validator=Byte)] = None,
    reverse: Annotated[bool | None, Parameter(help="Sense of rotation.")] = None,
    save: Annotated[bool, Parameter(help="Keep it in the controller's EEPROM.", negative=())] = False,
    confirm: Annotated[
        bool, Parameter(help="I know that a wrong sense of rotation or limit crashes the aircraft.", negative=())
    ] = False,
    connection: Connection = HERE,
) -> None:
    """Change some items of a motor controller, read them back and compare. All others stay as they are.

    Raises:
        ConfigError: nothing to change, or it was not confirmed.
        MkError: the controller refused it, or holds something else afterwards.
    """
    given = {
        "pwm_scaling": pwm_scaling,
        "current_limit": current_limit,
        "temperature_limit": temperature_limit,
        "current_scaling": current_scaling,
    }
    if all(value is None for value in given.values()) and reverse is None:
        msg = "nothing to change; give an item, for example --current-limit 20"
        raise ConfigError(msg)
    if not confirm:
        msg = "a wrong sense of rotation or limit crashes the aircraft; check it and repeat with --confirm"
        raise ConfigError(msg)
    async with connection.open() as client:
        wanted = configure(await _read(client, motor), given, reverse=reverse, save=save)
        answer = await request(client, Board.FC, wanted)
        if isinstance(answer, MotorControllerWritten) and not answer.done:
            _raise_status(motor, answer.status)
        stored = await _read(client, motor)
    wrong = [name for name in ITEMS if getattr(stored, name) != getattr(wanted, name)]
    if wrong:
        texts = [f"{name} is {getattr(stored, name)}, not {getattr(wanted, name)}" for name in wrong]
        msg = f"motor controller {motor}: {'; '.join(texts)}; do not fly"
        raise MkError(msg)
    _show(connection, stored)


def configure(
    present: MotorController, given: dict[str, int | None], *, reverse: bool | None, save: bool
) -> WriteMotorController:
    """Return the write that changes only what is given: its mask names those items, its checksum is right.

    Args:
        present: configuration as it is.
        given: new values by field; None keeps.
        reverse: sense of rotation; None keeps.
        save: whether the controller keeps it.
    """
    values = {name: getattr(present, name) for name in ITEMS} | {k: v for k, v in given.items() if v is not None}
    items = MotorControllerItems.NONE
    for name, value in given.items():
        if value is not None:
            items |= ITEMS[name]
    if reverse is not None:
        bits = MotorControllerBits(present.bits)
        values["bits"] = bits | MotorControllerBits.REVERSE if reverse else bits & ~MotorControllerBits.REVERSE
        items |= MotorControllerItems.BITS
    if save:
        items |= MotorControllerItems.SAVE
    draft = WriteMotorController(
        motor=present.motor,
        revision=present.revision,
        items=items,
        checksum=0,
        **{k: int(v) for k, v in values.items()},
    )
    return draft.model_copy(update={"checksum": motor_controller_checksum(draft.encode()[1:8])})


async def _read(client: Vehicle, motor: int) -> MotorController:
    answer = await request(client, Board.FC, MotorControllerRequest(motor=motor))
    if not isinstance(answer, MotorController):
        msg = f"no configuration of motor controller {motor}: motors must be off, the FlightCtrl 0.80 or later"
        raise RequestTimeoutError(msg)
    if not answer.done:
        _raise_status(motor, answer.status)
    return answer


def _raise_status(motor: int, status: MotorControllerStatus) -> None:
    words = MotorControllerStatus(status).name.lower().replace("_", " ")
    msg = f"motor controller {motor}: {words}; check that motors are off and the controller is a BL-Ctrl 2.0 or later"
    raise MkError(msg)


def _show(connection: Connection, found: MotorController) -> None:
    fields = found.model_dump(mode="json", exclude={"done", "status", "items", "checksum"})
    fields["reverse"] = bool(found.bits & MotorControllerBits.REVERSE)
    if connection.json:
        print(json.dumps(fields))
        return
    for name, value in fields.items():
        unit = found.spec.wire(name).unit if name in type(found).model_fields else ""
        print(f"{name:20} {value} {unit}".rstrip())
