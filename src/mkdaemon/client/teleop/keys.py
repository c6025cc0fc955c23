"""A keyboard as a pad: keys come when they are pressed, and nothing says when they are let go of.

A terminal sends a character for a press, after a pause more of them while the key is held, and nothing at its end. So a
key deflects its stick for a moment, again with every repetition; thrust stays where keys have put it; the enable button
is a switch. What keeps it honest is not a key but the terminal itself, which is asked all the time whether it is still
there: docs/teleop.md.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final

from mkdaemon.client.teleop.inputs import AxisRange, PadFacts
from mkdaemon.config.gamepad import AxisSection, ButtonsSection, ChannelsSection, Gamepad, ThrustSection

TAP: Final = 0.3
"""How long one press deflects a stick [s]."""
REPEAT: Final = 0.15
"""How long each repetition of a held key does [s]; keyboards repeat every 25 to 40 ms."""
REPEATED: Final = 0.1
"""Presses of one key that are closer are repetitions [s]."""
DEFLECTION: Final = 0.7
"""Of a stick by a key, share of the way."""
STEP: Final = 0.03
"""Of the thrust by one press, share of the way."""
PRESS: Final = 1.2
"""How long a key counts as pressed where it is a button [s]: longer than any button must be held."""

TILTS: Final[Mapping[str, tuple[str, float]]] = MappingProxyType(
    {
        "up": ("KEYS_PITCH", 1.0),
        "down": ("KEYS_PITCH", -1.0),
        "right": ("KEYS_ROLL", 1.0),
        "left": ("KEYS_ROLL", -1.0),
        "d": ("KEYS_YAW", 1.0),
        "a": ("KEYS_YAW", -1.0),
    }
)
"""Keys that deflect a stick for a moment."""
THRUST: Final[Mapping[str, float]] = MappingProxyType({"w": STEP, "s": -STEP})
"""Keys that move the thrust."""
MIDDLE: Final = "m"
"""Key that puts the thrust to hover."""
ENABLE: Final = "e"
"""Key that switches the enable button on and off."""
_FUNCTIONS: Final = {
    "release": (" ", "KEY_SPACE"),
    "fine": ("f", "KEY_F"),
    "thrust_lock": ("l", "KEY_L"),
    "recentre": ("c", "KEY_C"),
    "reset": ("r", "KEY_R"),
    "takeoff": ("T", "KEY_T"),
    "hold": ("H", "KEY_H"),
    "land": ("L", "KEY_G"),
    "stop": ("X", "KEY_X"),
    "trim_forward": ("8", "KEY_8"),
    "trim_back": ("2", "KEY_2"),
    "trim_left": ("4", "KEY_4"),
    "trim_right": ("6", "KEY_6"),
}
"""Keys that are buttons, by what the button does; what takes off, lands or stops wants the shift key."""
BUTTONS: Final[Mapping[str, str]] = MappingProxyType(dict(_FUNCTIONS.values()))
"""The button of each of those keys."""
KEYBOARD: Final = Gamepad(
    name="keyboard",
    channels=ChannelsSection(aileron="KEYS_ROLL", elevator="KEYS_PITCH", throttle="KEYS_THRUST", rudder="KEYS_YAW"),
    buttons=ButtonsSection(enable="KEY_E", **{function: button for function, (_, button) in _FUNCTIONS.items()}),
    pitch=AxisSection(rate=20, expo=0, deadzone=0),
    roll=AxisSection(rate=20, expo=0, deadzone=0),
    yaw=AxisSection(rate=30, expo=0, deadzone=0),
    thrust=ThrustSection(expo=0, deadzone=0),
)
"""What the keys do."""
_AXES: Final = ("KEYS_ROLL", "KEYS_PITCH", "KEYS_YAW", "KEYS_THRUST")
FACTS: Final = PadFacts(
    "keyboard",
    dict.fromkeys(_AXES, AxisRange(-1.0, 1.0)),
    frozenset({"KEY_E", *BUTTONS.values()}),
    speaker="the terminal",
)
"""What the keyboard says about itself."""


class Keys:
    """Keys as they arrive, and the pad they stand for.

    Attributes:
        thrust: where the thrust stick would stand, -1..1.
        is_enabled: the enable button is switched on.
        alive_at: when the terminal was last known to be there [s]; None before it has shown it.
    """

    def __init__(self) -> None:
        self.thrust = -1.0
        self.is_enabled = False
        self.alive_at: float | None = None
        self._tilted: dict[str, tuple[float, float]] = {}
        self._pressed: dict[str, float] = {}
        self._typed_at: dict[str, float] = {}

    def alive(self, at: float) -> None:
        """Take note that the terminal is there [s]."""
        self.alive_at = at

    def typed(self, key: str, at: float) -> None:
        """Take a key.

        Args:
            key: the character, or `up`, `down`, `left`, `right`.
            at: when it arrived [s].
        """
        is_repeated = at - self._typed_at.get(key, float("-inf")) < REPEATED
        self._typed_at[key] = at
        if key in TILTS:
            axis, sign = TILTS[key]
            self._tilted[axis] = (sign * DEFLECTION, at + (REPEAT if is_repeated else TAP))
        elif key in THRUST:
            self.thrust = min(max(self.thrust + THRUST[key], -1.0), 1.0)
        elif key == MIDDLE:
            self.thrust = 0.0
        elif key == ENABLE and not is_repeated:
            self.is_enabled = not self.is_enabled
        elif key in BUTTONS and not is_repeated:
            self._pressed[BUTTONS[key]] = at + PRESS

    def let_go(self) -> None:
        """Switch the enable button off and centre the sticks: the aircraft was let go of."""
        self.is_enabled = False
        self._tilted.clear()

    def state(self, now: float) -> dict[str, float]:
        """Return the state of the pad the keys stand for."""
        values = dict.fromkeys(_AXES[:3], 0.0)
        values |= {axis: value for axis, (value, until) in self._tilted.items() if now < until}
        values["KEYS_THRUST"] = self.thrust
        values["KEY_E"] = float(self.is_enabled)
        return values | {button: float(now < self._pressed.get(button, now)) for button in BUTTONS.values()}
