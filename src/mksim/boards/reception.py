"""How the two boards receive: what each loses, keeps and misreads.

The FlightCtrl has one buffer and an interrupt routine that ignores everything while a frame waits in it; inside a frame
it takes `#` for data. The NaviCtrl has a hardware FIFO, a ring and then one frame buffer, and restarts at every `#`.
Both decode in place, once per encoded character instead of once per group, so a command that reads more than was sent
sees decoded checksum characters and what older frames left behind. Source: docs/firmware-notes, "Losses" and "Sending".
"""

from __future__ import annotations

from collections import deque
from typing import Final

_CR: Final = 0x0D
_HASH: Final = 0x23
_PAYLOAD_AT: Final = 3

NC_BUFFER: Final = 150
NC_RING: Final = 512
NC_FIFO_LEVEL: Final = 8
"""Characters in the NaviCtrl's hardware FIFO at which it interrupts."""
NC_FIFO_TIMEOUT: Final = 0.56e-3
"""Silence after which fewer characters are handed over."""


class FrameBuffer:
    """The one frame buffer of a board: its old contents show through requests that are too short."""

    __slots__ = ("bytes", "length")

    def __init__(self, size: int) -> None:
        # a wrong length makes the decoder read a third further than the frame
        self.bytes = bytearray(size + size // 3 + 16)
        self.length = 0

    @property
    def address(self) -> int:
        """Board address asked for; 0 means any."""
        return self.bytes[1] - 0x61

    @property
    def command(self) -> str:
        """The command letter."""
        return chr(self.bytes[2])

    @property
    def encoded_length(self) -> int:
        """Number of payload characters."""
        return max(self.length - 6, 0)

    def has_right_checksum(self) -> bool:
        """Whether the two characters before the CR match the sum of those before them."""
        end = self.length - 3
        if end < 0:
            return False
        total = sum(self.bytes[:end]) & 0xFFF
        return self.bytes[end] == 0x3D + (total >> 6) and self.bytes[end + 1] == 0x3D + (total & 63)

    def decode_in_place(self) -> None:
        """Overwrite the payload characters with what the firmware makes of them."""
        data = self.bytes
        source = target = _PAYLOAD_AT
        left = self.encoded_length
        while left > 0:
            a, b, c, d = ((value - 0x3D) & 0xFF for value in data[source : source + 4])
            source += 4
            for value in ((a << 2) | (b >> 4), ((b & 15) << 4) | (c >> 2), ((c & 3) << 6) | d):
                if left == 0:
                    return
                data[target] = value & 0xFF
                target += 1
                left -= 1

    def payload(self, size: int) -> bytes:
        """What a command that reads `size` bytes finds, garbage included."""
        return bytes(self.bytes[_PAYLOAD_AT : _PAYLOAD_AT + size])


class FcReceiver:
    """The FlightCtrl's receive interrupt: three states, no time-out, deaf while a frame waits."""

    __slots__ = ("_at", "_size", "_state", "buffer", "has_frame")

    def __init__(self, size: int) -> None:
        self.buffer = FrameBuffer(size)
        self.has_frame = False
        self._size = size
        self._state = 0
        self._at = 0

    def take(self, byte: int) -> bool:
        """Take one character; return whether it completed a frame."""
        data = self.buffer.bytes
        if self._at >= self._size:
            self._state = 0
        if self._state == 2 and byte == _CR:
            self._state = 0
            return self._close()
        if self._state == 0:
            if byte == _HASH and not self.has_frame:
                self._state = 1
            if not self.has_frame:
                data[0] = byte
            self._at = 1
            return False
        data[self._at] = byte
        self._at += 1
        self._state = 2
        return False

    def _close(self) -> bool:
        buffer = self.buffer
        length, buffer.length = buffer.length, self._at + 1
        if self._at < 5 or not buffer.has_right_checksum():
            buffer.length = length
            return False
        buffer.bytes[self._at] = _CR
        self.has_frame = True
        return True

    def release(self) -> None:
        """The main loop has handled the frame: listen again."""
        self.has_frame = False


class HardwareFifo:
    """Characters of a NaviCtrl's UART, handed over when there are enough of them, or none follows for a while."""

    __slots__ = ("_held", "_last_at")

    def __init__(self) -> None:
        self._held: list[int] = []
        self._last_at = 0.0

    def take(self, at: float, byte: int) -> list[tuple[float, int]]:
        """Take a character; those handed over until then, each with the time of that [s]."""
        handed = self.settle(at)
        self._held.append(byte)
        self._last_at = at
        if len(self._held) < NC_FIFO_LEVEL:
            return handed
        return handed + self._hand_over(at)

    @property
    def timeout_at(self) -> float | None:
        """When its time-out will hand over what it holds [s]; None while it is empty."""
        return self._last_at + NC_FIFO_TIMEOUT if self._held else None

    def settle(self, now: float) -> list[tuple[float, int]]:
        """Let the time-out act up to `now` [s]; what it hands over."""
        at = self.timeout_at
        return [] if at is None or at > now else self._hand_over(at)

    def _hand_over(self, at: float) -> list[tuple[float, int]]:
        handed = [(at, byte) for byte in self._held]
        self._held.clear()
        return handed


class NcReceiver:
    """The NaviCtrl's FIFO, ring and frame collector.

    Attributes:
        has_frame: a whole frame waits for the main loop.
        overflowed: characters lost because the ring was full.
        handed_at: when the FIFO last gave characters to the ring [s].
    """

    __slots__ = ("_at", "_fifo", "_ring", "buffer", "handed_at", "has_frame", "overflowed")

    def __init__(self) -> None:
        self.buffer = FrameBuffer(NC_BUFFER)
        self.has_frame = False
        self.overflowed = 0
        self.handed_at = 0.0
        self._fifo = HardwareFifo()
        self._ring: deque[int] = deque()
        self._at = 0

    def take(self, at: float, byte: int) -> None:
        """Take one character from the line; hand the FIFO over when it reaches its level."""
        self._keep(self._fifo.take(at, byte))

    @property
    def timeout_at(self) -> float | None:
        """When the FIFO's time-out will hand over what it holds [s]; None while it is empty."""
        return self._fifo.timeout_at

    def settle(self, now: float) -> None:
        """Let the FIFO's time-out act up to `now`."""
        self._keep(self._fifo.settle(now))

    def _keep(self, handed: list[tuple[float, int]]) -> None:
        for at, byte in handed:
            self.handed_at = at
            if len(self._ring) < NC_RING:
                self._ring.append(byte)
            else:
                self.overflowed += 1

    @property
    def has_work(self) -> bool:
        """Whether the main loop would find something to do."""
        return self.has_frame or bool(self._ring)

    def collect(self) -> bool:
        """Move characters from the ring until a frame is complete; return whether one is."""
        while self._ring and not self.has_frame:
            self.has_frame = self._collect(self._ring.popleft())
        return self.has_frame

    def _collect(self, byte: int) -> bool:
        buffer = self.buffer
        if byte == _HASH:
            buffer.bytes[0] = byte
            self._at = 1
            return False
        if self._at == 0:
            return False
        if self._at >= NC_BUFFER:
            self._at = 0
            return False
        buffer.bytes[self._at] = byte
        self._at += 1
        if byte != _CR:
            return False
        buffer.length, self._at = self._at, 0
        return buffer.length >= 6 and buffer.has_right_checksum()

    def release(self) -> None:
        """The frame has been handled."""
        self.has_frame = False
