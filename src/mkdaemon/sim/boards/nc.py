"""The NaviCtrl: a fast main loop, one request slot a kind, replies in a fixed order, and the FlightCtrl behind it.

Nothing happens between two events (a character, a time-out, a due stream), so the board jumps from one pass that has
something to do to the next. Behaviour and figures: docs/firmware-notes; commands are in `nc_commands`, replies in
`nc_replies`.
"""

from __future__ import annotations

import math
import random
from typing import Final

from mkdaemon.sim.boards import nc_replies
from mkdaemon.sim.boards.display import NcMenu
from mkdaemon.sim.boards.fc import FlightCtrl
from mkdaemon.sim.boards.generations import NcGeneration
from mkdaemon.sim.boards.line import HOST_CHAR, BoardPort
from mkdaemon.sim.boards.navigator import CONTROL_PERIOD, Navigator
from mkdaemon.sim.boards.nc_commands import handle
from mkdaemon.sim.boards.reception import NcReceiver
from mkdaemon.sim.boards.redirect import Redirection

LOOP: Final = 0.1e-3
"""One pass of the main loop."""
TICK_TIME: Final = 1e-3
SUBSCRIPTION_TIME: Final = 4.0
TX_FIFO: Final = 16
"""Characters the hardware sends by itself: the next reply is composed while the last ones leave."""
ORDER: Final = "BJZWXAODCKHLTVE"
"""Replies leave in this order, one a pass."""
_FORWARD_EXTRA: Final = 4
"""Passes around the characters of a forwarded frame: copying it, and noticing that it is gone."""
_NEVER: Final = math.inf


class NaviStream:
    """A subscription: exact periods on the millisecond counter."""

    __slots__ = ("due", "interval")

    def __init__(self) -> None:
        self.interval = 0
        self.due = _NEVER

    def stop(self) -> None:
        """No more frames."""
        self.interval, self.due = 0, _NEVER


class NaviCtrl(BoardPort):
    """One NaviCtrl with its FlightCtrl.

    Attributes:
        generation: its release.
        flight: the FlightCtrl behind it.
        wanted: replies asked for, by letter; the value is what the reply needs.
        streams: subscriptions, by reply letter.
        navigator: what it knows of the flight.
        parameters: values set with `j`, by id.
        byte_budget: of the data sets [bytes/s]; 0 selects NaviData 5.
    """

    def __init__(self, generation: NcGeneration, flight: FlightCtrl, *, seed: int, loop_time: float = LOOP) -> None:
        super().__init__(HOST_CHAR)
        self.generation = generation
        self.flight = flight
        flight.adopt_companion(generation.release)
        rng = random.Random(f"{seed} nc")
        self._loop_time = loop_time
        self._phase = rng.uniform(0.0, TICK_TIME)
        self.motor_order = rng
        self._begin()

    def _begin(self) -> None:
        self.rx = NcReceiver()
        self.menu = NcMenu(self.generation)
        self.navigator = Navigator(self.generation, self.flight, self.now)
        self.wanted: dict[str, int] = {}
        self.streams = {letter: NaviStream() for letter in "ODCHK"}
        self.parameters: dict[int, int] = {}
        self.redirection = Redirection(self.flight, self._out)
        self.error_text = bytearray(25)
        self.next_set = 10
        self.byte_budget = 0
        self._sets_after = 0.0
        self._expires = 0.0
        self._tx_free_at = 0.0
        self._forward_free_at = 0.0
        self._deaf_until = 0.0
        self._last_pass = -self._loop_time
        self._next_control = self.now
        self._pending_control: bytes | None = None

    # --- time ---

    def advance(self, to: float) -> None:
        """Run both boards to `to` [s]."""
        while True:
            arrival = self._line.next_at
            timeout = self.rx.timeout_at
            chosen = self._next_pass()
            first = min(arrival if arrival is not None else _NEVER, timeout if timeout is not None else _NEVER, chosen)
            if first > to:
                break
            if first == arrival:
                for at, byte in self._line.take(arrival):
                    self._take(byte, at)
            elif first == timeout:
                self.rx.settle(first)
            else:
                self._pass(first)
        self.flight.advance(to)
        self.redirection.carry(to)
        self.now = to

    def _take(self, byte: int, at: float) -> None:
        if at < self._deaf_until:
            return
        if not self.redirection.is_on:
            self.rx.take(at, byte)
        elif self.redirection.take(byte, at):
            self._deaf_until = at + self.redirection.SETTLE_TIME
            self._tx_free_at = at

    def _next_pass(self) -> float:
        """When the main loop next has something to do [s], on its own grid."""
        due = self._next_control
        if self.rx.has_work:
            due = max(self.rx.handed_at, self._last_pass + self._loop_time)
        elif not self.redirection.is_on:
            due = min(due, self._next_talk())
        if due == _NEVER:
            return _NEVER
        steps = math.ceil((due - self._phase) / self._loop_time - 1e-6)
        at = max(self._phase + steps * self._loop_time, self._last_pass + self._loop_time)
        stall = self.flight.aircraft.faults.active.get("nc_sd_stall")
        return at if stall is None else max(at, stall.ends)

    def _next_talk(self) -> float:
        """When a reply or a stream can next leave [s]."""
        soonest = self.now if self.wanted else min(stream.due for stream in self.streams.values())
        return max(soonest, self._tx_free_at)

    def _pass(self, now: float) -> None:
        self.now = self._last_pass = now
        self.flight.advance(now)
        self.redirection.carry(now)
        if now >= self._next_control:
            self._next_control = now + CONTROL_PERIOD
            self.navigator.navigate(now)
            if self._pending_control is not None and self.navigator.fits_flight:
                self.flight.external.refresh("b")
                self.flight.external.take(self._pending_control)
                self._pending_control = None
        if self.rx.collect():
            handle(self, now)
            self.rx.release()
        if not self.redirection.is_on and now >= self._tx_free_at:
            self._talk(now)

    # --- talking ---

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
        self._expires = now + SUBSCRIPTION_TIME

    def _talk(self, now: float) -> None:
        if now >= self._expires:
            for stream in self.streams.values():
                stream.stop()
        for letter in ORDER:
            running = self.streams.get(letter)
            is_due = running is not None and now >= running.due
            if not is_due and letter not in self.wanted:
                continue
            if running is not None and is_due:
                self._restart(running, now)
            frame = nc_replies.build(self, letter, self.wanted.pop(letter, 0))
            if frame is not None:
                self._send(frame, now)
                return

    def _restart(self, stream: NaviStream, now: float) -> None:
        """Count the next period from the last millisecond tick."""
        tick = self._phase + math.floor((now - self._phase) / TICK_TIME + 1e-6) * TICK_TIME
        stream.due = tick + stream.interval * 10 * TICK_TIME

    def hold_sets(self, frame_chars: int) -> None:
        """Keep the data sets within their byte budget."""
        self._sets_after = self.now + frame_chars / max(1, self.byte_budget)

    def _send(self, frame: bytes, now: float) -> None:
        """Put a frame on the line; the buffer is free again when the hardware can send the rest alone."""
        end = self._out.send(frame, now)
        self._tx_free_at = max(now, end - TX_FIFO * HOST_CHAR)

    def may_send_set(self, now: float) -> bool:
        """Whether the byte budget allows a further data set."""
        return now >= self._sets_after

    # --- the FlightCtrl behind ---

    def forward(self, frame: bytes, now: float) -> None:
        """Pass a frame on to the FlightCtrl, a character a pass; while one is on its way the next is lost."""
        if now < self._forward_free_at:
            return
        step = max(self._loop_time, HOST_CHAR)
        for count, byte in enumerate(frame, 1):
            self.flight.receive_byte(byte, now + count * step + HOST_CHAR)
        self._forward_free_at = now + (len(frame) + _FORWARD_EXTRA) * step

    def control(self, payload: bytes) -> None:
        """Hand external control over with the next exchange on the SPI bus (2.13 and later); the newest wins."""
        self._pending_control = payload

    def reboot(self, now: float) -> None:
        """`R` jumps to the boot loader: silence from here on, in flight too."""
        self._begin()
        self._out.cut(now)
        self._deaf_until = _NEVER
        self._next_control = _NEVER
