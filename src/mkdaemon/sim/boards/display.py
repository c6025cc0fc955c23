"""The menus of the boards: pages of 4 lines of 20 characters, turned with keys. Texts are our own.

Source: docs/protocol.md, "Common commands" (keys, page numbers); docs/firmware-notes for what a page too high gives.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

from mkdaemon.protocol.flags import MenuKey
from mkdaemon.protocol.messages import Display, DisplayOld, Menu
from mkdaemon.protocol.wire import WireMessage
from mkdaemon.sim.boards.external import FULL
from mkdaemon.sim.boards.generations import FcGeneration, NcGeneration

if TYPE_CHECKING:
    from mkdaemon.sim.boards.fc import FlightCtrl
    from mkdaemon.sim.boards.nc import NaviCtrl

_COLUMNS: Final = 20
_LINES: Final = 4
_NEW_FORMAT: Final = 0x80
_OLD_LINE: Final = 2
_REFUSAL: Final = "!!! INCOMPATIBLE !!!"


def compose(page: int, *lines: str) -> str:
    """Lay lines out, the page number in brackets at the end of the first."""
    number = f"[{page}]"
    first = (lines[0] if lines else "")[: _COLUMNS - len(number)]
    rows = [first.ljust(_COLUMNS - len(number)) + number, *lines[1:]]
    rows += [""] * (_LINES - len(rows))
    return "".join(row[:_COLUMNS].ljust(_COLUMNS) for row in rows[:_LINES])


class _Pages:
    """Keys and the page shown; shared by both boards."""

    def __init__(self, last: int) -> None:
        self.last = last
        self.shown = 0
        self._obsolete = False

    def turn(self, keys_inverted: int) -> MenuKey:
        """Obey the page keys; return the others."""
        self._obsolete = not keys_inverted & _NEW_FORMAT
        keys = MenuKey(~keys_inverted & 0x0F)
        both = MenuKey.PREVIOUS_PAGE | MenuKey.NEXT_PAGE
        if self._obsolete or not keys:
            return MenuKey.NONE
        if keys & both == both:
            self.shown = 0
        elif keys & MenuKey.PREVIOUS_PAGE:
            self.shown = self.shown - 1 if self.shown else self.last
        elif keys & MenuKey.NEXT_PAGE:
            self.shown = self.shown + 1 if self.shown < self.last else 0
        return keys & ~both

    def wrap(self, text: str) -> WireMessage:
        """Build H in the format that was asked for."""
        if self._obsolete:
            return DisplayOld(line=_OLD_LINE, text=_REFUSAL)
        return Display(text=text)


class FcMenu(_Pages):
    """The FlightCtrl's menu; on page 5 the keys 3 and 4 trim the accelerometer."""

    PRINT: Final = 1.2e-3
    """Time to print a page before it is sent."""
    _TRIM_PAGE: Final = 5

    def __init__(self, generation: FcGeneration) -> None:
        super().__init__(generation.menu_pages)
        self.trim = 0

    def press(self, board: FlightCtrl, keys_inverted: int) -> None:
        """Take the keys of an `h` frame."""
        keys = self.turn(keys_inverted)
        if self.shown == self._TRIM_PAGE and not board.core.running:
            self.trim += bool(keys & MenuKey.KEY_3) - bool(keys & MenuKey.KEY_4)

    def display(self, board: FlightCtrl) -> WireMessage:
        """Build H."""
        return self.wrap(self._text(board, self.shown))

    def page(self, board: FlightCtrl, number: int) -> WireMessage:
        """Build L; a number too high gives an empty page and falls back to page 0."""
        if number > self.last:
            self.shown = 0
            return Menu(page=0, last_page=self.last, text=compose(number))
        self.shown = number
        return Menu(page=number, last_page=self.last, text=self._text(board, number))

    def _text(self, board: FlightCtrl, page: int) -> str:
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
            5: ("Accelerometer", f"Pitch {sensors.acc_x:9.2f}", f"Roll {sensors.acc_y:10.2f}", f"Trim {self.trim:10d}"),
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


class NcMenu(_Pages):
    """The NaviCtrl's menu."""

    PRINT: Final = 0.0

    def __init__(self, generation: NcGeneration) -> None:
        super().__init__(generation.menu_pages)

    def press(self, keys_inverted: int) -> None:
        """Take the keys of an `h` frame."""
        self.turn(keys_inverted)

    def display(self, board: NaviCtrl) -> WireMessage:
        """Build H."""
        return self.wrap(self._text(board, self.shown))

    def page(self, board: NaviCtrl, number: int) -> WireMessage:
        """Build L; a number too high gives the last page."""
        self.shown = min(number, self.last)
        return Menu(page=self.shown, last_page=self.last, text=self._text(board, self.shown))

    def _text(self, board: NaviCtrl, page: int) -> str:
        sensors, core = board.flight.aircraft.sensors, board.flight.core
        gps, sticks = sensors.gps, core.receiver
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
