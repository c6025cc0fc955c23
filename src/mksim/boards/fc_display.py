"""The pages of the FlightCtrl's menu. Texts are our own.

Source: docs/protocol.md, "Common commands"; docs/firmware-notes for what a page too high gives.
"""

from __future__ import annotations

import math
from typing import Final

from mkdaemon.protocol.flags import MenuKey
from mkdaemon.protocol.messages import Menu
from mkdaemon.protocol.wire import WireMessage
from mksim.boards.display import compose
from mksim.boards.fc_board import FcBoard

PRINT: Final = 1.2e-3
"""Time to print a page before it is sent."""
_TRIM_PAGE: Final = 5
"""The accelerometer's page: keys 3 and 4 trim it."""


def press_keys(board: FcBoard, keys_inverted: int) -> None:
    """Take the keys of an `h` frame."""
    keys = board.menu.turn(keys_inverted)
    if board.menu.shown == _TRIM_PAGE and not board.core.running:
        board.trim += bool(keys & MenuKey.KEY_3) - bool(keys & MenuKey.KEY_4)


def display(board: FcBoard) -> WireMessage:
    """Build H."""
    return board.menu.wrap(_text(board, board.menu.shown))


def menu(board: FcBoard, number: int) -> WireMessage:
    """Build L; a number too high gives an empty page and falls back to page 0."""
    pages = board.menu
    if number > pages.last:
        pages.shown = 0
        return Menu(page=0, last_page=pages.last, text=compose(number))
    pages.shown = number
    return Menu(page=number, last_page=pages.last, text=_text(board, number))


def _text(board: FcBoard, page: int) -> str:
    sensors, core, live = board.aircraft.sensors, board.core, board.live
    sticks, potis = core.receiver, core.potis
    motors = sensors.motor_setpoints
    pages: dict[int, tuple[str, ...]] = {
        0: (
            "FlightCtrl",
            f"HW 2.2  SW {board.generation.label}",
            f"Set {board.eeprom.active}  Mixer {board.eeprom.mixer[1:13].split(bytes(1))[0].decode('latin-1')}",
            "Motors running" if core.running else "",
        ),
        1: ("Height", f"Height {sensors.baro_height * 20:8.0f}", f"Climb {sensors.vertical_speed:9.1f}"),
        2: (
            "Attitude",
            f"Pitch  {math.degrees(sensors.fc_angle_pitch):8.1f}",
            f"Roll   {-math.degrees(sensors.fc_angle_roll):8.1f}",
            f"Compass{sensors.compass_deg:8.0f}",
        ),
        3: (
            "Receiver",
            f"Thr{sticks.throttle:6.0f} Pit{sticks.pitch:6.0f}",
            f"Rol{sticks.roll:6.0f} Yaw{sticks.yaw:6.0f}",
            f"Level{core.quality:6d}",
        ),
        4: (
            "Settings",
            f"StickP {live['stick_p']:3d} GyroP {live['gyro_p']:3d}",
            f"GyroI {live['gyro_i']:4d} IF {live['integral_factor']:4d}",
        ),
        5: ("Accelerometer", f"Pitch {sensors.acc_x:9.2f}", f"Roll {sensors.acc_y:10.2f}", f"Trim {board.trim:10d}"),
        6: ("Battery", f"{sensors.battery_voltage:6.1f} V", f"{sensors.battery_current:6.1f} A"),
        7: (
            "External control",
            f"Gate {'open' if core.gate_open else 'closed'}",
            f"Held {'valid' if board.external.is_valid else 'none'}",
            f"Poti1 {potis[0]:4d}",
        ),
        8: ("Motors", f"{motors[0]:5d}{motors[1]:5d}{motors[2]:5d}{motors[3]:5d}"),
        10: ("Potis", *(f"{potis[i]:5d}{potis[i + 1]:5d}" for i in (0, 2, 4))),
        19: ("Motor controllers", "2.08 2.08 2.08 2.08"),
    }
    return compose(page, *pages.get(page, (f"Page {page}",)))
