"""The board as Python sees it: levels in, set points and bytes out, and a look into the firmware's memory."""

from __future__ import annotations

import ctypes
import struct
from dataclasses import dataclass
from typing import Final

from lab.hil.build import LIBRARY, Firmware
from lab.hil.quiet import aside
from mkdaemon.errors import ConfigError

ANALOG: Final = 8
MOTORS: Final = 12
CHANNELS: Final = 16
READ_AT_ONCE: Final = 4096
TAKEN_AT_ONCE: Final = 64
FRAME: Final = 48
HELD: Final = 16
"""Bytes that are kept of a received frame, and of external control."""
BUFFER: Final = ("NeuerDatensatzEmpfangen", "AnzahlEmpfangsBytes", "RxdBuffer")
"""The firmware's variables of its receive buffer: a frame waits, its length, its bytes (uart.c)."""
SHIFT_OUTPUTS: Final = {"atmega1284p": 0x47, "atmega644p": 0x47, "atmega644": 0x47}
"""OCR0A, the output that shifts the barometer's amplifier, in the memory of each processor (ATmega data sheets)."""
EEPROM_SIZES: Final = {"atmega1284p": 4096, "atmega644p": 2048, "atmega644": 2048}
"""[byte]."""


class Lines(ctypes.Structure):
    """What crosses the board's edge; see `struct lines` of board.c."""

    _fields_ = (
        ("analog", ctypes.c_double * ANALOG),
        ("noise", ctypes.c_double * ANALOG),
        ("motor", ctypes.c_double * MOTORS),
        ("channel", ctypes.c_int32 * CHANNELS),
        ("channels", ctypes.c_int32),
        ("is_receiving", ctypes.c_int32),
        ("motors", ctypes.c_int32),
        ("shift_address", ctypes.c_int32),
    )


class _Taken(ctypes.Structure):
    """A frame in the receive buffer; see `struct taken` of board.c."""

    _fields_ = (
        ("at", ctypes.c_double),
        ("done", ctypes.c_double),
        ("length", ctypes.c_int32),
        ("frame", ctypes.c_uint8 * FRAME),
        ("held", ctypes.c_uint8 * HELD),
    )


@dataclass(frozen=True, slots=True)
class TakenFrame:
    """A frame that the firmware had in its receive buffer.

    Attributes:
        at: when the buffer had it whole [s].
        done: when the main loop had handled it, and the buffer was free again [s].
        frame: its bytes, the first `FRAME` of a longer one.
        held: the firmware's variable of external control at `done`.
    """

    at: float
    done: float
    frame: bytes
    held: bytes


class Chip:
    """A FlightCtrl that runs genuine firmware.

    Attributes:
        firmware: that runs.
        lines: levels and pulses in, motors out.
    """

    def __init__(self, firmware: Firmware, eeprom: bytes, *, seed: int) -> None:
        """Power it up.

        Args:
            firmware: to run.
            eeprom: its content, as long as the processor's.
            seed: of the noise of its conversions.

        Raises:
            ConfigError: the firmware cannot be loaded.
        """
        self.firmware = firmware
        self._library = _load()
        content = ctypes.create_string_buffer(eeprom, len(eeprom))
        with aside():  # simavr tells what it loads
            self._board = self._library.board_new(
                str(firmware.elf).encode(), firmware.mcu.encode(), firmware.frequency, content, len(eeprom), seed
            )
        if not self._board:
            raise ConfigError(f"{firmware.elf}: not a program of an {firmware.mcu}")
        self._content = content
        self._bytes = ctypes.create_string_buffer(READ_AT_ONCE)
        self._times = (ctypes.c_double * READ_AT_ONCE)()
        self._taken = (_Taken * TAKEN_AT_ONCE)()
        self.lines: Lines = self._library.board_lines(self._board).contents
        self.lines.motors = 4
        self.lines.shift_address = SHIFT_OUTPUTS[firmware.mcu]

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

    def receive(self, byte: int) -> None:
        """Hand its serial input a byte whose last bit arrives now."""
        self._library.board_receive(self._board, byte)

    def read(self) -> list[tuple[float, int]]:
        """Bytes that left its serial output: the time of the last bit [s], and the byte."""
        count = self._library.board_read(self._board, self._bytes, self._times, READ_AT_ONCE)
        raw = self._bytes.raw
        return [(self._times[i], raw[i]) for i in range(count)]

    def watch_frames(self, control: str) -> None:
        """Keep every frame that the firmware receives from now on, for `taken`.

        Args:
            control: name of the firmware's variable of external control.
        """
        symbols = self.firmware.symbols
        self._library.board_watch(self._board, *(symbols[name] for name in (*BUFFER, control)))

    def taken(self) -> list[TakenFrame]:
        """Frames that the main loop has handled since the last call; call it at least once a second."""
        found = []
        while count := self._library.board_taken(self._board, self._taken, TAKEN_AT_ONCE):
            found += [
                TakenFrame(each.at, each.done, bytes(each.frame[: each.length]), bytes(each.held))
                for each in self._taken[:count]
            ]
        return found

    def connect(self, exchange: int) -> None:
        """Connect a board to its SPI bus: the address of a function that answers a byte at a time [s] with another."""
        self._library.board_connect(self._board, exchange)

    def reset(self) -> None:
        """Start the processor anew, as a dip of its supply does."""
        self._library.board_reset(self._board)

    def eeprom(self) -> bytes:
        """What its EEPROM holds now."""
        size = len(self._content)
        content = ctypes.create_string_buffer(size)
        self._library.board_eeprom(self._board, content, size)
        return content.raw

    def knows(self, symbol: str) -> bool:
        """Whether the firmware has a variable of this name."""
        return symbol in self.firmware.symbols

    def peek(self, symbol: str, kind: str, offset: int = 0) -> int:
        """A variable of the firmware; `kind` is a format of `struct`, for example `<h`."""
        size = struct.calcsize(kind)
        content = ctypes.create_string_buffer(size)
        self._library.board_peek(self._board, self.firmware.symbols[symbol] + offset, content, size)
        return int(struct.unpack(kind, content.raw)[0])

    def poke(self, symbol: str, data: bytes, offset: int = 0) -> None:
        """Write into a variable of the firmware, for parts of the aircraft that talk over its SPI."""
        self._library.board_poke(self._board, self.firmware.symbols[symbol] + offset, data, len(data))


def _load() -> ctypes.CDLL:
    """The library, with the types of its functions.

    Raises:
        ConfigError: it was built from other sources than these.
    """
    library = ctypes.CDLL(str(LIBRARY))
    try:
        _describe(library)
    except AttributeError as error:
        msg = f"{LIBRARY} was built from older sources ({error}): make hil FIRMWARE=<folder> SIMAVR=<folder> once more"
        raise ConfigError(msg) from None
    return library


def _describe(library: ctypes.CDLL) -> None:
    board, text = ctypes.c_void_p, ctypes.c_char_p
    library.board_new.restype = board
    library.board_new.argtypes = [text, text, ctypes.c_uint32, text, ctypes.c_int, ctypes.c_uint64]
    library.board_lines.restype = ctypes.POINTER(Lines)
    library.board_time.restype = ctypes.c_double
    library.board_run.argtypes = [board, ctypes.c_double]
    library.board_receive.argtypes = [board, ctypes.c_uint8]
    library.board_read.argtypes = [board, text, ctypes.c_void_p, ctypes.c_int]
    library.board_peek.argtypes = library.board_poke.argtypes = [board, ctypes.c_int, text, ctypes.c_int]
    library.board_connect.argtypes = [board, ctypes.c_void_p]
    library.board_watch.argtypes = [board, *(ctypes.c_int,) * 4]
    library.board_taken.argtypes = [board, ctypes.c_void_p, ctypes.c_int]
    library.board_eeprom.argtypes = [board, text, ctypes.c_int]
    for name in ("board_lines", "board_time", "board_reset"):
        getattr(library, name).argtypes = [board]
