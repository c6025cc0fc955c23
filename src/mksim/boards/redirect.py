"""The NaviCtrl's UART redirection: after `u` the host talks to another board, until five raw bytes end it.

Source: docs/firmware-notes, "Sending" 4; docs/protocol.md, "NaviCtrl commands".
"""

from __future__ import annotations

from typing import Final

from mksim.boards.line import HOST_CHAR, BoardPort, Outbound

ESCAPE: Final = b"\x1b\x1b\x55\xaa\x00"
TO_FLIGHTCTRL: Final = 0
TO_COMPASS: Final = 1
TO_GPS: Final = 2
STOPS_SERVOS: Final = (TO_FLIGHTCTRL, TO_GPS)
"""Targets whose UART needs the timer of the camera servos."""
_TEXT: Final = {
    TO_FLIGHTCTRL: b"\r\r\n UART2 init...ok\r\n Timer2 deinit...ok",
    TO_COMPASS: b"",
    TO_GPS: b"\r\n Timer2 deinit...ok",
}
"""Plain text the board prints when it connects."""


class Redirection:
    """Where the host's characters go, and the match of the escape sequence.

    Attributes:
        target: None, or the board the host talks to.
    """

    SETTLE_TIME: Final = 2e-3
    """Characters within this time after the escape are lost."""

    def __init__(self, flight: BoardPort, out: Outbound) -> None:
        self._flight = flight
        self._out = out
        self._matched = 0
        self._tail = b""
        self.target: int | None = None

    @property
    def is_on(self) -> bool:
        """Whether the host talks to another board."""
        return self.target is not None

    def start(self, target: int, now: float) -> None:
        """Connect; a frame being sent is cut, its tail comes after the escape."""
        self._tail = self._out.cut(now)
        self._matched = 0
        self._flight.poll()
        self.target = target
        self._out.send(_TEXT[target], now)

    def take(self, byte: int, at: float) -> bool:
        """Pass one character on; return whether the escape sequence is complete."""
        # a mismatch starts over without looking back: three ESC in a row break the match, as on the board
        self._matched = self._matched + 1 if byte == ESCAPE[self._matched] else 0
        if self.target == TO_FLIGHTCTRL:
            self._flight.receive_byte(byte, at + HOST_CHAR)
        if self._matched < len(ESCAPE):
            return False
        self.carry(at)
        self.target = None
        self._matched = 0
        self._out.send(self._tail, at)
        return True

    def carry(self, until: float) -> None:
        """Bring what the FlightCtrl said to the host, or throw it away."""
        for at, data in self._flight.poll():
            if self.target == TO_FLIGHTCTRL and at <= until:
                self._out.send(data, at)
