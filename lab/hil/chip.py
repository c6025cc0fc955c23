"""The board as Python sees it: levels in, set points and bytes out, a look into the firmware's memory, and its EEPROM.

The firmware writes its factory sets itself, into an empty EEPROM at its first start. Then each is changed as its owner
would: receiver by pulse train, external control on potentiometer 1.
"""

from __future__ import annotations

import ctypes
import struct
from collections import deque
from typing import Final, NamedTuple

from lab.hil.build import FIRMWARE, LIBRARY, Firmware
from lab.hil.processes import aside
from mkdaemon.errors import ConfigError
from mkdaemon.protocol.settings import Layout, ParameterSet, known_revisions, layout_of, poti_reference

READ_AT_ONCE: Final = 4096
SHIFT_OUTPUT: Final = 0x47
"""OCR0A, the output that shifts the barometer's amplifier, in the memory of each processor (ATmega data sheets)."""
Held = tuple[int, int, int, int, bool]
"""External control as a FlightCtrl holds it: pitch, roll, yaw, throttle, whether it is valid."""


class Lines(ctypes.Structure):
    """What crosses the board's edge; see `struct lines` of board.c."""

    _fields_ = (
        ("analog", ctypes.c_double * 8),
        ("noise", ctypes.c_double * 8),
        ("motor", ctypes.c_double * 12),
        ("channel", ctypes.c_int32 * 16),
        ("channels", ctypes.c_int32),
        ("is_receiving", ctypes.c_int32),
        ("motors", ctypes.c_int32),
        ("shift_address", ctypes.c_int32),
    )


class Control(NamedTuple):
    """External control as a generation lays it out; facts of its `uart.h`.

    Attributes:
        symbol: name of the variable.
        pitch: byte of the pitch command; roll and yaw follow it, and the throttle follows them.
        config: byte whose lowest bit says that it is valid.
        throttle: format of the throttle; unsigned where older firmware takes counts of its own stick, 0 to 255.
    """

    symbol: str
    pitch: int
    config: int
    throttle: str


GENERATIONS: Final = (
    Control("ExternalControl", pitch=0, config=5, throttle="b"),
    Control("ExternControl", pitch=3, config=10, throttle="B"),
)
"""Seven bytes since 0.90, and eleven with two digital inputs and a height before."""


def control_of(firmware: Firmware) -> Control:
    """How this firmware lays external control out.

    Raises:
        ConfigError: it has no external control.
    """
    for generation in GENERATIONS:
        if generation.symbol in firmware.symbols:
            return generation
    names = " nor ".join(one.symbol for one in GENERATIONS)
    raise ConfigError(f"firmware {firmware.name} has neither {names} among its variables: it takes no external control")


class Chip:
    """A FlightCtrl that runs genuine firmware.

    Attributes:
        firmware: that runs.
        lines: levels and pulses in, motors out.
        inbox: bytes on their way to its serial input, with the times of their last bits [s].
    """

    def __init__(self, firmware: Firmware, eeprom: bytes, *, seed: int) -> None:
        """Power it up, with the content of its EEPROM and a seed of the noise of its conversions.

        Raises:
            ConfigError: the firmware cannot be loaded.
        """
        self.firmware, self.inbox = firmware, deque[tuple[float, int]]()
        self._library = _load()
        self._content = ctypes.create_string_buffer(eeprom, len(eeprom))
        elf, mcu = str(firmware.elf).encode(), firmware.mcu.encode()
        with aside():  # simavr tells what it loads
            self._board = self._library.board_new(elf, mcu, firmware.frequency, self._content, len(eeprom), seed)
        if not self._board:
            raise ConfigError(f"{firmware.elf}: not a program of an {firmware.mcu}")
        self._bytes = ctypes.create_string_buffer(READ_AT_ONCE)
        self._times = (ctypes.c_double * READ_AT_ONCE)()
        self.lines: Lines = self._library.board_lines(self._board).contents
        self.lines.motors = 4
        self.lines.shift_address = SHIFT_OUTPUT

    @property
    def now(self) -> float:
        """Time since power-up [s]."""
        return float(self._library.board_time(self._board))

    def run(self, seconds: float) -> None:
        """Run on.

        Raises:
            RuntimeError: the processor stopped.
        """
        state = self._library.board_run(self._board, seconds)
        if state:
            name = self.firmware.name
            raise RuntimeError(f"{name}: the processor stopped (simavr state {state}) at {self.now:.3f} s")

    def run_to(self, until: float, now: float | None = None) -> None:
        """Run on to a time, from now on by default, and hand it every byte of `inbox` at its own [s]."""
        now = self.now if now is None else now
        while self.inbox and self.inbox[0][0] <= until:
            at, byte = self.inbox.popleft()
            if at > now:
                self.run(at - now)
                now = at
            self._library.board_receive(self._board, byte)
        self.run(until - now)

    def read(self) -> list[tuple[float, int]]:
        """Bytes that left its serial output: the time of the last bit [s], and the byte."""
        count = self._library.board_read(self._board, self._bytes, self._times, READ_AT_ONCE)
        return list(zip(self._times[:count], self._bytes.raw[:count], strict=True))

    def connect(self, exchange: int) -> None:
        """Connect a board to its SPI bus: the address of a function that answers a byte at a time [s] with another."""
        self._library.board_connect(self._board, exchange)

    def reset(self) -> None:
        """Start the processor anew, as a dip of its supply does."""
        self._library.board_reset(self._board)

    def eeprom(self) -> bytes:
        """What its EEPROM holds now."""
        content = ctypes.create_string_buffer(len(self._content))
        self._library.board_eeprom(self._board, content, len(content))
        return content.raw

    def peek(self, symbol: str, kind: str, offset: int = 0) -> int:
        """A variable of the firmware; `kind` is a format of `struct`, for example `<h`."""
        content = ctypes.create_string_buffer(struct.calcsize(kind))
        self._library.board_peek(self._board, self.firmware.symbols[symbol] + offset, content, len(content))
        return int(struct.unpack(kind, content.raw)[0])

    def held(self, control: Control) -> Held:
        """External control as its memory holds it."""
        pitch, roll, yaw = (self.peek(control.symbol, "b", control.pitch + place) for place in range(3))
        throttle = self.peek(control.symbol, control.throttle, control.pitch + 3)
        return pitch, roll, yaw, throttle, bool(self.peek(control.symbol, "B", control.config) & 1)

    def poke(self, symbol: str, data: bytes) -> None:
        """Write into a variable of the firmware, for parts of the aircraft that talk over its SPI."""
        self._library.board_poke(self._board, self.firmware.symbols[symbol], data, len(data))


def _load() -> ctypes.CDLL:
    """The library, with the types of its functions.

    Raises:
        ConfigError: it was built from other sources than these.
    """
    library = ctypes.CDLL(str(LIBRARY))
    board, text, number, pointer = ctypes.c_void_p, ctypes.c_char_p, ctypes.c_int, ctypes.c_void_p
    types = {
        "new": (board, text, text, ctypes.c_uint32, text, number, ctypes.c_uint64),
        "lines": (ctypes.POINTER(Lines), board),
        "time": (ctypes.c_double, board),
        "run": (number, board, ctypes.c_double),
        "receive": (number, board, ctypes.c_uint8),
        "read": (number, board, text, pointer, number),
        "peek": (number, board, number, text, number),
        "poke": (number, board, number, text, number),
        "connect": (number, board, pointer),
        "eeprom": (number, board, text, number),
        "reset": (number, board),
    }
    for name, (result, *arguments) in types.items():
        try:
            function = getattr(library, f"board_{name}")
        except AttributeError as error:
            again = "make hil FIRMWARE=<folder> SIMAVR=<folder> once more"
            raise ConfigError(f"{LIBRARY} was built from older sources ({error}): {again}") from None
        function.restype, function.argtypes = result, arguments
    return library


SIZES: Final = {"atmega1284p": 4096, "atmega644p": 2048, "atmega644": 2048}
"""[byte]."""
FIRST_START: Final = 20.0
"""Time after which the firmware has written everything [s]; 2.12a needs 12."""
QUIET_LEVELS: Final = (512.3, 512.3, 512.3, 800.0 + 190 * 52.0, 14.8 * 31, 512.0 + 170, 512.0, 512.0)
"""Analog channels of an aircraft at rest [LSB]."""
STEP: Final = 0.005
"""[s]."""
SETTINGS: Final = {"receiver": 0, "external_control": poti_reference(1)}
"""Changed in every set: the pulse train of one cable, the gate."""
NEUTRAL: Final = (512).to_bytes(2, "little")
ACCELEROMETER: Final = 4
"""Where every generation from 0.84 to 2.12 keeps the two lateral neutral values of its accelerometer: that is
calibrated once in the life of a board, on a level table."""


def eeprom_of(firmware: Firmware) -> bytes:
    """The EEPROM of a board that flies; made once and kept beside the firmware.

    Raises:
        ConfigError: the firmware wrote no parameter set whose layout is known.
    """
    path = FIRMWARE / firmware.name / "eeprom.bin"
    if not path.exists():
        path.write_bytes(_make(firmware))
    return path.read_bytes()


def _make(firmware: Firmware) -> bytes:
    chip = Chip(firmware, b"\xff" * SIZES[firmware.mcu], seed=1)
    chip.lines.analog[:] = QUIET_LEVELS
    said = bytearray()
    while chip.now < FIRST_START:
        chip.run(STEP)
        said += bytes(byte for _, byte in chip.read())
    stored = bytearray(chip.eeprom())
    layouts = [layout for revision in known_revisions() if (layout := layout_of(revision)) is not None]
    found = [
        (start, layout)
        for layout in layouts
        for start in range(len(stored) - layout.size)
        if _is_set(stored, start, layout)
    ]
    if not found:
        raise ConfigError(f"{firmware.name}: no parameter set of a known revision in its EEPROM; it said: {said!r}")
    for start, layout in found:
        changed = ParameterSet.from_payload(bytes(stored[start : start + layout.size])).replaced(SETTINGS)
        stored[start : start + layout.size] = changed.raw
        stored[start + layout.size] = _checksum(changed.raw)
    stored[ACCELEROMETER : ACCELEROMETER + 4] = NEUTRAL + NEUTRAL
    return bytes(stored)


def _checksum(raw: bytes) -> int:
    return (0xAA + sum(raw)) & 0xFF


def _is_set(stored: bytearray, start: int, layout: Layout) -> bool:
    """Whether a parameter set of this layout begins here; its checksum follows it."""
    raw = stored[start : start + layout.size]
    is_named = raw[-12:].split(b"\0")[0].isalnum()
    return raw[0] == layout.revision and is_named and stored[start + layout.size] == _checksum(bytes(raw))
