"""A gamepad whose events come through a socket: evdev reads the kernel's own structs, but no kernel made them.

For machines without `/dev/uinput`. What only a device file can answer, its state and its capabilities, is kept here.
"""

from __future__ import annotations

import errno
import socket
import struct
import time
from collections.abc import Mapping
from typing import Any, Final, cast

from evdev import AbsInfo, DeviceInfo, ecodes
from evdev.eventio import EventIO

XBOX_360: Final = (0x045E, 0x028E)
"""Vendor and product of the wired Xbox 360 controller; drivers/input/joystick/xpad.c."""
STICK: Final = (-32768, 32767)
TRIGGER: Final = (0, 255)
HAT: Final = (-1, 1)
AXES: Final[Mapping[str, tuple[int, int]]] = {
    "ABS_X": STICK,
    "ABS_Y": STICK,
    "ABS_RX": STICK,
    "ABS_RY": STICK,
    "ABS_Z": TRIGGER,
    "ABS_RZ": TRIGGER,
    "ABS_HAT0X": HAT,
    "ABS_HAT0Y": HAT,
}
BUTTONS: Final = (
    "BTN_SOUTH", "BTN_EAST", "BTN_NORTH", "BTN_WEST", "BTN_TL", "BTN_TR", "BTN_SELECT", "BTN_START", "BTN_MODE",
    "BTN_THUMBL", "BTN_THUMBR",
)  # fmt: skip
_EVENT: Final = struct.Struct("llHHi")
"""`struct input_event` of a 64-bit machine; include/uapi/linux/input.h."""


class PipedPad:
    """A pad as the xpad driver shows it.

    Attributes:
        shaken: how often it was told to shake.
    """

    def __init__(self, path: str = "/dev/input/event99", *, bustype: int = 3, ids: tuple[int, int] = XBOX_360) -> None:
        self._reading, self._writing = socket.socketpair()
        self._reading.setblocking(False)
        self.fd = self._reading.fileno()
        self.path, self.name = path, "Microsoft X-Box 360 pad"
        self.info = DeviceInfo(bustype, *ids, 0x110)
        self._axes = dict.fromkeys((ecodes.ecodes[name] for name in AXES), 0)
        self._pressed: set[int] = set()
        self._is_gone = False
        self.shaken = 0

    def capabilities(self, verbose: bool = False, absinfo: bool = True) -> dict[int, list[Any]]:
        """What it has."""
        ranges = {ecodes.ecodes[name]: span for name, span in AXES.items()}
        return {
            ecodes.EV_ABS: [(code, AbsInfo(0, low, high, 16, 128, 0)) for code, (low, high) in ranges.items()],
            ecodes.EV_KEY: [ecodes.ecodes[name] for name in BUTTONS],
            ecodes.EV_FF: [ecodes.FF_RUMBLE],
        }

    def absinfo(self, axis_num: int) -> AbsInfo:
        """Where an axis stands."""
        self._require()
        return AbsInfo(self._axes[axis_num], 0, 0, 0, 0, 0)

    def active_keys(self, verbose: bool = False) -> list[int]:
        """Which buttons are pressed."""
        self._require()
        return sorted(self._pressed)

    def read(self) -> Any:
        """Events that wait."""
        self._require()
        return EventIO.read(cast("EventIO", self))

    def upload_effect(self, effect: object) -> int:
        """Take an effect."""
        return 1

    def write(self, etype: int, code: int, value: int) -> None:
        """Take an event to the device: that it shakes."""
        self.shaken += 1

    def close(self) -> None:
        """Close both ends."""
        self._reading.close()
        self._writing.close()

    def move(self, **controls: int) -> None:
        """Move axes and press buttons; each is an event, as the kernel writes them, with one at the end."""
        for name, value in controls.items():
            code = ecodes.ecodes[name]
            is_axis = name.startswith("ABS")
            if is_axis:
                self._axes[code] = value
            elif value:
                self._pressed.add(code)
            else:
                self._pressed.discard(code)
            self._send(ecodes.EV_ABS if is_axis else ecodes.EV_KEY, code, value)
        self._send(ecodes.EV_SYN, ecodes.SYN_REPORT, 0)

    def unplug(self) -> None:
        """Be gone: reading and asking fail as the kernel lets them fail."""
        self._is_gone = True
        self._send(ecodes.EV_SYN, ecodes.SYN_REPORT, 0)

    def _send(self, kind: int, code: int, value: int) -> None:
        micros = time.time_ns() // 1000
        self._writing.send(_EVENT.pack(micros // 1_000_000, micros % 1_000_000, kind, code, value))

    def _require(self) -> None:
        if self._is_gone:
            raise OSError(errno.ENODEV, "No such device")
