"""The bus between a FlightCtrl and a NaviCtrl of its generation: what crosses it, both ways.

The FlightCtrl is master: every 20 ms a packet of 34 bytes, each beginning with two bytes to find it by, ending with the
sum of all before. The NaviCtrl's packets of as many bytes leave with the same clock, on their own grid. What the twelve
bytes at the end of a packet say depends on its command, which both send in a fixed order. Facts of `spi.c`, `spi.h` of
FlightCtrl 0.84 and of `spi_slave.h` of NaviCtrl 0.24.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Final

COMPATIBLE: Final = 19
"""Both boards must name it; FlightCtrl 2.12 names 76."""
PARAMETER_BYTES: Final = 12
FROM_FLIGHTCTRL: Final = bytes((0xAA, 0x83))
FROM_NAVICTRL: Final = bytes((0x81, 0x55))
"""First bytes of a packet."""
_STATUS: Final = struct.Struct("<B9h12s")
_REPLY: Final = struct.Struct("<B3h5hH12s")
PACKET: Final = 2 + _STATUS.size + 1
"""Length either way [byte]."""


class Word(IntEnum):
    """What the last bytes of a FlightCtrl's packet say."""

    USER = 10
    STICK = 11
    MISC = 12
    PARAMETERS = 13
    VERSION = 14
    SERVOS = 15
    BATTERY = 16


ORDER: Final = (
    Word.STICK,
    Word.USER,
    Word.PARAMETERS,
    Word.STICK,
    Word.MISC,
    Word.VERSION,
    Word.STICK,
    Word.SERVOS,
    Word.BATTERY,
)
"""In which a FlightCtrl says them, one a packet."""


class Answer(IntEnum):
    """What the last bytes of a NaviCtrl's packet say."""

    KALMAN = 103
    VERSION = 104
    GPS = 105


@dataclass(frozen=True, slots=True)
class Motion:
    """What every packet of a FlightCtrl says of the aircraft; the firmware's axes.

    Attributes:
        pitch: nose down positive [0.1 deg].
        roll: left side down positive [0.1 deg].
        acc_pitch: tilt by the accelerometer, as pitch [0.1 deg].
        acc_roll: as roll [0.1 deg].
        heading: by the gyros, clockwise from north [0.1 deg].
        yaw_rate: of the gyro [count].
    """

    pitch: int
    roll: int
    acc_pitch: int
    acc_roll: int
    heading: int
    yaw_rate: int = 0


@dataclass(frozen=True, slots=True)
class Reply:
    """A packet of a NaviCtrl.

    Attributes:
        answer: what `data` says.
        pitch: that it asks for [count].
        roll: that it asks for [count].
        yaw: that it asks for [count].
        heading: of its compass [deg]; negative without one.
        field: magnetic, three axes [count].
        beep: how long the FlightCtrl is to beep [ms].
        data: twelve bytes.
    """

    answer: int
    pitch: int
    roll: int
    yaw: int
    heading: int
    field: tuple[int, int, int]
    beep: int
    data: bytes


def packet(word: Word, motion: Motion, data: Sequence[int]) -> bytes:
    """A packet of a FlightCtrl.

    Args:
        word: what `data` says.
        motion: of the aircraft.
        data: at most twelve bytes; the rest is zero.
    """
    said = bytes(value & 0xFF for value in data).ljust(PARAMETER_BYTES, b"\0")
    m = motion
    body = _STATUS.pack(word, m.pitch, m.roll, m.acc_pitch, m.acc_roll, m.heading, 0, 0, m.yaw_rate, 0, said)
    return closed(FROM_FLIGHTCTRL + body)


def closed(begun: bytes) -> bytes:
    """A packet with its sum behind it."""
    return begun + bytes((sum(begun) & 0xFF,))


class Replies:
    """Finds the packets of a NaviCtrl in the bytes that come one by one.

    Attributes:
        refused: packets whose sum was wrong.
    """

    def __init__(self) -> None:
        self._begun = bytearray()
        self.refused = 0

    def take(self, byte: int) -> Reply | None:
        """Take a byte; the packet that it ends."""
        begun = self._begun
        place = len(begun)
        begun.append(byte)
        if place < len(FROM_NAVICTRL) and byte != FROM_NAVICTRL[place]:
            begun.clear()
        if len(begun) < PACKET:
            return None
        whole = bytes(begun)
        begun.clear()
        if closed(whole[:-1]) != whole:
            self.refused += 1
            return None
        answer, pitch, roll, yaw, heading, x, y, z, _, beep, data = _REPLY.unpack(whole[2:-1])
        return Reply(answer, pitch, roll, yaw, heading, (x, y, z), beep, data)
