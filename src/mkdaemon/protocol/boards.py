"""Addresses on the line, and which way a message travels."""

from __future__ import annotations

from enum import IntEnum, StrEnum
from typing import Final


class Board(IntEnum):
    """Addresses on the line."""

    ANY = 0
    FC = 1
    NC = 2
    MAG = 3
    OSD = 4
    BL = 5

    @property
    def word(self) -> str:
        """Lower-case name used in keys and files."""
        return self.name.lower()


REDUNDANCY_ADDRESSES: Final = range(11, 27)
"""Addresses of motor controllers 1..16 on a redundant FlightCtrl's link: 11 + motor index."""


def board_at(address: int) -> Board | None:
    """Return whose an address is; None where no board has it."""
    if 0 <= address <= Board.BL:
        return Board(address)
    return Board.BL if address in REDUNDANCY_ADDRESSES else None


class Direction(StrEnum):
    """Which way bytes and messages travel, in the words of captures and keys, seen from the host."""

    TO_BOARD = "tx"
    FROM_BOARD = "rx"
