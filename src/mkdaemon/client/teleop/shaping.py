"""From where a stick stands to what it asks for: dead zone, expo, stick modes, and the thrust stick."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final

from mkdaemon.config.gamepad import Gamepad, ThrustSection

PICKUP: Final = 3.0
"""The thrust stick takes over again within this distance from the thrust that is held [stick]."""
LOWEST: Final = -0.9
"""A thrust stick below this share of its way stands at its lowest."""
REACH: Final = 0.95
"""Share of the way at which a thrust stick asks for its lowest or highest: worn sticks do not reach their ends."""

MODES: Final[Mapping[int, Mapping[str, str]]] = MappingProxyType(
    {
        1: {"pitch": "left_y", "yaw": "left_x", "throttle": "right_y", "roll": "right_x"},
        2: {"throttle": "left_y", "yaw": "left_x", "pitch": "right_y", "roll": "right_x"},
        3: {"pitch": "left_y", "roll": "left_x", "throttle": "right_y", "yaw": "right_x"},
        4: {"throttle": "left_y", "roll": "left_x", "pitch": "right_y", "yaw": "right_x"},
    }
)
"""Which stick does what in each stick mode of radio control; EdgeTX manual, "Radio setup", "Stick mode"."""


@dataclass(frozen=True, slots=True)
class AxisNames:
    """The axis of a pad that each function reads; `-` in front turns it round."""

    pitch: str
    roll: str
    yaw: str
    throttle: str

    @classmethod
    def of(cls, pad: Gamepad) -> AxisNames:
        """Find the axes in a mapping."""
        if pad.channels is not None:
            channels = pad.channels
            return cls(channels.elevator, channels.aileron, channels.rudder, channels.throttle)
        assert pad.sticks is not None
        sticks = pad.sticks.model_dump()
        return cls(**{function: sticks[stick] for function, stick in MODES[pad.mode].items()})

    @property
    def all(self) -> tuple[str, str, str, str]:
        """Every axis."""
        return (self.pitch, self.roll, self.yaw, self.throttle)


def shape(position: float, *, deadzone: float, expo: float) -> float:
    """Return what a stick asks for, as a share of its full deflection.

    `m = (|x| - deadzone) / (1 - deadzone)`, `y = (1 - expo) m + expo m^3`, with the sign of x: the curve of radio
    control transmitters.

    Args:
        position: where the stick stands, -1..1.
        deadzone: share of the way that counts as the middle, below 1.
        expo: share of the cube, 0..1.
    """
    way = max(abs(position) - deadzone, 0.0) / (1.0 - deadzone)
    return math.copysign((1.0 - expo) * way + expo * way**3, position)


class Thrust:
    """The thrust stick: its middle can be moved, and what it asks for can be locked.

    After a lock, a moved middle or a manoeuvre the thrust stays where it is until the stick has come to it: nothing
    jumps.

    Attributes:
        value: what is asked for now [stick from the centre].
        hover: what the middle of the stick asks for [stick from the centre].
        is_locked: the stick is not read.
        is_waiting: the stick has not come to the thrust that is held yet.
    """

    def __init__(self, cfg: ThrustSection) -> None:
        self._cfg = cfg
        self.hover = cfg.hover
        self.value = cfg.lowest
        self.is_locked = False
        self.is_waiting = False
        self._side: float | None = None

    def move(self, position: float) -> float:
        """Take where the stick stands, -1..1; returns the thrust [stick from the centre]."""
        if self.is_locked:
            return self.value
        wanted = self._thrust_at(position)
        side = math.copysign(1.0, wanted - self.value)
        if self.is_waiting and abs(wanted - self.value) > PICKUP and self._side in {None, side}:
            self._side = side
            return self.value
        self.is_waiting = False
        self.value = wanted
        return wanted

    def _thrust_at(self, position: float) -> float:
        way = shape(min(max(position / REACH, -1.0), 1.0), deadzone=self._cfg.deadzone, expo=self._cfg.expo)
        span = self.hover - self._cfg.lowest if way < 0.0 else self._cfg.highest - self.hover
        return self.hover + way * span

    def hold(self, value: float | None = None) -> None:
        """Keep a thrust, that of now if none is given, until the stick has come to it [stick from the centre]."""
        self.value = self.value if value is None else value
        self.is_waiting = True
        self._side = None

    def toggle_lock(self) -> None:
        """Lock the thrust, or let the stick take it up again."""
        self.is_locked = not self.is_locked
        if not self.is_locked:
            self.hold()

    def recentre(self) -> None:
        """Let the middle of the stick ask for the thrust of this moment."""
        self.hover = min(max(self.value, self._cfg.lowest + 1.0), self._cfg.highest - 1.0)
        self.hold()

    def reset(self) -> None:
        """Set the middle as configured and end the lock."""
        self.hover = self._cfg.hover
        self.is_locked = False
        self.hold()
