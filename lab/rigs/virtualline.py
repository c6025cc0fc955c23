"""A serial line in virtual time that loses, damages, delays and repeats bytes, and drives procedures across it.

The boards are the simulator's, which are state machines in exact virtual time, so a campaign of a thousand uploads is
the same on every machine and needs no waiting.
"""

from __future__ import annotations

import random
from collections import deque
from dataclasses import dataclass
from typing import Protocol, TypeVar

from mkdaemon.protocol.decoder import MessageDecoder, Unknown
from mkdaemon.protocol.framing import Dropped, Frame, FrameDecoder
from mkdaemon.protocol.procedures.steps import Ask, Pause, Procedure
from mkdaemon.protocol.wire import WireMessage

CHARACTER = 173.6e-6
"""Time of one character, host to board [s]. Source: docs/firmware-notes, "Timing"."""
IDLE_GAP = 5e-3
"""Idle line after a carriage return before the next frame [s]. Source: docs/firmware-notes, "Losses"."""

_SLICE = 2e-3
"""Time the host lets pass between two looks at the line [s]."""

_Result = TypeVar("_Result")


class VirtualBoard(Protocol):
    """A board as the simulator models it: bytes in and out in virtual time."""

    def receive(self, data: bytes, at: float) -> None:
        """Take characters whose first start bit is at `at` [s]."""

    def advance(self, to: float) -> None:
        """Live until `to` [s]."""

    def poll(self) -> list[tuple[float, bytes]]:
        """Hand over what was sent since the last call, each with the time its stop bit ended [s]."""


@dataclass(frozen=True, slots=True)
class Noise:
    """What the line does to bytes and frames, each direction alike.

    Attributes:
        lost: probability that a byte vanishes.
        damaged: probability that a byte becomes another.
        stalled: probability that an answer is held back, by up to `longest_stall`.
        longest_stall: longest time an answer is held back [s]; order is kept.
        repeated: probability that a frame of the board arrives twice.
    """

    lost: float = 0.0
    damaged: float = 0.0
    stalled: float = 0.0
    longest_stall: float = 1.0
    repeated: float = 0.0


class VirtualLine:
    """One host, one port, one board (which may stand for those behind it).

    Attributes:
        asked: requests that were sent.
        now: virtual time [s].
    """

    def __init__(self, board: VirtualBoard, noise: Noise, rng: random.Random) -> None:
        self._board = board
        self._noise = noise
        self._rng = rng
        self._frames = FrameDecoder()
        self._messages = MessageDecoder()
        self._arriving: deque[tuple[float, int]] = deque()
        self._last_frame = bytearray()
        self._held_until = 0.0
        self._after_error = True
        self.now, self.asked = 0.0, 0

    def run(self, procedure: Procedure[_Result]) -> _Result:
        """Drive a procedure to its end.

        Raises:
            MkError: whatever the procedure raised.
        """
        answer: WireMessage | None = None
        while True:
            try:
                step = procedure.send(answer)
            except StopIteration as end:
                return end.value  # type: ignore[no-any-return]  # a generator's value is untyped at run time
            answer = None
            if isinstance(step, Ask):
                answer = self._exchange(step)
            elif isinstance(step, Pause):
                self._wait(self.now + step.seconds, None)

    def _exchange(self, step: Ask) -> WireMessage | None:
        self.asked += 1
        raw = step.message.to_frame(step.board)
        self._send(b"\r\r" + raw if self._after_error else raw)
        answer = self._wait(self.now + step.timeout, step)
        self._after_error = answer is None
        self._wait(self.now + IDLE_GAP, None)
        return answer

    def _send(self, raw: bytes) -> None:
        for byte in raw:
            for heard in self._disturb(byte):
                self._board.receive(bytes((heard,)), self.now)
            self.now += CHARACTER

    def _wait(self, until: float, step: Ask | None) -> WireMessage | None:
        """Let time pass until an acceptable answer or the end; what else arrives is dropped.

        A damaged frame ends the wait when nothing follows it: asking again costs less than the rest of the time-out.
        """
        while True:
            self._collect(min(self.now + _SLICE, until))
            heard = bytearray()
            while self._arriving and self._arriving[0][0] <= self.now:
                heard.append(self._arriving.popleft()[1])
            found = self._frames.feed(bytes(heard))
            for frame in found:
                answer = self._judge(frame, step)
                if answer is not None:
                    return answer
            is_damaged = bool(found) and isinstance(found[-1], Dropped) and found[-1].raw[:1] == b"#"
            if self.now >= until or (step is not None and is_damaged and not self._frames.pending):
                return None

    def _judge(self, found: Frame | Dropped, step: Ask | None) -> WireMessage | None:
        """The answer to `step`, if this frame is it."""
        if step is None or isinstance(found, Dropped) or found.address != step.board:
            return None
        message = self._messages.decode(found)
        return None if isinstance(message, Unknown) or not step.accepts(message) else message

    def _collect(self, until: float) -> None:
        """Let the board live and put what it sent on the way."""
        self._board.advance(until)
        self.now = until
        for t, data in self._board.poll():
            for byte in data:
                self._deliver(t, byte)

    def _deliver(self, t: float, byte: int) -> None:
        if byte == 0x23:
            self._last_frame.clear()
            if self._rng.random() < self._noise.stalled:
                self._held_until = t + self._rng.uniform(0.0, self._noise.longest_stall)
        self._last_frame.append(byte)
        at = max(t, self._held_until, self._arriving[-1][0] if self._arriving else 0.0)
        self._arriving.extend((at, heard) for heard in self._disturb(byte))
        if byte == 0x0D and self._rng.random() < self._noise.repeated:
            self._arriving.extend((at, heard) for copy in self._last_frame for heard in self._disturb(copy))

    def _disturb(self, byte: int) -> tuple[int, ...]:
        """One byte after the line: itself, another, or nothing."""
        chance = self._rng.random()
        if chance < self._noise.lost:
            return ()
        if chance < self._noise.lost + self._noise.damaged:
            return ((byte + self._rng.randrange(1, 256)) & 0xFF,)
        return (byte,)
