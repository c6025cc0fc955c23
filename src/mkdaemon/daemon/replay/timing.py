"""When things happen again: a loop in virtual time whose timers fire when they fired in the recording.

In earnest a timer fires a little late, never at the same moment twice, and everything after it depends on when it did.
So the recorder notes when the flight core and the line woke, and here a timer that is due fires at the next moment at
which its owner woke in the recording. Between two moments time stands still.
"""

from __future__ import annotations

import asyncio
from bisect import bisect_left
from collections.abc import Callable, Mapping, Sequence
from contextvars import Context
from enum import Enum, auto
from typing import Any, Final

from mkdaemon.link.session.exchange import Exchange
from mkdaemon.virtualtime import PacedLoop

APART: Final = 2e-9
"""Moments that were recorded at the same time are this far apart here [s]; asyncio takes 1e-9 s for the same time."""


class Timer(Enum):
    """Whose timer it is."""

    CONTROL = auto()
    """Of the flight core."""
    LINE = auto()
    """Of the line."""
    HEALTH = auto()
    """Of the vehicle's signs of life."""
    OPENING = auto()
    """Of the next attempt to open the port."""
    OTHER = auto()
    """Of a procedure, a discovery, a request."""


PATIENCE: Final = {Timer.CONTROL: 2.0, Timer.LINE: 2.0, Timer.HEALTH: 0.09, Timer.OPENING: 0.2, Timer.OTHER: 0.005}
"""How late a timer may have fired in the recording [s]. The flight core and the line wake all the time, and every time
is recorded; of the others only what they did is known, so the next thing done soon after is taken for theirs."""
_TASKS: Final = {"control": Timer.CONTROL, "health": Timer.HEALTH, "link": Timer.OPENING}


class Timetable:
    """The moments at which each kind of timer fired in the recording."""

    def __init__(self, moments: Mapping[Timer, Sequence[float]]) -> None:
        """Take them, each kind in ascending order [s]."""
        self._moments = moments

    def fires_at(self, timer: Timer, due: float) -> float:
        """When a timer fires [s] that is due [s]: at the next moment of its kind if there is one soon, else when due."""
        moments = self._moments.get(timer, ())
        place = bisect_left(moments, due)
        if place < len(moments) and moments[place] - due <= PATIENCE[timer]:
            return moments[place]
        return due


class ReplayLoop(PacedLoop):
    """An event loop in the time of a recording."""

    def __init__(self, timetable: Timetable, start: float) -> None:
        """Begin.

        Args:
            timetable: when timers fire.
            start: time of the beginning [s].
        """
        super().__init__(start=start)
        self._timetable = timetable

    def call_at(
        self, when: float, callback: Callable[..., object], *args: Any, context: Context | None = None
    ) -> asyncio.TimerHandle:
        """Set a timer; it fires when the recording says."""
        fires_at = self._timetable.fires_at(self._owner(callback), when)
        return super().call_at(fires_at, callback, *args, context=context)

    def happens_at(self, when: float, callback: Callable[..., object], *args: Any) -> None:
        """Let something happen that was recorded at a moment [s]."""
        super().call_at(when, callback, *args)

    def _owner(self, callback: Callable[..., object]) -> Timer:
        if getattr(callback, "__func__", None) is Exchange.timer_fired:
            return Timer.LINE
        task = asyncio.current_task(self)
        return Timer.OTHER if task is None else _TASKS.get(task.get_name(), Timer.OTHER)


def spaced(times: Sequence[float]) -> list[float]:
    """Times in ascending order [s], each at least `APART` after the one before."""
    found: list[float] = []
    for time in times:
        found.append(time if not found else max(time, found[-1] + APART))
    return found
