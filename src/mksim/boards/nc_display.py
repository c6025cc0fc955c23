"""The pages of the NaviCtrl's menu. Texts are our own.

Source: docs/protocol.md, "Common commands"; docs/firmware-notes for what a page too high gives.
"""

from __future__ import annotations

from mkdaemon.protocol.messages import Menu
from mkdaemon.protocol.wire import WireMessage
from mksim.boards.display import compose
from mksim.boards.external import FULL
from mksim.boards.nc_board import NcBoard


def display(board: NcBoard) -> WireMessage:
    """Build H."""
    return board.menu.wrap(_text(board, board.menu.shown))


def menu(board: NcBoard, number: int) -> WireMessage:
    """Build L; a number too high gives the last page."""
    pages = board.menu
    pages.shown = min(number, pages.last)
    return Menu(page=pages.shown, last_page=pages.last, text=_text(board, pages.shown))


def _text(board: NcBoard, page: int) -> str:
    sensors, core = board.flight.aircraft.sensors, board.flight.core
    gps, sticks = board.navigator.fix, core.receiver
    major, minor, patch = board.generation.release
    error = board.navigator.error_code
    fix = f"Sat {gps.satellites:2d} {'3D fix' if gps.has_fix else 'no fix'}"
    east, north, up = gps.velocity_enu
    pages: dict[int, tuple[str, ...]] = {
        0: (
            "NaviCtrl",
            f"HW 2.0  SW {major}.{minor:02d}{chr(ord('a') + patch)}",
            f"Error {error:3d}",
        ),
        1: (
            fix,
            f"Lon {gps.longitude_1e7 / 1e7:12.7f}",
            f"Lat {gps.latitude_1e7 / 1e7:12.7f}",
            f"Alt {gps.altitude:9.2f} m",
        ),
        2: (
            fix,
            f"North {north * 100:+5.0f} cm/s",
            f"East  {east * 100:+5.0f} cm/s",
            f"Up    {up * 100:+5.0f} cm/s",
        ),
        3: ("Time", f"{board.flight.now:10.1f} s"),
        4: ("Mode", board.navigator.mode_name),
        5: ("Range", f"Radius {board.navigator.operating_radius:4d} m"),
        7: ("Home", *(f"{value / 1e7:12.7f}" for value in board.navigator.home)),
        8: (
            "Sticks",
            f"Pit{sticks.pitch:5.0f} Rol{sticks.roll:5.0f}",
            f"Thr{sticks.throttle + FULL:5.0f} Yaw{sticks.yaw:5.0f}",
        ),
        9: ("Potis 1", *(f"{core.potis[i]:5d}{core.potis[i + 1]:5d}" for i in (0, 2))),
        10: ("Potis 2", *(f"{core.potis[i]:5d}{core.potis[i + 1]:5d}" for i in (4, 6))),
        13: (
            f"RC level {core.quality:3d}",
            f"Battery {sensors.battery_voltage:5.1f} V",
            f"Compass {sensors.compass_deg:4.0f}",
        ),
        15: ("Magnetic field", "X -101", "Y -172", "Z  420"),
    }
    return compose(page, *pages.get(page, (f"Page {page}",)))
