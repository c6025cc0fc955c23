"""A pad, and a keyboard, in somebody's hands, for sessions in virtual time: no kernel and no terminal."""

from __future__ import annotations

import asyncio

from mkdaemon.cli.mkctl.teleop.devices import DeviceLostError, DeviceState
from mkdaemon.cli.mkctl.teleop.session import TeleopSession
from mkdaemon.client.teleop.inputs import AxisRange, PadFacts
from mkdaemon.client.teleop.keys import FACTS, KEYBOARD, Keys
from mkdaemon.config.gamepad import ButtonsSection, Gamepad, SticksSection

MAPPING = Gamepad(
    name="pad",
    sticks=SticksSection(left_x="ABS_X", left_y="-ABS_Y", right_x="ABS_RX", right_y="-ABS_RY"),
    buttons=ButtonsSection(enable="BTN_TL", release="BTN_EAST"),
)
_STICKS = ("ABS_X", "ABS_Y", "ABS_RX", "ABS_RY")
_FULL = 32767


class Quiet:
    """What does nothing when it is asked to ring, to let go, or to close."""

    def alarm(self) -> None:
        """Nothing rings."""

    def let_go(self) -> None:
        """Nothing is held."""

    def close(self) -> None:
        """Nothing is open."""


class HandPad(Quiet):
    """A pad by cable.

    Attributes:
        alarms: how often it shook.
    """

    def __init__(self, session: TeleopSession, name: str = "pad") -> None:
        self.name = name
        self.facts = PadFacts(name, dict.fromkeys(_STICKS, AxisRange(-_FULL, _FULL)), frozenset({"BTN_TL", "BTN_EAST"}))
        self.alarms = 0
        self._session = session
        self._values: dict[str, float] = dict.fromkeys((*_STICKS, "BTN_TL", "BTN_EAST"), 0.0)
        self._is_gone = False
        self._frozen_at: float | None = None

    def plug_in(self) -> None:
        """Attach it."""
        self._session.attach(self, MAPPING)

    def ask(self, now: float) -> DeviceState | None:
        """Return its state, as the kernel knows it.

        Raises:
            DeviceLostError: it was unplugged.
        """
        if self._is_gone:
            msg = f"{self.name} was unplugged"
            raise DeviceLostError(msg)
        return DeviceState(dict(self._values), now if self._frozen_at is None else self._frozen_at)

    def move(self, **values: float) -> None:
        """Move sticks, -1..1, and press buttons, 0 or 1."""
        now = asyncio.get_running_loop().time()
        for control, value in values.items():
            self._values[control] = value * (1 if control.startswith("BTN") else _FULL)
            self._session.reported(self.name, control, self._values[control], now)

    def unplug(self, *, is_noticed: bool) -> None:
        """Take it away; the kernel's error wakes the program, or it is found out when it is asked."""
        self._is_gone = True
        if is_noticed:
            self._session.lost(self.name, f"{self.name} was unplugged")

    def freeze(self) -> None:
        """Let it say nothing new: what it answers is as old as now."""
        self._frozen_at = asyncio.get_running_loop().time()

    def alarm(self) -> None:
        """Shake."""
        self.alarms += 1


class HandKeyboard(Quiet):
    """The keyboard of a terminal that answers every 80 ms.

    Attributes:
        keys: the pad that its keys stand for.
    """

    def __init__(self, session: TeleopSession) -> None:
        self.name, self.facts, self.keys = "keyboard", FACTS, Keys()
        self._session = session
        self._is_there = True
        self._answered_at = float("-inf")

    def plug_in(self) -> None:
        """Attach it."""
        self._session.attach(self, KEYBOARD)

    def type(self, key: str) -> None:
        """Type a key; nothing arrives when the terminal is gone."""
        if self._is_there:
            now = asyncio.get_running_loop().time()
            self.keys.typed(key, now)
            self._session.reported(self.name, "", 0.0, now)

    def drop(self) -> None:
        """Let the connection to the terminal break without a word."""
        self._is_there = False

    def ask(self, now: float) -> DeviceState | None:
        """Return what the keys stand for, as old as the terminal's last answer."""
        if self._is_there and now - self._answered_at >= 0.08:
            self._answered_at = now
            self.keys.alive(now)
        return None if self.keys.alive_at is None else DeviceState(self.keys.state(now), self.keys.alive_at)

    def let_go(self) -> None:
        """Switch the enable button off."""
        self.keys.let_go()
