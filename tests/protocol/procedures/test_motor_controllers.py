from __future__ import annotations

import pytest

from mkdaemon.protocol.flags import MotorControllerBits, MotorControllerItems
from mkdaemon.protocol.messages import MotorController
from mkdaemon.protocol.messages.blctrl import motor_controller_checksum
from mkdaemon.protocol.procedures.motor_controllers import configure

PRESENT = MotorController.decode(bytes((1, 0, 3, 2, 0, 255, 30, 99, 64, 0x02, 7)))
NOTHING: dict[str, int | None] = dict.fromkeys(["pwm_scaling", "current_limit", "temperature_limit", "current_scaling"])


@pytest.mark.parametrize(
    ("given", "reverse", "save", "items"),
    [
        ({"current_limit": 20}, None, False, MotorControllerItems.CURRENT_LIMIT),
        ({"pwm_scaling": 200}, None, True, MotorControllerItems.PWM_SCALING | MotorControllerItems.SAVE),
        ({}, True, False, MotorControllerItems.BITS),
        ({"temperature_limit": 0}, False, False, MotorControllerItems.TEMPERATURE_LIMIT | MotorControllerItems.BITS),
    ],
)
def test_only_what_is_given_is_applied(
    given: dict[str, int], reverse: bool | None, save: bool, items: MotorControllerItems
) -> None:
    write = configure(PRESENT, {**NOTHING, **given}, reverse=reverse, save=save)
    assert write.items == items
    assert (write.motor, write.revision) == (3, 2)
    assert write.checksum == motor_controller_checksum(write.encode()[1:8])
    for name in NOTHING:
        assert getattr(write, name) == given.get(name, getattr(PRESENT, name))


def test_the_sense_of_rotation_keeps_the_other_bits() -> None:
    turned = configure(PRESENT, NOTHING, reverse=True, save=False)
    assert turned.bits == MotorControllerBits.REVERSE | MotorControllerBits.START_1
    assert configure(PRESENT, NOTHING, reverse=False, save=False).bits == MotorControllerBits.START_1
