"""What each command letter does on a FlightCtrl: one handler a letter, one table.

A handler reads the receive buffer as the firmware does, garbage of short payloads included. Letters of the first table
need the board's own address; those of the second are obeyed whatever the address says. Source: docs/firmware-notes,
"Sending" and "Commands with side effects"; docs/protocol.md, sections 5 to 7.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from mkdaemon.protocol.messages import (
    ACTIVE_SET,
    Mixer,
    MixerWritten,
    Settings,
    SettingsSelected,
    SettingsWritten,
)
from mksim.boards import fc_display
from mksim.boards.eeprom import BL_SIZE, MIXER_REVISION, MIXER_SIZE
from mksim.boards.fc_board import FcBoard
from mksim.boards.generations import FC_MS
from mksim.boards.motors import READ, WRITE
from mksim.boards.parameters import SETS, clamp_written, parameter_size

_OWN_ADDRESS: Final = 1
_EEPROM_READ: Final = 1.2e-3
_SET_WRITE: Final = 0.64
_MIXER_WRITE: Final = 0.3
_RESET_SET: Final = 0.5
_SELECT: Final = 0.04
_BEEP: Final = 0.23
"""Length of one of the beeps that count out the set number."""
_SETTLE: Final = 0.1e-3
_STOP: Final = 0.85
_LABELS: Final = 31
_ARM: Final = 0.04
"""Handling time of the fork's `x`; not measured."""
_CALIBRATION: Final = 1.5
_BEEP_OVERHEAD: Final = 0.084
"""The fork's `o` around its beeps: 500 ms once and twice keep the board busy 1.12 and 2.16 s."""
_KEEP_BUFFER: Final = "fsoxer"
"""Commands that keep the receive buffer while they work: frames that come meanwhile are lost, none is kept."""


def handle(board: FcBoard, now: float) -> None:
    """Handle the frame in the receive buffer."""
    buffer = board.rx.buffer
    buffer.decode_in_place()
    letter = buffer.command
    if letter != "b" or board.external.accepts(buffer.length):
        board.external.refresh(letter)
    own = buffer.address == _OWN_ADDRESS
    handler = (_OWN.get(letter) if own else None) or _ANY.get(letter)
    if handler is None and own and board.is_fork:
        handler = _FORK.get(letter)
    if handler is not None:
        handler(board, now)
        board.keeps_buffer = letter in _KEEP_BUFFER and now < board.blocked_until


def _read(board: FcBoard, size: int) -> bytes:
    return board.rx.buffer.payload(size)


# --- any address ---


def _version(board: FcBoard, now: float) -> None:
    asked = _read(board, 1)[0]
    board.requests.version = asked if board.generation.release >= (2, 0, 0) else 0


def _control_state(board: FcBoard, now: float) -> None:
    board.requests.control = True


def _label(board: FcBoard, now: float) -> None:
    board.requests.label = min(_read(board, 1)[0], _LABELS)


def _debug(board: FcBoard, now: float) -> None:
    board.requests.debug_stream.interval = _read(board, 1)[0]
    board.requests.debug = board.requests.debug_stream.interval > 0
    board.requests.renew(now)


def _attitude(board: FcBoard, now: float) -> None:
    board.requests.attitude_stream.interval = _read(board, 1)[0]
    board.requests.attitude_stream.restart(now)
    board.requests.renew(now)


def _display(board: FcBoard, now: float) -> None:
    keys, interval = _read(board, 2)
    fc_display.press_keys(board, keys)
    # the obsolete format is refused once, not streamed
    board.requests.display_stream.interval = interval if keys & 0x80 else 0
    board.requests.display = True
    board.requests.renew(now)


def _menu(board: FcBoard, now: float) -> None:
    board.requests.menu = _read(board, 1)[0]


def _control(board: FcBoard, now: float) -> None:
    external = board.external
    if external.accepts(board.rx.buffer.length):
        external.take(_read(board, external.size))


def _compass(board: FcBoard, now: float) -> None:
    board.forced_heading = int.from_bytes(_read(board, 2), "little", signed=True)


def _motor_test(board: FcBoard, now: float) -> None:
    board.requests.renew(now)
    reply = board.motors.test(_read(board, 16), board.rx.buffer.length, now)
    if board.generation.release >= (2, 0, 0):
        board.send_when_free(reply, now + _SETTLE)


# --- own address ---


def _receiver(board: FcBoard, now: float) -> None:
    board.requests.receiver = True


def _mixer(board: FcBoard, now: float) -> None:
    if board.generation.answers_mixer:
        board.send_when_free(Mixer.decode(board.eeprom.mixer), now + _SETTLE)


def _write_mixer(board: FcBoard, now: float) -> None:
    if not board.generation.answers_mixer:
        return
    raw = _read(board, MIXER_SIZE)
    stored = raw[0] == MIXER_REVISION
    if stored:
        board.eeprom.mixer = raw
        board.eeprom.save()
    done = now + (_MIXER_WRITE if stored else _SETTLE)
    board.send_when_free(MixerWritten(stored=int(stored)), done)


def _settings(board: FcBoard, now: float) -> None:
    index = _read(board, 1)[0]
    running = board.core.running
    if running and "q" in board.generation.deaf_when_running:
        return
    if running:
        _send_settings(board, board.eeprom.active, board.live.raw, now + _EEPROM_READ)
        return
    if 10 <= index < 30:
        _reset_settings(board, index, now)
        return
    number = board.eeprom.active if index == ACTIVE_SET else min(max(index, 1), SETS)
    board.load(number)
    _send_settings(board, number, board.live.raw, now + _EEPROM_READ)


def _reset_settings(board: FcBoard, index: int, now: float) -> None:
    number = min(max(index % 10, 1), SETS)
    eeprom = board.eeprom
    eeprom.reset_set(number, keep_channels=index < 20)
    eeprom.active = number
    eeprom.save()
    board.load(number)
    _send_settings(board, number, board.live.raw, now + _RESET_SET)


def _send_settings(board: FcBoard, number: int, raw: bytes, at: float) -> None:
    board.send_when_free(Settings.decode(bytes([number]) + raw), at)


def _write_settings(board: FcBoard, now: float) -> None:
    size = parameter_size(board.generation.revision)
    index, raw = _read(board, 1)[0], _read(board, 1 + size)[1:]
    if not 1 <= index <= SETS or raw[0] != board.generation.revision or board.core.running:
        board.send_when_free(SettingsWritten(index=0), now + _SETTLE)
        return
    eeprom = board.eeprom
    eeprom.sets[index] = clamp_written(raw)
    eeprom.active = index
    eeprom.save()
    board.load(index)
    board.send_when_free(SettingsWritten(index=index), now + _SET_WRITE)
    board.block(now + _SET_WRITE + index * _BEEP)


def _select_settings(board: FcBoard, now: float) -> None:
    if board.core.running:
        return
    number = _read(board, 1)[0]
    if 1 <= number <= SETS:
        board.load(number)
    active = board.eeprom.active
    board.send_when_free(SettingsSelected(index=active), now + _SELECT)
    board.block(now + _SELECT + active * _BEEP)


def _serial_channels(board: FcBoard, now: float) -> None:
    raw = _read(board, 12)
    board.serial_channels = [value - 256 if value > 127 else value for value in raw]


def _read_motor_controller(board: FcBoard, now: float) -> None:
    motor = _read(board, 1)[0]
    reply = board.motors.read(motor, running=board.core.running)
    took = READ if reply.done else _SETTLE
    board.send_when_free(reply, now + took)


def _write_motor_controller(board: FcBoard, now: float) -> None:
    if board.rx.buffer.encoded_length < BL_SIZE + 1:
        return
    raw = _read(board, BL_SIZE + 1)
    reply = board.motors.write(raw[0], raw[1:], running=board.core.running)
    took = WRITE if reply.done else _SETTLE
    board.send_when_free(reply, now + took)


def _bridge(board: FcBoard, now: float) -> None:
    board.bridged = not board.core.running


# --- the fork ---


def _arm(board: FcBoard, now: float) -> None:
    if board.core.calibrated and not board.companion_error:
        board.core.start()
    board.block(now + _ARM)


def _disarm(board: FcBoard, now: float) -> None:
    board.core.stop()
    board.block(now + _STOP)


def _calibrate(board: FcBoard, now: float) -> None:
    board.core.calibrate()
    board.block(now + _CALIBRATION)


def _beep(board: FcBoard, now: float) -> None:
    if board.core.running:
        return
    raw = _read(board, 3)
    # each beep is as long as the pause behind it; nothing bounds length or number
    milliseconds = 2 * max(0, int.from_bytes(raw[:2], "little", signed=True)) * raw[2]
    board.block(now + _BEEP_OVERHEAD + milliseconds * FC_MS)


_Handler = Callable[[FcBoard, float], None]

_ANY: Final[dict[str, _Handler]] = {
    "v": _version,
    "g": _control_state,
    "a": _label,
    "d": _debug,
    "c": _attitude,
    "h": _display,
    "l": _menu,
    "b": _control,
    "K": _compass,
    "t": _motor_test,
}
_OWN: Final[dict[str, _Handler]] = {
    "p": _receiver,
    "n": _mixer,
    "m": _write_mixer,
    "q": _settings,
    "s": _write_settings,
    "f": _select_settings,
    "y": _serial_channels,
    "u": _read_motor_controller,
    "w": _write_motor_controller,
    "j": _bridge,
}
_FORK: Final[dict[str, _Handler]] = {"x": _arm, "e": _disarm, "r": _calibrate, "o": _beep}
HANDLED: Final = frozenset({*_ANY, *_OWN, *_FORK, "R"})
"""Every letter some generation acts on; the reset is taken in the receive interrupt."""
