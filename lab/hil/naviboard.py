"""A NaviCtrl that runs genuine firmware, and what it meets: characters and packets in and out, each at its time.

Its GPS receiver sends three UBX messages a report (u-blox 5 protocol specification, NAV-SOL, NAV-POSLLH, NAV-VELNED).
"""

from __future__ import annotations

import ctypes
import heapq
import itertools
import math
import struct
from collections.abc import Iterable
from enum import IntEnum
from pathlib import Path
from typing import Final

import numpy as np

from mkdaemon.errors import ConfigError
from mksim.boards.line import HOST_CHAR
from mksim.physics.sensors import GpsReport
from mksim.physics.world import World

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
        lines: what its compass measures.
    """

    def __init__(self, firmware: Path) -> None:
        """Power it up, with its library; see `built_navictrl`.

        Raises:
            ConfigError: this process has run one already.
        """
        self._library = _load(firmware)
        if self._library.navi_new():
            raise ConfigError("this process has powered up a NaviCtrl already")
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

    def read(self, socket: Socket) -> list[tuple[float, int]]:
        """Characters that left a UART: the time of the last bit [s], and the character."""
        count = self._library.navi_read(socket.value, self._bytes, self._times, READ_AT_ONCE)
        return list(zip(self._times[:count], self._bytes.raw[:count], strict=True))

    @property
    def exchange_address(self) -> int:
        """Of the function that another board's bus calls for a byte; see `navi_exchange` of navictrl.c."""
        return int(ctypes.cast(self._library.navi_exchange, ctypes.c_void_p).value or 0)


def _load(firmware: Path) -> ctypes.CDLL:
    library = ctypes.CDLL(str(firmware))
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


WEEK: Final = 2421
"""GPS week of the flight, June 2026."""
MONDAY_NOON_MS: Final = (24 + 12) * 3_600_000
"""Time of week when a flight begins [ms]."""
FIX_3D: Final = 3
VALID: Final = 0x0D
"""Flags: the fix is good, week and time of week are set."""
NAV: Final = 0x01
SOLUTION, POSITION, VELOCITY = 0x06, 0x02, 0x12


def report(fix: GpsReport) -> bytes:
    """The messages of one report, as they follow each other on the line."""
    time = MONDAY_NOON_MS + round(fix.at * 1000)
    east, north, up = (round(part * 100.0) for part in fix.velocity_enu)
    course = round(math.degrees(math.atan2(east, north)) % 360.0 * 1e5)
    ground = round(math.hypot(east, north))
    kind, flags = (FIX_3D, VALID) if fix.has_fix else (0, VALID & ~1)
    height = round(fix.altitude * 1000.0)
    solution = struct.pack(
        "<IihBB3iI3iIHBBI", time, 0, WEEK, kind, flags, 0, 0, 0, 250, 0, 0, 0, 50, 150, 0, fix.satellites, 0
    )
    place = struct.pack("<IiiiiII", time, fix.longitude_1e7, fix.latitude_1e7, height, height, 2500, 4000)
    speed = round(math.sqrt(east * east + north * north + up * up))
    velocity = struct.pack("<IiiiIIiII", time, north, east, -up, speed, ground, course, 50, 100_000)
    return message(SOLUTION, solution) + message(POSITION, place) + message(VELOCITY, velocity)


def message(kind: int, payload: bytes) -> bytes:
    """A UBX message of the class NAV."""
    body = struct.pack("<BBH", NAV, kind, len(payload)) + payload
    first = second = 0
    for byte in body:
        first = (first + byte) & 0xFF
        second = (second + first) & 0xFF
    return b"\xb5\x62" + body + bytes((first, second))


LEVEL_FIELD: Final = 200.0
DOWN_FIELD: Final = 420.0
"""Of the earth, in counts of the compass board."""
FIRST_REPORT: Final = 5.0
"""Of the GPS receiver, which takes longer to start than both boards [s]."""


class Surroundings:
    """The compass and the GPS receiver of a NaviCtrl, in a simulated world."""

    def __init__(self, world: World) -> None:
        self._world, self._sequence, self._free_at = world, -1, 0.0

    def tend(self, board: NaviBoard, now: float) -> None:
        """Let the compass measure, and the receiver send what it has new."""
        enu_from_flu = self._world.truth.enu_from_flu
        forward, left, up = enu_from_flu.T @ np.array((0.0, LEVEL_FIELD, -DOWN_FIELD))
        board.lines.field[:] = [round(float(part)) for part in (forward, -left, -up)]
        board.lines.has_compass = 1
        fix = self._world.sensors.gps
        if fix.sequence == self._sequence or now < FIRST_REPORT:
            return
        self._sequence = fix.sequence
        begin = max(now, self._free_at)
        said = report(fix)
        board.receive(Socket.GPS, ((begin + k * HOST_CHAR, byte) for k, byte in enumerate(said, 1)))
        self._free_at = begin + len(said) * HOST_CHAR
