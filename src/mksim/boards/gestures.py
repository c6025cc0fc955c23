"""Stick gestures: corners of the sticks held for a while start, stop and calibrate.

Source: docs/firmware-notes, "External control" (0.7 s calibrates, 1 s arms or stops; in flight too); docs/protocol.md,
"Starting and stopping motors".
"""

from __future__ import annotations

from enum import StrEnum
from typing import Final

from mksim.boards.external import ExternalSticks

CALIBRATE_TIME: Final = 0.7
MOTOR: Final = 1.0
_TOP: Final = 80.0
_BOTTOM: Final = -100.0
_SIDE: Final = 75.0
_CORNER: Final = 100.0
_CHOICE: Final = 70.0


class Gesture(StrEnum):
    """What the sticks asked for."""

    CALIBRATE = "calibrate"
    START = "start"
    STOP = "stop"


def _corner(sticks: ExternalSticks, *, plain: bool) -> Gesture | None:
    """The gesture these sticks hold; `plain` where no pitch and roll corner is wanted."""
    if sticks.throttle > _TOP and sticks.yaw > _SIDE:
        return Gesture.CALIBRATE
    if sticks.throttle >= _BOTTOM or not (plain or (sticks.pitch <= -_CORNER and abs(sticks.roll) >= _CORNER)):
        return None
    if sticks.yaw < -_SIDE:
        return Gesture.START
    return Gesture.STOP if sticks.yaw > _SIDE else None


def chosen_set(sticks: ExternalSticks) -> int | None:
    """Parameter set chosen while calibrating: left 1, left forward 2, forward 3, right forward 4, right 5."""
    left, right, forward = sticks.roll > _CHOICE, sticks.roll < -_CHOICE, sticks.pitch > _CHOICE
    if left:
        return 2 if forward else 1
    if right:
        return 4 if forward else 5
    return 3 if forward else None


class GestureReader:
    """Times how long a corner is held; each hold acts once."""

    __slots__ = ("_done", "_held", "_since")

    def __init__(self) -> None:
        self._held: Gesture | None = None
        self._since = 0.0
        self._done = False

    def read(self, sticks: ExternalSticks, now: float, *, plain: bool) -> Gesture | None:
        """Look at the sticks of one receiver frame; return a gesture when it has been held long enough."""
        held = _corner(sticks, plain=plain)
        if held is not self._held:
            self._held, self._since, self._done = held, now, False
        if held is None or self._done:
            return None
        if now - self._since < (CALIBRATE_TIME if held is Gesture.CALIBRATE else MOTOR):
            return None
        self._done = True
        return held
