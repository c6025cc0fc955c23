"""NaviCtrl: parameters, redirection, motor status, clock.

Source: docs/protocol.md, "NaviCtrl commands".
"""

from __future__ import annotations

from typing import Annotated, Final

from mkdaemon.protocol.fields import S16, U8, U16
from mkdaemon.protocol.flags import NaviParameterId, RedirectPort
from mkdaemon.protocol.matching import same
from mkdaemon.protocol.sources import Source
from mkdaemon.protocol.spec import Policy
from mkdaemon.protocol.units import CELSIUS, DECIAMPERE, MILLISECOND, TEN_MS
from mkdaemon.protocol.wire import Board, WireMessage, answer, request
from mkdaemon.telemetry.danger import Confirm, Danger

ESCAPE: Final = bytes.fromhex("1b1b55aa00")
"""Ends a redirection; no frame, all five bytes. Send it twice, 50 ms apart."""

_PARAMETER = NaviParameterId


@request(
    Board.NC,
    "u",
    firmware="NC",
    source=Source.NC_RECEIVE,
    danger=Danger(
        effect="blinds the NaviCtrl's port and stops its servos; commands of the other board become reachable",
        confirm=Confirm.ALWAYS,
        stopped=True,
        proven=True,
    ),
)
class Redirect(WireMessage):
    """Connect the host to another board until the escape; 1 and 2 are refused while motors run."""

    port: Annotated[RedirectPort, U8(mk="Port", high=2, enum=RedirectPort)]


def _is_get(payload: bytes) -> bool:
    return payload[0] == 0


def _is_set(payload: bytes) -> bool:
    return payload[0] == 1


@request(
    Board.NC,
    "j",
    reply="J",
    firmware="NC 0.24 and later",
    since=(0, 24),
    source=Source.NC_RECEIVE,
    policy=Policy(0.4, 4),
    matches=same("id"),
    recognise=_is_get,
)
class NaviParameterRequest(WireMessage):
    """Ask for a parameter; one that was never set answers garbage."""

    command: Annotated[int, U8(mk="Cmd", high=0)] = 0
    id: Annotated[NaviParameterId, U8(mk="Id", high=4, enum=_PARAMETER)]
    value: Annotated[int, S16(mk="Value")] = 0
    """Not looked at."""


@request(
    Board.NC,
    "j",
    name="NaviParameterRequest",
    layout="short",
    reply="J",
    firmware="NC 0.24 and later",
    since=(0, 24),
    source=(Source.NC_RECEIVE, Source.TOOLS),
    policy=Policy(0.4, 4),
    matches=same("id"),
    recognise=_is_get,
)
class NaviParameterRequestShort(WireMessage):
    """Ask for a parameter, without the unused value: as other tools send it."""

    command: Annotated[int, U8(mk="Cmd", high=0)] = 0
    id: Annotated[NaviParameterId, U8(mk="Id", high=4, enum=_PARAMETER)]


@request(
    Board.NC,
    "j",
    layout="set",
    reply="J",
    firmware="NC 0.24 and later",
    since=(0, 24),
    source=Source.NC_RECEIVE,
    policy=Policy(0.4, 4),
    matches=same("id"),
    danger=Danger(
        effect="changes speed, heading or altitude set points in flight", confirm=Confirm.IN_FLIGHT, proven=True
    ),
    recognise=_is_set,
)
class WriteNaviParameter(WireMessage):
    """Set a parameter."""

    command: Annotated[int, U8(mk="Cmd", low=1, high=1)] = 1
    id: Annotated[NaviParameterId, U8(mk="Id", high=4, enum=_PARAMETER)]
    value: Annotated[int, S16(mk="Value")]
    """In the unit of the parameter: speed 0.1 m/s, heading deg (-1 none), altitude dm."""


@answer(Board.NC, "J", firmware="NC 0.24 and later", source=Source.NC_SEND)
class NaviParameter(WireMessage):
    """A parameter."""

    id: Annotated[NaviParameterId, U8(mk="Id", enum=_PARAMETER)]
    value: Annotated[int, S16(mk="Value")]
    """TARGET_SPEED 0.1 m/s, HEADING_SETPOINT deg (-1 none), ALTITUDE_SETPOINT dm."""


@request(
    Board.NC,
    "k",
    reply="K",
    firmware="NC 0.26/0.27 and later",
    since=(0, 26),
    source=(Source.TOOLS, Source.WIKI),
    any_address=True,
)
class MotorStatusRequest(WireMessage):
    """Stream the state of the motor controllers, one motor a frame."""

    interval: Annotated[int, U8(mk="Interval", unit=TEN_MS)]
    """0 stops."""


@answer(Board.NC, "K", firmware="NC 0.26/0.27 and later", source=(Source.TOOLS, Source.WIKI))
class MotorStatus(WireMessage):
    """State of one motor controller; motors come in no fixed order, absent ones seldom."""

    index: Annotated[int, U8(mk="Index")]
    """0 is motor 1."""
    current: Annotated[int, U8(mk="Current", unit=DECIAMPERE)]
    """BL 3: 200 is 20 A, above in steps of 1 A."""
    temperature: Annotated[int, U8(mk="Temperature", unit=CELSIUS)]
    """255 on old controllers."""
    max_pwm: Annotated[int, U8(mk="MaxPWM")]
    """255 normal, 250 not running, 40 starting, anything lower: limited."""
    status: Annotated[int, U8(mk="Status")]
    """Bit 7: present; the rest counts I2C errors."""


@request(
    Board.NC,
    "t",
    reply="T",
    firmware="NC 0.30g and later",
    since=(0, 30),
    source=(Source.TOOLS, Source.WIKI),
    policy=Policy(0.4, 0),
    danger=Danger(
        effect="a FlightCtrl reads it as a motor test: only while the last version reply came from a NaviCtrl",
        proven=True,
    ),
)
class TimeRequest(WireMessage):
    """Ask for the GPS time."""

    one: Annotated[int, U8(mk="Interval", low=1, high=1)] = 1


@answer(Board.NC, "T", key="time", firmware="NC 0.30g and later", source=Source.INFERRED)
class NaviTime(WireMessage):
    """GPS time, UTC."""

    year: Annotated[int, U16(mk="Year")]
    month: Annotated[int, U8(mk="Month")]
    day: Annotated[int, U8(mk="Day")]
    hour: Annotated[int, U8(mk="Hour")]
    minute: Annotated[int, U8(mk="Min")]
    second: Annotated[int, U8(mk="Sec")]
    padding_0: Annotated[int, U8(mk="pad0")] = 0
    """From here on the places are inferred: right if the NaviCtrl's compiler pads."""
    millisecond: Annotated[int, U16(mk="mSec", unit=MILLISECOND)]
    valid: Annotated[int, U8(mk="Valid")]
    padding_1: Annotated[int, U8(mk="pad1")] = 0
