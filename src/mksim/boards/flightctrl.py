"""The FlightCtrl: one loop pass every 2 ms, one receive buffer, one frame leaving at a time; and its commands.

With motors running some passes have no time for the serial line: a frame then waits longer in the one buffer.

`receive` takes characters with the time they were put on the line, `advance` runs the board to a time, `poll` returns
characters with the time their stop bit was out. Nothing here knows real time. Behaviour and figures:
docs/firmware-notes. The board's state is in `flightctrl_state`, what it sends in `flightctrl_replies`.

Commands have one handler a letter. A handler reads the receive buffer as the firmware does, garbage of short payloads
included. Source: docs/firmware-notes, "Sending" and "Commands with side effects"; docs/protocol.md, sections 5 to 7.

While it boots it prints plain text between frames, 628 characters in stages. That number is a genuine 2.12a's. As
there, a line begins with its line break and the last one is never ended. Words and times of the stages are our own.
"""

from __future__ import annotations

import random
from collections.abc import Callable
from pathlib import Path
from typing import Final

from mkdaemon.protocol.messages import (
    ACTIVE_SET,
    Mixer,
    MixerWritten,
    Settings,
    SettingsSelected,
    SettingsWritten,
)
from mksim.boards.aircraft import SimulatedAircraft
from mksim.boards.eeprom import BL_SIZE, MIXER_REVISION, MIXER_SIZE
from mksim.boards.flightctrl_replies import press_keys, start_next_frame
from mksim.boards.flightctrl_state import BL_READ, BL_WRITE, FcBoard
from mksim.boards.generations import (
    FC_MS,
    LONG_PASS,
    LONG_SHARE,
    LONGEST_PASS,
    LONGEST_SHARE,
    SERIAL_PASSES,
    SHORT_PASS,
    SLOW_TICK,
    FcFirmware,
)
from mksim.boards.gestures import Gesture
from mksim.boards.parameters import SETS, clamp_written, parameter_size
from mksim.config import GasLaw
from mksim.physics.world import DT, MOTORS_OFF

BOOT_TEXT_LENGTH: Final = 628
"""Characters of the whole text."""
_BREAK: Final = "\n\r"
_RULE: Final = "=" * 35
_STAGES: Final = (
    (0.1, (_RULE, "Flight-Ctrl HW:2.2 SW:{release}", _RULE, "Clock: ok", "Settings: ok")),
    (0.6, ("Receiver: PPM, 12 channels", *(f"Motor {number}: found, version 2" for number in range(1, 5)))),
    (2.4, ("Gyro offsets: pitch ok, roll ok, yaw ok", "ACC neutral: pitch ok, roll ok, top ok")),
    (3.6, ("Pressure sensor: offset set", "NaviCtrl: looked for", "Mixer: quadrocopter, 4 motors")),
)
"""Time after the reset [s] and lines."""
_LAST_STAGE: Final = 4.4


def boot_text(release: str) -> tuple[tuple[float, str], ...]:
    """Return the stages for a release such as `2.12a`: seconds after the reset, and text."""
    stages = [(after, "".join(_BREAK + line.format(release=release) for line in lines)) for after, lines in _STAGES]
    missing = BOOT_TEXT_LENGTH - sum(len(text) for _, text in stages) - len(_BREAK)
    return (*stages, (_LAST_STAGE, _BREAK + "=" * missing))


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
    press_keys(board, keys)
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
    took = BL_READ if reply.done else _SETTLE
    board.send_when_free(reply, now + took)


def _write_motor_controller(board: FcBoard, now: float) -> None:
    if board.rx.buffer.encoded_length < BL_SIZE + 1:
        return
    raw = _read(board, BL_SIZE + 1)
    reply = board.motors.write(raw[0], raw[1:], running=board.core.running)
    took = BL_WRITE if reply.done else _SETTLE
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
"""Obeyed whatever address the frame bears."""
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
"""Obeyed only at the board's own address."""
_FORK: Final[dict[str, _Handler]] = {"x": _arm, "e": _disarm, "r": _calibrate, "o": _beep}
HANDLED: Final = frozenset({*_ANY, *_OWN, *_FORK, "R"})
"""Every letter some generation acts on; the reset is taken in the receive interrupt."""


BOOT: Final = 4.7
"""From reset to the first handled frame."""
BOOT_DEAD_MAN: Final = 6.75
"""From reset to the first count of the dead-man: a stick frame kept through the boot acts from 4.7 to 8.8 s."""
RESET: Final = 0.25
"""From `R` to the watchdog's reset."""
CALIBRATE_BUSY: Final = 1.5
_ACTUATION: Final = 0.5e-3
"""From the pass after sticks were evaluated to the set points on the motor bus."""


class FlightCtrl(FcBoard):
    """One FlightCtrl."""

    def __init__(
        self,
        generation: FcFirmware,
        aircraft: SimulatedAircraft,
        *,
        seed: int,
        gas_law: GasLaw = GasLaw.STOCK,
        eeprom: Path | None = None,
        gate_parameter: int = 0,
        calibrated: bool = False,
    ) -> None:
        """Power the board up; it is ready at once, as after a long time on the bench.

        Args:
            generation: which release it is.
            aircraft: what it flies.
            seed: of its loop's jitter.
            gas_law: stock or fork.
            eeprom: file that keeps its settings.
            gate_parameter: ExternalControl in a new EEPROM's parameter sets.
            calibrated: no calibration is needed before the motors start.

        Raises:
            ConfigError: the EEPROM file cannot be used.
        """
        super().__init__(
            generation,
            aircraft,
            gas_law=gas_law,
            eeprom=eeprom,
            gate_parameter=gate_parameter,
            calibrated=calibrated,
        )
        self._rng = random.Random(f"{seed} fc")
        self._next_pass = self._rng.uniform(0.0, SHORT_PASS)
        self._reset_loop()

    def _reset_loop(self) -> None:
        self._next_tick = self.now
        self._skipped_passes = 0
        self._reset_at: float | None = None
        self._sticks = self._next_sticks = MOTORS_OFF
        self._sticks_at = 0.0

    def advance(self, to: float) -> None:
        """Run to `to` [s]."""
        while self._next_pass <= to:
            now = self._next_pass
            self._next_pass = now + self._pass_time()
            self.now = now
            self._pass(now)
        self._step_aircraft_to(to)
        self.now = to

    def _pass_time(self) -> float:
        drawn = self._rng.random()
        if drawn < LONG_SHARE:
            return LONG_PASS
        return LONGEST_PASS if drawn >= 1.0 - LONGEST_SHARE else SHORT_PASS

    def _pass(self, now: float) -> None:
        """One turn of the main loop."""
        self._step_aircraft_to(now)
        for at, byte in self._line.take(now):
            if not self.bridged and self.rx.take(byte) and self.rx.buffer.command == "R":
                self._request_reset(at)
        if self._reset_at is not None and now >= self._reset_at:
            self.reboot(now)
        if self.aircraft.faults.take("fc_reboot"):
            self.reboot(now)
        if now < self.blocked_until or self.bridged:
            return
        if self.keeps_buffer:
            self.keeps_buffer = False
            self.rx.release()
        self._run_slow_ticks(now)
        if self.core.is_due(now):
            self._evaluate(now)
        if self._has_time_for_serial():
            self._run_serial(now)

    def _has_time_for_serial(self) -> bool:
        """Whether this pass runs the serial part: with motors running the regulator leaves no time for it in some."""
        if not self.core.running:
            return True
        if self._skipped_passes:
            self._skipped_passes -= 1
            return False
        (self._skipped_passes,) = self._rng.choices(range(len(SERIAL_PASSES)), SERIAL_PASSES)
        return True

    def _run_serial(self, now: float) -> None:
        """Send what is due, then handle the frame that waits."""
        if self._out.busy_until <= now:
            start_next_frame(self, now)
        if self.rx.has_frame:
            handle(self, now)
            if not self.keeps_buffer:
                self.rx.release()

    def _step_aircraft_to(self, to: float) -> None:
        """Let the aircraft fly under the sticks in force."""
        aircraft = self.aircraft
        while aircraft.now + DT <= to:
            if self._next_sticks is not self._sticks and aircraft.now + DT > self._sticks_at:
                self._sticks = self._next_sticks
            aircraft.step(self._sticks)

    def _run_slow_ticks(self, now: float) -> None:
        while self._next_tick <= now:
            self._next_tick += SLOW_TICK
            self.core.tick(now, self.live)
            self.collect()
            self.external.tick_until(now)
            self.motors.pass_time(now, running=self.core.running)
            self._set_sticks()

    def _evaluate(self, now: float) -> None:
        """A receiver frame: sample sticks, obey gestures, move the motors one pass later."""
        gesture = self.core.evaluate(now, self.live, may_start=self.companion_error == 0)
        if gesture is Gesture.CALIBRATE:
            if self.core.chosen is not None:
                self.eeprom.active = self.core.chosen
                self.load(self.core.chosen)
                self.eeprom.save()
            self.block(now + CALIBRATE_BUSY)
        self._set_sticks()

    def _set_sticks(self) -> None:
        sticks = self.core.stick_input(self.live)
        if sticks != self._next_sticks:
            self._next_sticks = sticks
            self._sticks_at = self._next_pass + _ACTUATION

    def _request_reset(self, at: float) -> None:
        """`R` acts in the receive interrupt."""
        self.rx.release()
        if not (self.generation.reset_gated and self.core.running):
            self._reset_at = at + RESET

    def reboot(self, now: float) -> None:
        """Reset: motors off, everything volatile lost; the first frame received meanwhile is handled after the boot."""
        self.external.clear()
        self.external.start_dead_man_at(now + BOOT_DEAD_MAN)
        self.now = now
        self._out.cut(now)
        self.load(self.eeprom.active)
        self.reset_state(calibrated=False)
        self._reset_loop()
        self.booted_at = now + BOOT
        self.block(self.booted_at)
        for after, text in boot_text(self.generation.label):
            self._out.send(text.encode("ascii"), now + after)
