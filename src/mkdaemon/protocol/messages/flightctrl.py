"""FlightCtrl: motors, receiver channels, compass, and the commands of a public fork.

Source: docs/protocol.md, "FlightCtrl commands"; docs/firmware-notes.md, section 7.
"""

from __future__ import annotations

from typing import Annotated

from mkdaemon.protocol.fields import S8, S16, U8
from mkdaemon.protocol.sources import Source
from mkdaemon.protocol.spec import Policy
from mkdaemon.protocol.units import DEG, STICK
from mkdaemon.protocol.wire import Board, WireMessage, answer, request
from mkdaemon.telemetry.danger import Confirm, Danger, Switch


@request(
    Board.FC,
    "K",
    firmware="all",
    source=Source.FC_RECEIVE,
    danger=Danger(
        effect="falsifies the heading until the compass speaks again", confirm=Confirm.ALWAYS, stopped=True, proven=True
    ),
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
    since=(0, 73),
    source=Source.FC_RECEIVE,
    policy=Policy(0.2, 0),
    danger=Danger(
        effect="spins motors for 0.5 s; values sent while motors run take effect right after they stop",
        stopped=True,
        proven=True,
        confirm=Confirm.ALWAYS,
        harmless=("motors", (0,) * 16),
        turns_motors=True,
    ),
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
    source=Source.FC_RECEIVE,
    policy=Policy(0.2, 0),
    danger=Danger(
        effect="spins motors for 0.5 s; short frames are filled with checksum characters by the board",
        stopped=True,
        proven=True,
        confirm=Confirm.ALWAYS,
        harmless=("motors", (0,) * 4),
        turns_motors=True,
    ),
    any_address=True,
)
class MotorTest4(WireMessage):
    """Turn motors 1..4 on the ground: for reading old traffic; the long form is sent."""

    motors: Annotated[tuple[int, ...], U8(mk="Motor", count=4)]


@answer(Board.FC, "T", firmware="FC; gone in 0.71h, back in 2.x: optional", source=Source.FC_SEND)
class MotorTestDone(WireMessage):
    """A motor test was taken."""


@request(Board.FC, "p", reply="P", firmware="FC", source=Source.FC_RECEIVE, policy=Policy(0.2, 3))
class ReceiverRequest(WireMessage):
    """Ask for all channels the FlightCtrl receives."""


@answer(
    Board.FC,
    "P",
    name="Receiver",
    layout="200",
    firmware="FC 0.91, 2.00a and later",
    since=(0, 91),
    source=Source.FC_SEND,
    tells_firmware=True,
)
class Receiver200(WireMessage):
    """Channels the FlightCtrl receives."""

    channels: Annotated[tuple[int, ...], S16(mk="PPM", unit=STICK, count=35)]
    """0 RSSI, 1..16 receiver, 17..28 serial, 29 waypoint event, 30 lowest, 31 highest, 32 middle, 33..34 spare."""


@answer(
    Board.FC,
    "P",
    name="Receiver",
    layout="077",
    firmware="FC 0.77 to 0.90",
    since=(0, 77),
    source=Source.CHANGE_LOG,
    tells_firmware=True,
)
class Receiver077(WireMessage):
    """Channels the FlightCtrl receives."""

    channels: Annotated[tuple[int, ...], S16(mk="PPM", unit=STICK, count=25)]
    """0 RSSI, 1..12 receiver, 13..24 serial (the split is inferred)."""


@answer(
    Board.FC, "P", name="Receiver", layout="071", firmware="FC 0.71 to 0.76", source=Source.WIKI, tells_firmware=True
)
class Receiver071(WireMessage):
    """Channels the FlightCtrl receives."""

    channels: Annotated[tuple[int, ...], S16(mk="PPM", unit=STICK, count=11)]
    """0 unused or RSSI, 1..10 receiver."""


@request(
    (Board.FC, Board.NC),
    "y",
    firmware="FC 0.77 and later; NC 0.24 forwards FC-addressed ones, NC 2.13 and later takes them itself",
    since={Board.FC: (0, 77), Board.NC: (2, 13)},
    source=(Source.FC_RECEIVE, Source.NC_RECEIVE),
    danger=Danger(
        effect="drives any function mapped to a serial channel: GPS mode, care-free, motor switch",
        confirm=Confirm.ALWAYS,
    ),
    is_forwarded=True,
)
class SerialChannels(WireMessage):
    """Set the serial channels; they become selectable channels 17..28 (2.x) or 13..24 (0.77 to 0.90)."""

    channels: Annotated[tuple[int, ...], S8(mk="Value", unit=STICK, limit=127, count=12)]


@request(
    Board.FC,
    "j",
    firmware="FC 0.82 and later",
    since=(0, 82),
    source=Source.FC_RECEIVE,
    danger=Danger(
        effect="turns the port into a bridge to the receiver until power-off; the FlightCtrl stops working",
        confirm=Confirm.ALWAYS,
        stopped=True,
        proven=True,
        switch=Switch.RECEIVER_BRIDGE,
    ),
)
class ReceiverBridge(WireMessage):
    """Hand the port to the receiver, for its firmware update."""

    mode: Annotated[int, U8(mk="Mode")]
    """1 JetiBox, 100 HoTT update at 19200 baud, anything else receiver update at 38400 baud."""


_FORK = "a public fork of FC 2.12a and 2.00a"


@request(
    Board.FC,
    "x",
    firmware=_FORK,
    source=Source.FC_FORK,
    policy=Policy(0.3, 0),
    danger=Danger(
        effect="starts the motors", confirm=Confirm.ALWAYS, stopped=True, proven=True, switch=Switch.FORK_ARMING
    ),
    is_fork=True,
)
class ArmMotors(WireMessage):
    """Start the motors; needs a calibration and no errors."""


# A running motor must not prevent that it is stopped.
@request(
    Board.FC,
    "e",
    firmware=_FORK,
    source=Source.FC_FORK,
    policy=Policy(0.3, 0, deaf=0.85),
    danger=Danger(
        effect="stops the motors, in flight too", confirm=Confirm.ALWAYS, proven=True, switch=Switch.FORK_ARMING
    ),
    is_fork=True,
)
class DisarmMotors(WireMessage):
    """Stop the motors."""


@request(
    Board.FC,
    "r",
    firmware=_FORK,
    source=Source.FC_FORK,
    policy=Policy(0.3, 0, deaf=1.5),
    danger=Danger(
        effect="recalibrates the sensors; the FlightCtrl is deaf for 1.5 s",
        confirm=Confirm.ALWAYS,
        stopped=True,
        proven=True,
        switch=Switch.FORK_ARMING,
    ),
    is_fork=True,
)
class Recalibrate(WireMessage):
    """Calibrate gyros or accelerometers."""

    what: Annotated[int, U8(mk="mode", low=1, high=2)]


@request(
    Board.FC,
    "o",
    firmware=_FORK,
    source=Source.FC_FORK,
    policy=Policy(0.3, 0, deaf=2.5),
    danger=Danger(
        effect="the FlightCtrl is deaf for 0.24 to 2.5 s",
        confirm=Confirm.ALWAYS,
        stopped=True,
        proven=True,
        switch=Switch.FORK_ARMING,
    ),
    is_fork=True,
)
class Beep(WireMessage):
    """Sound the buzzer."""

    duration: Annotated[int, S16(mk="duration", low=1)]
    """Of each beep, and of the pause after it [ms of the board]."""
    count: Annotated[int, U8(mk="count", low=1)]

    @property
    def deaf_time(self) -> float:
        """Time in which the board is deaf [s]; 2.16 s measured for twice 500 ms. Nothing but power-off ends it."""
        return 0.084 + 2 * self.duration * self.count * 1.038e-3


@request(
    (Board.FC, Board.NC),
    "R",
    firmware="all",
    source=(Source.FC_RECEIVE, Source.NC_RECEIVE),
    policy=Policy(0.3, 0, deaf=5.25),
    danger=Danger(
        effect="reboots the board: FC up to 2.00a and NC 0.24 even in flight, the NC into its boot loader",
        confirm=Confirm.ALWAYS,
        stopped=True,
        proven=True,
        switch=Switch.RESET,
    ),
    any_address=True,
)
class Reset(WireMessage):
    """Reboot."""
