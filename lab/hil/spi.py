"""The bus between a FlightCtrl and a NaviCtrl of its generation: the packets of the FlightCtrl.

The FlightCtrl is master: every 20 ms a packet of 34 bytes, beginning with two bytes to find it by, ending with the
sum of all before. What the twelve bytes before the sum say depends on its command, which it sends in a fixed order.
Facts of `spi.c`, `spi.h` of FlightCtrl 0.84.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from enum import IntEnum
from typing import Final

COMPATIBLE: Final = 19
"""Both boards must name it; FlightCtrl 2.12 names 76."""
FROM_FLIGHTCTRL: Final = bytes((0xAA, 0x83))
"""First bytes of a packet."""
_STATUS: Final = struct.Struct("<B9h12s")


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
    *(Word.STICK, Word.USER, Word.PARAMETERS),
    *(Word.STICK, Word.MISC, Word.VERSION),
    *(Word.STICK, Word.SERVOS, Word.BATTERY),
)
"""In which a FlightCtrl says them, one a packet."""


def packet(word: Word, motion: Sequence[int], data: Sequence[int]) -> bytes:
    """A packet of a FlightCtrl.

    Args:
        word: what `data` says.
        motion: pitch, nose down positive, and roll, left side down positive, by the gyros and by the accelerometer,
            and the heading, clockwise from north; the firmware's axes [0.1 deg].
        data: at most twelve bytes; the rest is zero.
    """
    begun = FROM_FLIGHTCTRL + _STATUS.pack(word, *motion, 0, 0, 0, 0, bytes(value & 0xFF for value in data))
    return begun + bytes((sum(begun) & 0xFF,))
