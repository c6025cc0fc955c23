"""Motor controllers (BL-Ctrl 2.0 and later) through a FlightCtrl: read one's configuration, or change some items of it.

Source: docs/protocol.md, "FlightCtrl commands" and "BL-Ctrl".
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from mkdaemon.protocol.flags import MotorControllerBits, MotorControllerItems, MotorControllerStatus
from mkdaemon.protocol.messages import (
    MotorController,
    MotorControllerRequest,
    MotorControllerWritten,
    WriteMotorController,
)
from mkdaemon.protocol.messages.blctrl import motor_controller_checksum
from mkdaemon.protocol.procedures.steps import Patience, Procedure, Progress, Question, insist
from mkdaemon.protocol.wire import Board
from mkdaemon.telemetry.refusals import Token, refuse

ITEMS: Final = {
    "pwm_scaling": MotorControllerItems.PWM_SCALING,
    "current_limit": MotorControllerItems.CURRENT_LIMIT,
    "temperature_limit": MotorControllerItems.TEMPERATURE_LIMIT,
    "current_scaling": MotorControllerItems.CURRENT_SCALING,
    "bits": MotorControllerItems.BITS,
}
"""Fields that can be set, each with the bit that applies it."""


def read_motor_controller(motor: int, patience: Patience) -> Procedure[MotorController]:
    """Read a motor controller's configuration.

    Args:
        motor: 1..16.
        patience: how long to insist on each answer.

    Raises:
        RequestTimeoutError: no answer; the FlightCtrl is older than 0.80, or the line is bad.
        CommandRejectedError: `motor_controller_refused`.
    """
    what = f"configuration of motor controller {motor}"
    request = MotorControllerRequest(motor=motor)
    question = Question(Board.FC, request, (MotorController,), lambda found: found.motor == motor, what)
    found = yield from insist(question, _slow(patience))
    if not found.done:
        raise _refusal(motor, found.status)
    return found


def change_motor_controller(
    motor: int, given: Mapping[str, int | None], patience: Patience, *, reverse: bool | None, save: bool
) -> Procedure[MotorController]:
    """Change some items of a motor controller, read them back and compare. All others stay as they are.

    Args:
        motor: 1..16.
        given: new values by field; None keeps.
        patience: how long to insist on each answer.
        reverse: sense of rotation; None keeps.
        save: whether the controller keeps it without power.

    Raises:
        RequestTimeoutError: no answer.
        CommandRejectedError: `motor_controller_refused`; `motor_controller_differs`: do not fly.
    """
    yield Progress(0, 3, f"reading motor controller {motor}")
    present = yield from read_motor_controller(motor, patience)
    wanted = configure(present, given, reverse=reverse, save=save)
    yield Progress(1, 3, f"writing motor controller {motor}")
    what = f"write motor controller {motor}"
    written = yield from insist(
        Question(Board.FC, wanted, (MotorControllerWritten,), lambda _: True, what), _slow(patience)
    )
    if not written.done:
        raise _refusal(motor, written.status)
    yield Progress(2, 3, "reading it back")
    stored = yield from read_motor_controller(motor, patience)
    wrong = [name for name in ITEMS if getattr(stored, name) != getattr(wanted, name)]
    if wrong:
        where = "; ".join(f"{name} is {getattr(stored, name)}, not {getattr(wanted, name)}" for name in wrong)
        raise refuse(Token.MOTOR_CONTROLLER_DIFFERS, motor=motor, where=where)
    yield Progress(3, 3, "read back")
    return stored


def configure(
    present: MotorController, given: Mapping[str, int | None], *, reverse: bool | None, save: bool
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


def _slow(patience: Patience) -> Patience:
    return Patience(patience.attempts, max(patience.timeout, MotorControllerRequest.spec.policy(Board.FC).timeout))


def _refusal(motor: int, status: MotorControllerStatus) -> Exception:
    words = MotorControllerStatus(status).name.lower().replace("_", " ")
    return refuse(Token.MOTOR_CONTROLLER_REFUSED, motor=motor, status=words)
