"""The NaviCtrl: a fast main loop, one request slot a kind, replies in a fixed order, and the FlightCtrl behind it.

Nothing happens between two events (a character, a time-out, a due stream), so the board jumps from one pass that has
something to do to the next. Behaviour and figures: docs/firmware-notes. The board's state is in `navictrl_state`, its
replies in `navictrl_replies`.

Commands have one handler a letter. Source: docs/protocol.md, section 8; docs/firmware-notes, "Sending" and
"Subscriptions".
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final

from mkdaemon.protocol.flags import FlightStatus, PointType, PositionStatus
from mkdaemon.protocol.messages import WriteWaypoint024
from mksim.boards.flightctrl import FlightCtrl
from mksim.boards.generations import NcFirmware
from mksim.boards.line import HOST_CHAR
from mksim.boards.navictrl_replies import build
from mksim.boards.navictrl_state import LOOP, NEVER, STOPS_SERVOS, TICK_TIME, TO_FLIGHTCTRL, TO_GPS, NaviStream, NcBoard
from mksim.boards.navigator import CONTROL_PERIOD
from mksim.boards.waypoints import POINT_SIZE

_FC_ADDRESS: Final = 1
_OWN_ADDRESS: Final = 2
_WITHOUT_WATCHDOG: Final = "zby"
_LABELS: Final = 31
_CONTROL_SIZE: Final = 9
_SET_PARAMETER: Final = 1


def handle(board: NcBoard, now: float) -> None:
    """Handle the collected frame."""
    buffer = board.rx.buffer
    letter, address = buffer.command, buffer.address
    if letter == "R":
        board.enter_boot_loader(now)
        return
    if address == _FC_ADDRESS and letter in "by" and not board.generation.takes_control:
        board.forward(bytes(buffer.bytes[: buffer.length]), now)
        return
    buffer.decode_in_place()
    handler = (_OWN.get(letter) if address == _OWN_ADDRESS else None) or _ANY.get(letter)
    if handler is None and letter in board.generation.extras:
        handler = _EXTRAS.get(letter)
    if handler is None and board.generation.takes_control:
        handler = _CONTROL.get(letter)
    if handler is None:
        return
    if letter not in _WITHOUT_WATCHDOG:
        board.navigator.feed_watchdog(now)
    handler(board, now)


def _read(board: NcBoard, size: int) -> bytes:
    return board.rx.buffer.payload(size)


def _word(raw: bytes) -> int:
    return int.from_bytes(raw, "little", signed=True)


def _echo(board: NcBoard, now: float) -> None:
    board.ask("Z", int.from_bytes(_read(board, 2), "little"))


def _error_text(board: NcBoard, now: float) -> None:
    board.ask("E")


def _target(board: NcBoard, now: float) -> None:
    raw = _read(board, POINT_SIZE)
    point = WriteWaypoint024.decode(raw)
    if point.status is PositionStatus.NEW and 1 <= point.index <= board.generation.list_size:
        board.navigator.points.write(raw)
        board.navigator.start_route()


def _write_point(board: NcBoard, now: float) -> None:
    raw = _read(board, POINT_SIZE)
    index = board.navigator.points.write(raw)
    if index and WriteWaypoint024.decode(raw).type is not PointType.INVALID:
        board.navigator.point_written()
    board.ask("W", index)


def _read_point(board: NcBoard, now: float) -> None:
    index = _read(board, 1)[0]
    if index:
        board.ask("X", index)


def _redirect(board: NcBoard, now: float) -> None:
    target = _read(board, 1)[0]
    running = FlightStatus.MOTORS_RUNNING in board.navigator.flight_status()
    if target > TO_GPS or (target != TO_FLIGHTCTRL and running):
        return
    if target in STOPS_SERVOS:
        board.navigator.camera_servos_on = False
    board.redirection.start(target, now)


def _parameter(board: NcBoard, now: float) -> None:
    raw = _read(board, 4)
    if raw[0] == _SET_PARAMETER:
        board.parameters[raw[1]] = _word(raw[2:4])
    board.ask("J", raw[1])


def _osd(board: NcBoard, now: float) -> None:
    raw = _read(board, 3)
    budget = int.from_bytes(raw[1:3], "little") if board.generation.data_sets else 0
    board.byte_budget = budget
    board.subscribe("O", raw[0], now)


def _stream(letter: str) -> _Handler:
    def subscribe(board: NcBoard, now: float) -> None:
        board.subscribe(letter, _read(board, 1)[0], now)

    return subscribe


def _display(board: NcBoard, now: float) -> None:
    keys, interval = _read(board, 2)
    board.menu.turn(keys)
    # the obsolete format is refused once, not streamed
    board.subscribe("H", interval if keys & 0x80 else 0, now)
    board.ask("H")


def _menu(board: NcBoard, now: float) -> None:
    board.ask("L", _read(board, 1)[0])


def _label(board: NcBoard, now: float) -> None:
    board.ask("A", min(_read(board, 1)[0], _LABELS))


def _version(board: NcBoard, now: float) -> None:
    board.ask("V")


def _time(board: NcBoard, now: float) -> None:
    board.ask("T")


def _control(board: NcBoard, now: float) -> None:
    raw = _read(board, _CONTROL_SIZE)
    board.control(raw[: board.flight.external.size])
    if raw[4]:
        board.ask("B", raw[4])


def _serial_channels(board: NcBoard, now: float) -> None:
    board.flight.serial_channels = [value - 256 if value > 127 else value for value in _read(board, 12)]


_Handler = Callable[[NcBoard, float], None]

_OWN: Final[dict[str, _Handler]] = {
    "z": _echo,
    "e": _error_text,
    "s": _target,
    "w": _write_point,
    "x": _read_point,
    "u": _redirect,
    "j": _parameter,
}
"""Obeyed only at the board's own address."""
_ANY: Final[dict[str, _Handler]] = {
    "o": _osd,
    "d": _stream("D"),
    "c": _stream("C"),
    "h": _display,
    "l": _menu,
    "a": _label,
    "v": _version,
}
"""Obeyed whatever address the frame bears."""
_EXTRAS: Final[dict[str, _Handler]] = {"k": _stream("K"), "t": _time}
_CONTROL: Final[dict[str, _Handler]] = {"b": _control, "y": _serial_channels}
HANDLED: Final = frozenset({*_ANY, *_OWN, *_EXTRAS, *_CONTROL, "R"})
"""Every letter some generation acts on."""


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

    def __init__(self, generation: NcFirmware, flight: FlightCtrl, *, seed: int, loop_time: float = LOOP) -> None:
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
            receiver = self.redirection if self.redirection.is_on else self.rx
            timeout = receiver.timeout_at
            chosen = self._next_pass()
            first = min(arrival if arrival is not None else NEVER, timeout if timeout is not None else NEVER, chosen)
            if first > to:
                break
            if first == arrival:
                for at, byte in self._line.take(arrival):
                    self._take(byte, at)
            elif first == timeout:
                receiver.settle(first)
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
            self._print(now)
            if self.pending_control is not None and self.navigator.has_flight and self.navigator.fits_flight:
                self.flight.external.refresh("b")
                self.flight.external.take(self.pending_control)
                self.pending_control = None
        if self.rx.collect():
            handle(self, now)
            self.rx.release()
        if not self.redirection.is_on and now >= self._tx_free_at:
            self._start_next_frame(now)

    def _print(self, now: float) -> None:
        """Print what there is to say, in the middle of the frame that is being sent: the board waits for nothing."""
        navigator = self.navigator
        if navigator.prints and not self.redirection.is_on:
            tail = self._out.cut(now + TX_FIFO * HOST_CHAR)
            self._out.send(navigator.prints, now)
            self._tx_free_at = max(now, self._out.send(tail, now) - TX_FIFO * HOST_CHAR)
        navigator.prints = b""

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
            frame = build(self, letter, self.wanted.pop(letter, 0))
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
