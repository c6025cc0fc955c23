"""The state of a NaviCtrl: what its commands change and its replies read. `navictrl` runs its main loop over it.

Part of it is the UART redirection: after `u` the host talks to another board, until five raw bytes end it.

Source: docs/firmware-notes, "Sending" 4; docs/protocol.md, "NaviCtrl commands".
"""

from __future__ import annotations

import math
import random
from typing import Final

from mksim.boards.display import MenuPages
from mksim.boards.flightctrl import FlightCtrl
from mksim.boards.generations import NcFirmware
from mksim.boards.line import HOST_CHAR, BoardPort, Outbound
from mksim.boards.navigator import Navigator
from mksim.boards.reception import HardwareFifo, NcReceiver

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
        self._begin()
        self.target: int | None = None

    def _begin(self) -> None:
        """Both ways pass through a FIFO and a UART's transmitter."""
        self._out_fifo, self._back_fifo = HardwareFifo(), HardwareFifo()
        self._free_at = 0.0

    @property
    def is_on(self) -> bool:
        """Whether the host talks to another board."""
        return self.target is not None

    def start(self, target: int, now: float) -> None:
        """Connect; a frame being sent is cut, its tail comes after the escape."""
        self._tail = self._out.cut(now)
        self._matched = 0
        self._flight.poll()
        self._begin()
        self.target = target
        self._out.send(_TEXT[target], now)

    def take(self, byte: int, at: float) -> bool:
        """Pass one character on; return whether the escape sequence is complete."""
        # a mismatch starts over without looking back: three ESC in a row break the match, as on the board
        self._matched = self._matched + 1 if byte == ESCAPE[self._matched] else 0
        self._pass_on(self._out_fifo.take(at, byte))
        if self._matched < len(ESCAPE):
            return False
        self.carry(at)
        self.target = None
        self._matched = 0
        self._out.send(self._tail, at)
        return True

    @property
    def timeout_at(self) -> float | None:
        """When what came from the host last is passed on although too little followed [s]."""
        return self._out_fifo.timeout_at if self.is_on else None

    def settle(self, now: float) -> None:
        """Let that time-out act."""
        self._pass_on(self._out_fifo.settle(now))

    def _pass_on(self, handed: list[tuple[float, int]]) -> None:
        for at, byte in handed if self.target == TO_FLIGHTCTRL else ():
            self._free_at = max(self._free_at, at) + HOST_CHAR
            self._flight.receive_byte(byte, self._free_at)

    def carry(self, until: float) -> None:
        """Bring what the FlightCtrl said to the host, or throw it away."""
        for at, data in self._flight.poll():
            if self.target == TO_FLIGHTCTRL and at <= until:
                for byte in data:
                    self._send_back(self._back_fifo.take(at, byte))
        self._send_back(self._back_fifo.settle(until))

    def _send_back(self, handed: list[tuple[float, int]]) -> None:
        for at, byte in handed:
            self._out.send(bytes((byte,)), at)


LOOP: Final = 0.1e-3
"""One pass of the main loop."""
NEVER: Final = math.inf
TICK_TIME: Final = 1e-3
SUBSCRIPTION_TIME: Final = 4.0
_FORWARD_EXTRA: Final = 4
"""Passes around the characters of a forwarded frame: copying it, and noticing that it is gone."""


class NaviStream:
    """A subscription: exact periods on the millisecond counter."""

    __slots__ = ("due", "interval")

    def __init__(self) -> None:
        self.interval = 0
        self.due = NEVER

    def stop(self) -> None:
        """No more frames."""
        self.interval, self.due = 0, NEVER


class NcBoard(BoardPort):
    """One NaviCtrl with its FlightCtrl, without its main loop.

    Attributes:
        generation: its release.
        flight: the FlightCtrl behind it.
        motor_order: draws which motor a status frame is about.
        rx: how it receives.
        menu: the display page shown.
        wanted: replies asked for, by letter; the value is what the reply needs.
        streams: subscriptions, by reply letter.
        streams_expire_at: when the streams end unless they are renewed [s].
        navigator: what it knows of the flight.
        parameters: values set with `j`, by id.
        redirection: where the host's characters go.
        error_text: the buffer of the error text, with what stood there before.
        next_set: the data set that leaves next.
        byte_budget: of the data sets [bytes/s]; 0 selects NaviData 5.
        pending_control: external control waiting for the next exchange on the SPI bus.
        deaf_until: characters are lost until then [s].
        next_control: next turn of the control loop [s].
    """

    def __init__(self, generation: NcFirmware, flight: FlightCtrl, *, seed: int, loop_time: float = LOOP) -> None:
        super().__init__(HOST_CHAR)
        self.generation = generation
        self.flight = flight
        flight.adopt_companion(generation.release)
        rng = random.Random(f"{seed} nc")
        self.loop_time = loop_time
        self.phase = rng.uniform(0.0, TICK_TIME)
        self.motor_order = rng
        self.reset_state()

    def reset_state(self) -> None:
        """Set what a reset loses to its first value."""
        self.rx = NcReceiver()
        self.menu = MenuPages(self.generation.menu_pages)
        self.navigator = Navigator(self.generation, self.flight, self.now)
        self.wanted: dict[str, int] = {}
        self.streams = {letter: NaviStream() for letter in "ODCHK"}
        self.streams_expire_at = 0.0
        self.parameters: dict[int, int] = {}
        self.redirection = Redirection(self.flight, self._out)
        self.error_text = bytearray(25)
        self.next_set = 10
        self.byte_budget = 0
        self.pending_control: bytes | None = None
        self.deaf_until = 0.0
        self.next_control = self.now
        self._sets_after = 0.0
        self._forward_free_at = 0.0

    def ask(self, letter: str, value: int = 0) -> None:
        """Fill the one request slot of a kind; what stood there is lost."""
        self.wanted[letter] = value

    def subscribe(self, letter: str, interval: int, now: float) -> None:
        """Start, change or stop a stream; any of them renews all."""
        stream = self.streams[letter]
        stream.interval = interval
        if interval:
            stream.due = now
        else:
            stream.stop()
        # a frame that would be due on the very tick is not sent any more
        self.streams_expire_at = self.tick_before(now) + SUBSCRIPTION_TIME - 0.5 * TICK_TIME

    def tick_before(self, now: float) -> float:
        """Time of the millisecond tick before `now` [s]."""
        return self.phase + math.floor((now - self.phase) / TICK_TIME + 1e-6) * TICK_TIME

    def spend_byte_budget(self, frame_chars: int) -> None:
        """Wait with the next data set until the byte budget allows it."""
        self._sets_after = self.now + frame_chars / max(1, self.byte_budget)

    def may_send_set(self, now: float) -> bool:
        """Whether the byte budget allows a further data set."""
        return now >= self._sets_after

    def forward(self, frame: bytes, now: float) -> None:
        """Pass a frame on to the FlightCtrl, a character a pass; while one is on its way the next is lost."""
        if now < self._forward_free_at:
            return
        step = max(self.loop_time, HOST_CHAR)
        for count, byte in enumerate(frame, 1):
            self.flight.receive_byte(byte, now + count * step + HOST_CHAR)
        self._forward_free_at = now + (len(frame) + _FORWARD_EXTRA) * step

    def control(self, payload: bytes) -> None:
        """Hand external control over with the next exchange on the SPI bus (2.13 and later); the newest wins."""
        self.pending_control = payload

    def enter_boot_loader(self, now: float) -> None:
        """`R` jumps to the boot loader: silence from here on, in flight too."""
        self.reset_state()
        self._out.cut(now)
        self.deaf_until = NEVER
        self.next_control = NEVER
