"""Gamepads of this machine by evdev: found, asked for their state, and followed as they are connected and disconnected.

A pad reports only changes, so a stick that stands still and one whose cable broke look alike in its events: the kernel
is asked for every axis (EVIOCGABS) and every button (EVIOCGKEY) at every setpoint. Source: the kernel's
Documentation/input/input.rst and include/uapi/linux/input.h.
"""

from __future__ import annotations

import asyncio
import errno
import importlib
from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import dataclass
from types import ModuleType
from typing import Any, Final

from mkdaemon.cli.mkctl.teleop.devices import DeviceLostError, DeviceState
from mkdaemon.client.teleop.inputs import AxisRange, PadFacts
from mkdaemon.errors import MkError

BLUETOOTH: Final = 5
"""Bus of a Bluetooth device; BUS_BLUETOOTH in input.h."""
SHAKE_MS: Final = 400
"""How long a pad shakes [ms]; the unit of the kernel's `struct ff_replay`."""
STRENGTH: Final = 0xC000
"""Of both motors, 0..0xffff."""
_GAMEPADS: Final = range(0x120, 0x140)
"""Codes of buttons that only joysticks and gamepads have; BTN_JOYSTICK and BTN_GAMEPAD in input-event-codes.h."""


def load_evdev() -> ModuleType:
    """Import the library for gamepads.

    Raises:
        MkError: it is not installed; says how to install it.
    """
    try:
        return importlib.import_module("evdev")
    except ImportError as error:
        msg = "gamepads need the library evdev, for Linux only: pip install 'mkdaemon[teleop]'; or fly by --keyboard"
        raise MkError(msg) from error


@dataclass(frozen=True, slots=True)
class FoundPad:
    """A pad that was found.

    Attributes:
        path: of its device file.
        name: as it calls itself.
        id: vendor and product, `045e:028e`.
        trouble: why it cannot be used; empty where it can.
    """

    path: str
    name: str
    id: str
    trouble: str = ""


class EvdevPad:
    """One open pad.

    Attributes:
        name: path of its device file.
        facts: what it says about itself.
        id: vendor and product, `045e:028e`.
    """

    def __init__(self, device: Any, report: Callable[[str, str, float, float], None]) -> None:
        """Take an open device.

        Args:
            device: an `evdev.InputDevice`.
            report: called with every change: name, control, raw value, time.
        """
        self._device, self._report = device, report
        self._codes = load_evdev().ecodes
        self.name: str = device.path
        self.id = f"{device.info.vendor:04x}:{device.info.product:04x}"
        capabilities = device.capabilities(absinfo=True)
        self._axes = {code: _names(self._codes.ABS, code) for code, _ in capabilities.get(self._codes.EV_ABS, ())}
        self._keys = {code: _names(self._codes.keys, code) for code in capabilities.get(self._codes.EV_KEY, ())}
        ranges = {
            name: AxisRange(info.min, info.max)
            for code, info in capabilities.get(self._codes.EV_ABS, ())
            for name in self._axes[code]
        }
        buttons = frozenset(name for names in self._keys.values() for name in names)
        self.facts = PadFacts(device.name, ranges, buttons, is_wireless=device.info.bustype == BLUETOOTH)
        self._effect: int | None = None
        self._failure: str | None = None
        self._loop = asyncio.get_running_loop()
        self._loop.add_reader(device.fd, self._read)

    @property
    def is_gamepad(self) -> bool:
        """Whether it has sticks and buttons of a gamepad or joystick; a motion sensor has no buttons."""
        return bool(self._axes) and any(code in _GAMEPADS for code in self._keys)

    def _read(self) -> None:
        try:
            events = list(self._device.read())
        except BlockingIOError:
            return
        except OSError as error:
            self._fail(error)
            return
        now = self._loop.time()
        for event in events:
            if event.type == self._codes.EV_ABS:
                names = self._axes.get(event.code, ())
            elif event.type == self._codes.EV_KEY and event.value in {0, 1}:
                names = self._keys.get(event.code, ())
            else:
                continue
            for name in names:
                self._report(self.name, name, event.value, now)

    def _fail(self, error: OSError) -> None:
        """Keep the failure for the next question, which asks at once."""
        self._loop.remove_reader(self._device.fd)
        what = "was unplugged" if error.errno == errno.ENODEV else f"cannot be read: {error.strerror or error}"
        self._failure = f"{self.facts.name} {what}"
        self._report(self.name, "", 0.0, self._loop.time())

    def ask(self, now: float) -> DeviceState | None:
        """Return the state of every axis and button, as the kernel knows it.

        Raises:
            DeviceLostError: it was unplugged.
        """
        if self._failure is None:
            try:
                values = {
                    name: float(self._device.absinfo(code).value)
                    for code, names in self._axes.items()
                    for name in names
                }
                pressed = set(self._device.active_keys())
            except OSError as error:
                self._fail(error)
        if self._failure is not None:
            raise DeviceLostError(self._failure)
        values |= {name: float(code in pressed) for code, names in self._keys.items() for name in names}
        return DeviceState(values, now)

    def alarm(self) -> None:
        """Shake, where it can."""
        ff = load_evdev().ff
        with suppress(OSError):
            if self._effect is None and self._codes.EV_FF in self._device.capabilities():
                rumble = ff.Rumble(strong_magnitude=STRENGTH, weak_magnitude=STRENGTH)
                effect = ff.Effect(
                    self._codes.FF_RUMBLE,
                    -1,
                    0,
                    ff.Trigger(0, 0),
                    ff.Replay(SHAKE_MS, 0),
                    ff.EffectType(ff_rumble_effect=rumble),
                )
                self._effect = self._device.upload_effect(effect)
            if self._effect is not None:
                self._device.write(self._codes.EV_FF, self._effect, 1)

    def let_go(self) -> None:
        """Do nothing: the enable button reports its own release."""

    def close(self) -> None:
        """Close the device file."""
        self._loop.remove_reader(self._device.fd)
        with suppress(OSError):
            self._device.close()


def _names(table: Any, code: int) -> tuple[str, ...]:
    """Every name of a code; input-event-codes.h gives some codes several."""
    names = table.get(code, f"CODE_{code}")
    return (names,) if isinstance(names, str) else tuple(names)


def open_pad(path: str, report: Callable[[str, str, float, float], None]) -> EvdevPad | None:
    """Open a device file; None where it is not a gamepad.

    Raises:
        OSError: it cannot be opened.
    """
    pad = EvdevPad(load_evdev().InputDevice(path), report)
    if pad.is_gamepad:
        return pad
    pad.close()
    return None


def new_paths(known: Iterable[str]) -> list[str]:
    """Return the device files that are there and were not known before, in the order of their numbers."""
    paths: list[str] = load_evdev().list_devices()
    return sorted(set(paths).difference(known), key=lambda path: (len(path), path))
