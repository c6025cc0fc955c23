"""The NaviCtrl: a fast main loop, one request slot a kind, replies in a fixed order, and the FlightCtrl behind it.

Nothing happens between two events (a character, a time-out, a due stream), so the board jumps from one pass that has
something to do to the next. Behaviour and figures: docs/firmware-notes. The board's state is in `nc_board`, its
commands in `nc_commands`, its replies in `nc_replies`.
"""

from __future__ import annotations

import math
from typing import Final

from mksim.boards import nc_replies
from mksim.boards.fc import FlightCtrl
from mksim.boards.generations import NcGeneration
from mksim.boards.line import HOST_CHAR
from mksim.boards.navigator import CONTROL_PERIOD
from mksim.boards.nc_board import LOOP, NEVER, TICK_TIME, NaviStream, NcBoard
from mksim.boards.nc_commands import handle
from mksim.boards.redirect import TO_FLIGHTCTRL

TX_FIFO: Final = 16
"""Characters the hardware sends by itself: the next reply is composed while the last ones leave."""
BOOT: Final = 2.0
"""From reset to the first handled frame; not measured."""
BOOT_TEXT: Final = b"\r\n Navi-Ctrl starts\r\n UART1 init...ok\r\n SPI init...ok\r\n Timer2 init...ok\r\n"
"""Plain text after a reset; the words are our own."""
ORDER: Final = "BJZWXAODCKHLTVE"
"""Replies leave in this order, one a pass."""


class NaviCtrl(NcBoard):
    """One NaviCtrl with its FlightCtrl."""

    def __init__(self, generation: NcGeneration, flight: FlightCtrl, *, seed: int, loop_time: float = LOOP) -> None:
        """Power it up.

        Args:
            generation: which release it is.
            flight: the FlightCtrl behind it.
            seed: of its clock's phase.
            loop_time: one pass of its main loop [s].
        """
        super().__init__(generation, flight, seed=seed, loop_time=loop_time)
        self._tx_free_at = 0.0
        self._last_pass = -self.loop_time

    def advance(self, to: float) -> None:
        """Run both boards to `to` [s]."""
        while True:
            arrival = self._line.next_at
            timeout = self.rx.timeout_at
            chosen = self._next_pass()
            first = min(arrival if arrival is not None else NEVER, timeout if timeout is not None else NEVER, chosen)
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
        if at < self.deaf_until:
            return
        if not self.redirection.is_on:
            self.rx.take(at, byte)
            return
        target = self.redirection.target
        if self.redirection.take(byte, at):
            if target != TO_FLIGHTCTRL:
                self.navigator.camera_servos_on = True
            self.deaf_until = at + self.redirection.SETTLE_TIME
            self._tx_free_at = at

    def _next_pass(self) -> float:
        """When the main loop next has something to do [s], on its own grid."""
        due = self.next_control
        if self.rx.has_work:
            due = max(self.rx.handed_at, self._last_pass + self.loop_time)
        elif not self.redirection.is_on:
            due = min(due, self._next_frame_time())
        if due == NEVER:
            return NEVER
        steps = math.ceil((due - self.phase) / self.loop_time - 1e-6)
        at = max(self.phase + steps * self.loop_time, self._last_pass + self.loop_time)
        stall = self.flight.aircraft.faults.active.get("nc_sd_stall")
        return at if stall is None else max(at, stall.ends)

    def _next_frame_time(self) -> float:
        """When a reply or a stream can next leave [s]."""
        soonest = self.now if self.wanted else min(stream.due for stream in self.streams.values())
        return max(soonest, self._tx_free_at)

    def _pass(self, now: float) -> None:
        self.now = self._last_pass = now
        self.flight.advance(now)
        self.redirection.carry(now)
        if self.flight.aircraft.faults.take("nc_reboot"):
            self._reboot(now)
            return
        if now >= self.next_control:
            self.next_control = now + CONTROL_PERIOD
            self.navigator.navigate(now)
            if self.pending_control is not None and self.navigator.has_flight and self.navigator.fits_flight:
                self.flight.external.refresh("b")
                self.flight.external.take(self.pending_control)
                self.pending_control = None
        if self.rx.collect():
            handle(self, now)
            self.rx.release()
        if not self.redirection.is_on and now >= self._tx_free_at:
            self._start_next_frame(now)

    def _reboot(self, now: float) -> None:
        """Reset: waypoints, streams and parameters are lost; text, then silence until it is up again."""
        self.reset_state()
        self._out.cut(now)
        self._out.send(BOOT_TEXT, now)
        self.deaf_until = self.next_control = now + BOOT
        self._tx_free_at = now + BOOT

    def _start_next_frame(self, now: float) -> None:
        if now >= self.streams_expire_at:
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
        stream.due = self.tick_before(now) + stream.interval * 10 * TICK_TIME

    def _send(self, frame: bytes, now: float) -> None:
        """Put a frame on the line; the buffer is free again when the hardware can send the rest alone."""
        end = self._out.send(frame, now)
        self._tx_free_at = max(now, end - TX_FIFO * HOST_CHAR)
