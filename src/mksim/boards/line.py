"""The serial line in virtual time: when each character has crossed it.

A character counts as received, or sent, when its stop bit is over. Source: docs/firmware-notes, "Timing".
"""

from __future__ import annotations

from collections import deque
from typing import Final

HOST_CHAR: Final = 10 / 57600
"""One character at 57600 baud 8N1, 173.6 us: host to board, and NaviCtrl to host."""

FC_CHAR: Final = 182e-6
"""One character from a FlightCtrl: its divider gives 58139 baud and it pauses between characters."""


class Inbound:
    """Characters on their way to a board: what is written at once still arrives one character time apart."""

    __slots__ = ("_arrivals", "_free_at")

    def __init__(self) -> None:
        self._arrivals: deque[tuple[float, int]] = deque()
        self._free_at = 0.0

    def write(self, data: bytes, at: float) -> None:
        """Put characters on the line at `at` [s], or behind those still crossing it."""
        free = max(self._free_at, at)
        for count, byte in enumerate(data, 1):
            self._arrivals.append((free + count * HOST_CHAR, byte))
        self._free_at = free + len(data) * HOST_CHAR

    def write_arrived(self, byte: int, at: float) -> None:
        """Add one character that has just arrived, with its time [s]."""
        self._arrivals.append((at, byte))
        self._free_at = max(self._free_at, at)

    @property
    def next_at(self) -> float | None:
        """When the next character will have arrived [s]; None when the line is idle."""
        return self._arrivals[0][0] if self._arrivals else None

    def take(self, until: float) -> list[tuple[float, int]]:
        """Remove and return the characters that have arrived by `until`, each with its time [s]."""
        arrivals = self._arrivals
        taken: list[tuple[float, int]] = []
        while arrivals and arrivals[0][0] <= until:
            taken.append(arrivals.popleft())
        return taken


class Outbound:
    """Characters leaving a board, each with the time its stop bit ends."""

    __slots__ = ("_char_time", "_queue", "busy_until")

    def __init__(self, char_time: float) -> None:
        self._char_time = char_time
        self._queue: deque[tuple[float, int]] = deque()
        self.busy_until = 0.0

    def send(self, data: bytes, at: float) -> float:
        """Send characters from `at` [s] on, or right behind those being sent; return when the last is out."""
        start = max(at, self.busy_until)
        self._queue.extend((start + count * self._char_time, byte) for count, byte in enumerate(data, 1))
        self.busy_until = start + len(data) * self._char_time
        return self.busy_until

    def cut(self, at: float) -> bytes:
        """Take back what has not begun to leave by `at`; the character being shifted out still completes."""
        kept = at + self._char_time
        tail: list[int] = []
        while self._queue and self._queue[-1][0] > kept:
            tail.append(self._queue.pop()[1])
        self.busy_until = self._queue[-1][0] if self._queue else min(self.busy_until, at)
        return bytes(reversed(tail))

    def take(self, until: float) -> list[tuple[float, bytes]]:
        """Remove and return the characters that are out by `until`, each with its time [s]."""
        queue = self._queue
        taken: list[tuple[float, bytes]] = []
        while queue and queue[0][0] <= until:
            at, byte = queue.popleft()
            taken.append((at, bytes((byte,))))
        return taken


class BoardPort:
    """The serial port of a board: what both boards have in common towards the line.

    Attributes:
        now: time up to which the board has run [s].
    """

    def __init__(self, char_time: float) -> None:
        """Open the port of a board whose characters take `char_time` [s]."""
        self.now = 0.0
        self._line = Inbound()
        self._out = Outbound(char_time)

    def receive(self, data: bytes, at: float) -> None:
        """Take characters put on the line at `at` [s]; they arrive one after the other."""
        self._line.write(data, at)

    def receive_byte(self, byte: int, at: float) -> None:
        """Take one character whose stop bit was over at `at` [s]."""
        self._line.write_arrived(byte, at)

    def poll(self) -> list[tuple[float, bytes]]:
        """Return the characters that have left the board, each with its time [s]."""
        return self._out.take(self.now)
