"""What a GPS receiver of the proving ground says to a genuine NaviCtrl: three UBX messages a report.

Source: u-blox 5 protocol specification, NAV-SOL, NAV-POSLLH, NAV-VELNED.
"""

from __future__ import annotations

import math
import struct
from typing import Final

from mksim.physics.sensors import GpsReport

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
