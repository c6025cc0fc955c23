"""Times of characters on the wire, and the least distance of frames: pure arithmetic.

Source of every figure: docs/firmware-notes, "Timing" and "Losses", measured on genuine firmware.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from mkdaemon.protocol.wire import Board

BITS_PER_CHARACTER: Final = 10
"""Start bit, eight data bits, stop bit."""
FC_CHARACTER: Final = 182e-6
"""A FlightCtrl leaves gaps between the characters it sends [s at 57600 baud]."""
FC_GAP: Final = 0.012
"""Idle line a FlightCtrl needs after a CR [s]. It has one receive buffer, and in flight its main loop passes over the
serial part whenever the regulator took longer than 2 ms: a frame behind 5 ms of idle line was lost in 9 of 100 cases,
behind 12 ms in none of 950. At rest 2.25 ms lost none of 800."""
FORWARDING_GAP: Final = 0.025
"""Between external control frames a NaviCtrl 0.24 passes on byte by byte: none of 40 Hz lost, half of 50 Hz [s]."""
RESYNC: Final = b"\r\r"
"""Ends whatever a receiver may hold: a FlightCtrl does not restart at `#`."""


@dataclass(frozen=True, slots=True)
class LineRules:
    """Limits of the line and of its boards.

    Attributes:
        baud: line rate [baud].
        direct: the board the host's wire ends at.
        gap: idle line after each frame that reaches a FlightCtrl [s].
        setpoint_interval: least time between the beginnings of two external control frames [s].
    """

    baud: int = 57600
    direct: Board = Board.ANY
    gap: float = FC_GAP
    setpoint_interval: float = 0.01

    def wire_time(self, raw: bytes) -> float:
        """Time bytes from the host take [s]."""
        return len(raw) * BITS_PER_CHARACTER / self.baud

    def reply_time(self, characters: int) -> float:
        """Time characters from the direct board take [s]; a FlightCtrl is 4.8 % slower than nominal."""
        slow = FC_CHARACTER * 5760 if self.direct is Board.FC else 1.0
        return characters * BITS_PER_CHARACTER / self.baud * slow

    def gap_after(self, *, reaches_fc: bool) -> float:
        """Idle line after a frame [s].

        A NaviCtrl buffers 512 characters and needs none; before the first answer the board is unknown, so the
        careful rule holds.
        """
        if self.direct is Board.NC and not reaches_fc:
            return 0.0
        return self.gap
