"""FlightCtrl: motors, receiver channels, compass, and the commands of a public fork.

Source: docs/protocol.md, "FlightCtrl commands"; firmware notes 7.
"""

from __future__ import annotations

from typing import Annotated

from mkdaemon.protocol.fields import S8, S16, U8
from mkdaemon.protocol.units import DEG, STICK
from mkdaemon.protocol.wire import Board, WireMessage, answer, request


@request(
    Board.FC,
    "K",
    firmware="all",
    source="WIRE 7, CompassHeading",
    danger="falsifies the heading until the compass speaks again",
    any_address=True,
)
class CompassHeading(WireMessage):
    """Tell the FlightCtrl its heading, as a MK3Mag does."""

    heading: Annotated[int, S16(mk="Heading", unit=DEG, low=-1, high=360)]
    """0..360 clockwise from magnetic north; negative: invalid."""


@request(
    Board.FC,
    "t",
    layout="16",
    reply="T",
    firmware="FC 0.73 and later",
    source="WIRE 7, MotorTest16",
    danger="spins motors for 0.5 s; values sent while motors run take effect right after they stop",
    since=(0, 73),
    any_address=True,
)
class MotorTest(WireMessage):
    """Turn motors on the ground; repeat at 5 to 20 Hz to keep them turning."""

    motors: Annotated[tuple[int, ...], U8(mk="Motor", count=16)]
    """Set points of motors 1..16."""


@request(
    Board.FC,
    "t",
    name="MotorTest",
    layout="4",
    reply="T",
    firmware="FC",
    source="WIRE 7, MotorTest4",
    danger="spins motors for 0.5 s; short frames are filled with checksum characters by the board",
    any_address=True,
)
class MotorTest4(WireMessage):
    """Turn motors 1..4 on the ground: for reading old traffic; the long form is sent."""

    motors: Annotated[tuple[int, ...], U8(mk="Motor", count=4)]


@answer(Board.FC, "T", firmware="FC; gone in 0.71h, back in 2.x: optional", source='WIRE 7; vector "motor test reply"')
class MotorTestDone(WireMessage):
    """A motor test was taken."""


@request(Board.FC, "p", reply="P", firmware="FC", source="WIRE 7")
class ReceiverRequest(WireMessage):
    """Ask for all channels the FlightCtrl receives."""


@answer(
    Board.FC,
    "P",
    name="Receiver",
    layout="200",
    firmware="FC 0.91, 2.00a and later",
    source="WIRE 7, PPM_200",
    since=(0, 91),
)
class Receiver200(WireMessage):
    """Channels the FlightCtrl receives."""

    channels: Annotated[tuple[int, ...], S16(mk="PPM", unit=STICK, count=35)]
    """0 RSSI, 1..16 receiver, 17..28 serial, 29 waypoint event, 30 lowest, 31 highest, 32 middle, 33..34 spare."""


@answer(
    Board.FC, "P", name="Receiver", layout="077", firmware="FC 0.77 to 0.90", source="WIRE 7, PPM_077", since=(0, 77)
)
class Receiver077(WireMessage):
    """Channels the FlightCtrl receives."""

    channels: Annotated[tuple[int, ...], S16(mk="PPM", unit=STICK, count=25)]
    """0 RSSI, 1..12 receiver, 13..24 serial (the split is inferred)."""


@answer(Board.FC, "P", name="Receiver", layout="071", firmware="FC 0.71 to 0.76", source="WIRE 7, PPM_071")
class Receiver071(WireMessage):
    """Channels the FlightCtrl receives."""

    channels: Annotated[tuple[int, ...], S16(mk="PPM", unit=STICK, count=11)]
    """0 unused or RSSI, 1..10 receiver."""


@request(
    (Board.FC, Board.NC),
    "y",
    firmware="FC 0.77 and later; NC 0.24 forwards FC-addressed ones, NC 2.13 and later takes them itself",
    source="WIRE 7, SerialPoti",
    danger="drives any function mapped to a serial channel: GPS mode, care-free, motor switch",
    since={Board.FC: (0, 77), Board.NC: (2, 13)},
)
class SerialChannels(WireMessage):
    """Set the serial channels; they become selectable channels 17..28 (2.x) or 13..24 (0.77 to 0.90)."""

    channels: Annotated[tuple[int, ...], S8(mk="Value", unit=STICK, limit=127, count=12)]


@request(
    Board.FC,
    "j",
    firmware="FC 0.82 and later",
    source="WIRE 7, ReceiverPassthrough",
    danger="turns the port into a bridge to the receiver until power-off; the FlightCtrl stops working",
    since=(0, 82),
)
class ReceiverBridge(WireMessage):
    """Hand the port to the receiver, for its firmware update."""

    mode: Annotated[int, U8(mk="Mode")]
    """1 JetiBox, 100 HoTT update at 19200 baud, anything else receiver update at 38400 baud."""


_FORK = "a public fork of FC 2.12a and 2.00a"


@request(Board.FC, "x", firmware=_FORK, source="WIRE 7; firmware notes 1", danger="starts the motors", is_fork=True)
class ArmMotors(WireMessage):
    """Start the motors; needs a calibration and no errors."""


@request(
    Board.FC,
    "e",
    firmware=_FORK,
    source="WIRE 7; firmware notes 1",
    danger="stops the motors, in flight too",
    is_fork=True,
)
class DisarmMotors(WireMessage):
    """Stop the motors."""


@request(
    Board.FC,
    "r",
    firmware=_FORK,
    source="WIRE 7; firmware notes 1",
    danger="recalibrates the sensors; the FlightCtrl is deaf for 1.5 s",
    is_fork=True,
)
class Recalibrate(WireMessage):
    """Calibrate gyros or accelerometers."""

    what: Annotated[int, U8(mk="mode", low=1, high=2)]


@request(
    Board.FC,
    "o",
    firmware=_FORK,
    source="WIRE 7; firmware notes 1",
    danger="the FlightCtrl is deaf for 0.24 to 2.5 s",
    is_fork=True,
)
class Beep(WireMessage):
    """Sound the buzzer."""

    duration: Annotated[int, S16(mk="duration", low=1)]
    count: Annotated[int, U8(mk="count", low=1)]


@request(
    (Board.FC, Board.NC),
    "R",
    firmware="all",
    source="WIRE 12",
    danger="reboots the board: FC up to 2.00a and NC 0.24 even in flight, the NC into its boot loader",
    any_address=True,
)
class Reset(WireMessage):
    """Reboot."""
