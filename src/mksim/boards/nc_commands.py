"""What each command letter does on a NaviCtrl: one handler a letter, one table.

Letters of the first table need the board's own address, those of the second are obeyed whatever the address says.
Source: docs/protocol.md, section 8; docs/firmware-notes, "Sending" and "Subscriptions".
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from mkdaemon.protocol.flags import FlightStatus, PointType, PositionStatus
from mkdaemon.protocol.messages import WriteWaypoint024
from mksim.boards.nc_board import NcBoard
from mksim.boards.redirect import STOPS_SERVOS, TO_FLIGHTCTRL, TO_GPS
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
_ANY: Final[dict[str, _Handler]] = {
    "o": _osd,
    "d": _stream("D"),
    "c": _stream("C"),
    "h": _display,
    "l": _menu,
    "a": _label,
    "v": _version,
}
_EXTRAS: Final[dict[str, _Handler]] = {"k": _stream("K"), "t": _time}
_CONTROL: Final[dict[str, _Handler]] = {"b": _control, "y": _serial_channels}
HANDLED: Final = frozenset({*_ANY, *_OWN, *_EXTRAS, *_CONTROL, "R"})
"""Every letter some generation acts on."""
