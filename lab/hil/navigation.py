"""A NaviCtrl that runs genuine firmware, as Python sees it: characters and packets in and out, each at its time."""

from __future__ import annotations

import ctypes
import heapq
import itertools
from collections.abc import Iterable
from enum import IntEnum
from typing import Final

from lab.hil.navibuild import NaviFirmware
from mkdaemon.errors import ConfigError

READ_AT_ONCE: Final = 4096


class Socket(IntEnum):
    """Where characters come from or go to."""

    COMPASS = 0
    HOST = 1
    FLIGHTCTRL = 2
    GPS = 3
    """Shares a UART with the compass board; the firmware chooses."""


class NaviLines(ctypes.Structure):
    """What else crosses the board's edge; see `struct lines` of navictrl.c."""

    _fields_ = (("field", ctypes.c_int16 * 3), ("has_compass", ctypes.c_int16))


class NaviBoard:
    """One NaviCtrl.

    A process has at most one: the firmware keeps its state in its own variables.

    Attributes:
        firmware: that runs.
        lines: what its compass measures.
    """

    def __init__(self, firmware: NaviFirmware) -> None:
        """Power it up.

        Args:
            firmware: to run.

        Raises:
            ConfigError: this process has run one already.
        """
        self.firmware = firmware
        self._library = _load(firmware)
        if self._library.navi_new():
            raise ConfigError(f"{firmware.name}: this process has powered up a NaviCtrl already")
        self.lines: NaviLines = self._library.navi_lines().contents
        self._inbox: list[tuple[float, int, Socket, int]] = []
        self._order = itertools.count()
        self._bytes = ctypes.create_string_buffer(READ_AT_ONCE)
        self._times = (ctypes.c_double * READ_AT_ONCE)()

    @property
    def now(self) -> float:
        """Time since power-up [s]."""
        return float(self._library.navi_time())

    def receive(self, socket: Socket, arrivals: Iterable[tuple[float, int]]) -> None:
        """Let characters arrive, each with the time of its last bit [s], not before `now`."""
        for at, byte in arrivals:
            heapq.heappush(self._inbox, (at, next(self._order), socket, byte))

    def run(self, until: float) -> None:
        """Run on until a time [s], and hand it every character at its own."""
        inbox, library = self._inbox, self._library
        while inbox and inbox[0][0] <= until:
            at, _, socket, byte = heapq.heappop(inbox)
            library.navi_run(at)
            is_gps = socket is Socket.GPS
            library.navi_receive(0 if is_gps else socket.value, is_gps, byte)
        library.navi_run(until)

    def exchange(self, at: float, byte: int) -> int:
        """One byte each way on the bus of the FlightCtrl at a time [s]: the byte it says."""
        self.run(at)
        return int(self._library.navi_exchange(at, byte))

    def read(self, socket: Socket) -> list[tuple[float, int]]:
        """Characters that left a UART: the time of the last bit [s], and the character."""
        count = self._library.navi_read(socket.value, self._bytes, self._times, READ_AT_ONCE)
        return list(zip(self._times[:count], self._bytes.raw[:count], strict=True))

    @property
    def exchange_address(self) -> int:
        """Of the function that another board's bus calls for a byte; see `navi_exchange` of navictrl.c."""
        return int(ctypes.cast(self._library.navi_exchange, ctypes.c_void_p).value or 0)


def _load(firmware: NaviFirmware) -> ctypes.CDLL:
    library = ctypes.CDLL(str(firmware.library))
    types = {
        "time": (ctypes.c_double,),
        "lines": (ctypes.POINTER(NaviLines),),
        "run": (None, ctypes.c_double),
        "receive": (None, ctypes.c_int, ctypes.c_int, ctypes.c_uint8),
        "read": (ctypes.c_int, ctypes.c_int, ctypes.c_char_p, ctypes.POINTER(ctypes.c_double), ctypes.c_int),
        "exchange": (ctypes.c_uint8, ctypes.c_double, ctypes.c_uint8),
    }
    for name, (result, *arguments) in types.items():
        function = getattr(library, f"navi_{name}")
        function.restype, function.argtypes = result, arguments
    return library
