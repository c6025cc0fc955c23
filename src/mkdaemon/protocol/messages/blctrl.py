"""BL-Ctrl motor controllers: configuration through the FlightCtrl, and the internal redundancy link.

Source: docs/protocol.md, "FlightCtrl commands" and "BL-Ctrl".
"""

from __future__ import annotations

from typing import Annotated

from mkdaemon.protocol.fields import U8, Rest
from mkdaemon.protocol.flags import (
    MotorControllerBits,
    MotorControllerItems,
    MotorControllerStatus,
    RedundancyBits,
)
from mkdaemon.protocol.matching import same
from mkdaemon.protocol.sources import Source
from mkdaemon.protocol.spec import Policy
from mkdaemon.protocol.units import AMPERE, CELSIUS, DECIAMPERE
from mkdaemon.protocol.wire import Board, WireMessage, answer, request
from mkdaemon.telemetry.danger import Confirm, Danger


def motor_controller_checksum(configuration: bytes) -> int:
    """Return the checksum of a configuration's first seven bytes: 0xAA plus their sum, modulo 256."""
    return (0xAA + sum(configuration[:7])) & 0xFF


class _Configuration(WireMessage):
    revision: Annotated[int, U8(mk="Revision")] = 2
    """Its bits 0, 1 and 3 must read 2."""
    items: Annotated[MotorControllerItems, U8(mk="SetMask", enum=MotorControllerItems)]
    """What to apply."""
    pwm_scaling: Annotated[int, U8(mk="PwmScaling")]
    """Limits the largest PWM."""
    current_limit: Annotated[int, U8(mk="CurrentLimit", unit=AMPERE)]
    temperature_limit: Annotated[int, U8(mk="TempLimit", unit=CELSIUS)]
    current_scaling: Annotated[int, U8(mk="CurrentScaling")]
    """Gain of the current measurement."""
    bits: Annotated[MotorControllerBits, U8(mk="BitConfig", enum=MotorControllerBits)]
    checksum: Annotated[int, U8(mk="crc")]
    """See `motor_controller_checksum`."""


class _Ack(WireMessage):
    done: Annotated[int, U8(mk="Ack")]
    """1 done, 0 not."""
    status: Annotated[MotorControllerStatus, U8(mk="Status", enum=MotorControllerStatus)]


class _Reply(_Ack):
    motor: Annotated[int, U8(mk="Motor")]


class _Request(WireMessage):
    motor: Annotated[int, U8(mk="Motor", high=16)]
    """1..16; 0 is all."""


@request(
    Board.FC,
    "u",
    reply="U",
    firmware="FC 0.80 and later",
    since=(0, 80),
    source=Source.FC_RECEIVE,
    policy=Policy(1.3, 2),
    matches=same("motor"),
    danger=Danger(effect="the FlightCtrl refuses it while motors run", stopped=True, proven=True),
)
class MotorControllerRequest(WireMessage):
    """Ask for a motor controller's configuration; takes up to 1 s, not while motors run."""

    motor: Annotated[int, U8(mk="Motor", low=1, high=16)]


@answer(Board.FC, "U", firmware="FC 0.80 and later", source=Source.FC_SEND)
class MotorController(_Configuration, _Reply):
    """A motor controller's configuration."""


@request(
    Board.FC,
    "w",
    reply="W",
    firmware="FC 0.80 and later",
    since=(0, 80),
    source=Source.FC_RECEIVE,
    policy=Policy(1.3, 0, deaf=1.0),
    danger=Danger(
        effect="reprograms limits and direction of motor controllers", confirm=Confirm.ALWAYS, stopped=True, proven=True
    ),
)
class WriteMotorController(_Configuration, _Request):
    """Store a motor controller's configuration."""


@answer(Board.FC, "W", firmware="FC 0.80 and later", source=Source.FC_SEND)
class MotorControllerWritten(_Ack):
    """Result of storing a motor controller's configuration."""


@answer(Board.BL, "?", firmware="FC built as redundant slave; address 11 + motor", source=Source.FC_SEND)
class RedundancyStatus(WireMessage):
    """State of a motor controller for a redundant FlightCtrl; internal to the boards, only received."""

    bits: Annotated[RedundancyBits, U8(mk="BitState", enum=RedundancyBits)]
    current: Annotated[int, U8(mk="Current", unit=DECIAMPERE)]
    state: Annotated[int, U8(mk="State")]
    temperature: Annotated[int, U8(mk="Temperature", unit=CELSIUS)]
    voltage: Annotated[int, U8(mk="Voltage80")]


@request(
    Board.BL,
    "!",
    reply="?",
    firmware="FC built as redundant slave; address 11 + motor",
    source=Source.FC_RECEIVE,
    danger=Danger(
        effect="drives motors past the FlightCtrl: never originate it",
        never="it drives motors past the FlightCtrl",
        instead="Use `motor_test`, propellers off.",
    ),
)
class RedundancySetpoints(WireMessage):
    """Set points of a redundant FlightCtrl for motor controllers; internal to the boards, only received."""

    request: Annotated[int, U8(mk="request")]
    """Flags; bit 7: motor test."""
    setpoints: Annotated[bytes, Rest(mk="setpoint", shortest=0, longest=17)]
    """One a motor, and padding."""
