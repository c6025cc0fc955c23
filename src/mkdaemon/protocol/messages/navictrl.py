"""NaviCtrl: parameters, redirection, motor status, clock.

Source: docs/protocol.md, "NaviCtrl commands".
"""

from __future__ import annotations

from typing import Annotated, Final

from mkdaemon.protocol.fields import S16, U8, U16
from mkdaemon.protocol.flags import NaviParameterId, RedirectPort
from mkdaemon.protocol.units import CELSIUS, DECIAMPERE, MILLISECOND, TEN_MS
from mkdaemon.protocol.wire import Board, Direction, WireMessage, message

ESCAPE: Final = bytes.fromhex("1b1b55aa00")
"""Ends a redirection; no frame, all five bytes. Send it twice, 50 ms apart."""

_PARAMETER = NaviParameterId


@message(
    Board.NC,
    "u",
    key="redirect",
    direction=Direction.TO_BOARD,
    source="WIRE 8, RedirectUart",
    firmware="NC",
    danger="blinds the NaviCtrl's port and stops its servos; commands of the other board become reachable",
)
class Redirect(WireMessage):
    """Connect the host to another board until the escape; 1 and 2 are refused while motors run."""

    port: Annotated[RedirectPort, U8("Port", high=2, enum=RedirectPort)]


def _is_get(payload: bytes) -> bool:
    return payload[0] == 0


def _is_set(payload: bytes) -> bool:
    return payload[0] == 1


@message(
    Board.NC,
    "j",
    key="navi_parameter_request",
    direction=Direction.TO_BOARD,
    reply="J",
    source="WIRE 8, NcParamRequest",
    firmware="NC 0.24 and later",
    recognise=_is_get,
    since=(0, 24),
)
class NaviParameterRequest(WireMessage):
    """Ask for a parameter; one that was never set answers garbage."""

    command: Annotated[int, U8("Cmd", high=0)] = 0
    id: Annotated[NaviParameterId, U8("Id", high=4, enum=_PARAMETER)]
    value: Annotated[int, S16("Value")] = 0


@message(
    Board.NC,
    "j",
    name="NaviParameterRequest",
    key="navi_parameter_request",
    layout="short",
    direction=Direction.TO_BOARD,
    reply="J",
    source='WIRE 8; vector "NC parameter 0 get"',
    firmware="NC 0.24 and later",
    recognise=_is_get,
    since=(0, 24),
)
class NaviParameterRequestShort(WireMessage):
    """Ask for a parameter, without the unused value: as other tools send it."""

    command: Annotated[int, U8("Cmd", high=0)] = 0
    id: Annotated[NaviParameterId, U8("Id", high=4, enum=_PARAMETER)]


@message(
    Board.NC,
    "j",
    key="write_navi_parameter",
    layout="set",
    direction=Direction.TO_BOARD,
    reply="J",
    source="WIRE 8, NcParamRequest",
    firmware="NC 0.24 and later",
    danger="changes speed, heading or altitude set points in flight",
    recognise=_is_set,
    since=(0, 24),
)
class WriteNaviParameter(WireMessage):
    """Set a parameter."""

    command: Annotated[int, U8("Cmd", low=1, high=1)] = 1
    id: Annotated[NaviParameterId, U8("Id", high=4, enum=_PARAMETER)]
    value: Annotated[int, S16("Value")]


@message(
    Board.NC,
    "J",
    key="navi_parameter",
    direction=Direction.FROM_BOARD,
    source="WIRE 8, NcParamReply",
    firmware="NC 0.24 and later",
)
class NaviParameter(WireMessage):
    """A parameter."""

    id: Annotated[NaviParameterId, U8("Id", enum=_PARAMETER)]
    value: Annotated[int, S16("Value")]
    """TARGET_SPEED 0.1 m/s, HEADING_SETPOINT deg (-1 none), ALTITUDE_SETPOINT dm."""


@message(
    Board.NC,
    "k",
    key="motor_status_request",
    direction=Direction.TO_BOARD,
    reply="K",
    source="WIRE 8",
    firmware="NC 0.26/0.27 and later",
    any_address=True,
    since=(0, 26),
)
class MotorStatusRequest(WireMessage):
    """Stream the state of the motor controllers, one motor a frame."""

    interval: Annotated[int, U8("Interval", TEN_MS)]
    """0 stops."""


@message(
    Board.NC,
    "K",
    key="motor_status",
    direction=Direction.FROM_BOARD,
    source="WIRE 8, BLData",
    firmware="NC 0.26/0.27 and later",
)
class MotorStatus(WireMessage):
    """State of one motor controller; motors come in no fixed order, absent ones seldom."""

    index: Annotated[int, U8("Index")]
    """0 is motor 1."""
    current: Annotated[int, U8("Current", DECIAMPERE)]
    """BL 3: 200 is 20 A, above in steps of 1 A."""
    temperature: Annotated[int, U8("Temperature", CELSIUS)]
    """255 on old controllers."""
    max_pwm: Annotated[int, U8("MaxPWM")]
    """255 normal, 250 not running, 40 starting, anything lower: limited."""
    status: Annotated[int, U8("Status")]
    """Bit 7: present; the rest counts I2C errors."""


@message(
    Board.NC,
    "t",
    key="time_request",
    direction=Direction.TO_BOARD,
    reply="T",
    source="WIRE 4, 8",
    firmware="NC 0.30g and later",
    danger="a FlightCtrl reads it as a motor test: only while the last version reply came from a NaviCtrl",
    since=(0, 30),
)
class TimeRequest(WireMessage):
    """Ask for the GPS time."""

    one: Annotated[int, U8("Interval", low=1, high=1)] = 1


@message(
    Board.NC,
    "T",
    key="time",
    direction=Direction.FROM_BOARD,
    source="WIRE 8, DateTime_arm",
    firmware="NC 0.30g and later",
)
class NaviTime(WireMessage):
    """GPS time, UTC."""

    year: Annotated[int, U16("Year")]
    month: Annotated[int, U8("Month")]
    day: Annotated[int, U8("Day")]
    hour: Annotated[int, U8("Hour")]
    minute: Annotated[int, U8("Min")]
    second: Annotated[int, U8("Sec")]
    padding_0: Annotated[int, U8("pad0")] = 0
    """From here on the places are inferred: right if the NaviCtrl's compiler pads."""
    millisecond: Annotated[int, U16("mSec", MILLISECOND)]
    valid: Annotated[int, U8("Valid")]
    padding_1: Annotated[int, U8("pad1")] = 0
