"""When things happen again: a loop in virtual time whose timers fire when they fired in the recording.

In earnest a timer fires a little late, never at the same moment twice, and everything after it depends on when it did.
So the recorder notes when the flight core and the line woke, and here a timer that is due fires at the next moment at
which its owner woke in the recording. Between two such moments time stands still.
"""

from __future__ import annotations

import asyncio
from bisect import bisect_left, bisect_right
from collections.abc import Callable, Mapping, Sequence
from contextvars import Context
from enum import Enum, auto
from typing import Final, TypeVarTuple

from mkdaemon.clock import Clock, Wake
from mkdaemon.link.session.exchange import Exchange
from mkdaemon.virtualtime import VirtualLoop

_Args = TypeVarTuple("_Args")
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
LONGEST_TURN: Final = 0.1
"""Longest time from an event to what is decided because of it [s]."""
_TIMERS: Final = {Wake.CONTROL: Timer.CONTROL, Wake.LINE: Timer.LINE}
_TASKS: Final = {"control": Timer.CONTROL, "health": Timer.HEALTH, "link": Timer.OPENING}


class Timetable:
    """The moments at which each kind of timer fired in the recording."""

    def __init__(self, moments: Mapping[Timer, Sequence[float]], inputs: Sequence[float] = ()) -> None:
        """Take them, in ascending order [s].

        Args:
            moments: of each kind of timer.
            inputs: when anything came from outside.
        """
        self._moments, self._inputs = moments, inputs
        self._used: dict[Timer, int] = {}

    def fires_at(self, timer: Timer, due: float) -> float:
        """When a timer fires that is due then [s]: at the next moment of its kind if one is near, else when due."""
        moments = self._moments.get(timer, ())
        place = self._next(timer, due)
        if place < len(moments) and moments[place] - due <= PATIENCE[timer]:
            return moments[place]
        return due

    def decided_at(self, who: Wake, now: float) -> float:
        """When somebody who decides now decided in the recording [s]: soon, and before anything else came in."""
        timer = _TIMERS[who]
        moments = self._moments.get(timer, ())
        place = self._next(timer, now)
        if place == len(moments) or moments[place] - now > LONGEST_TURN:
            return now
        next_input = bisect_right(self._inputs, now)
        if next_input < len(self._inputs) and moments[place] >= self._inputs[next_input]:
            return now
        self._used[timer] = place
        return moments[place]

    def _next(self, timer: Timer, time: float) -> int:
        """Place of the first moment from a time on [s] at which nobody has decided yet."""
        return max(bisect_left(self._moments.get(timer, ()), time), self._used.get(timer, -1) + 1)


class ReplayClock(Clock):
    """Stamps in the time of a recording, and moves on to the moment at which something was decided."""

    def __init__(self, loop: ReplayLoop, offset: Callable[[], float]) -> None:
        """Follow a loop.

        Args:
            loop: of the replay.
            offset: Unix time less monotonic time, now [s].
        """
        self._loop = loop
        super().__init__(
            monotonic=loop.time,
            wall=lambda: loop.time() + offset(),
            synchronised=lambda: None,
            suspended=lambda: 0.0,
        )

    def woken(self, who: Wake) -> float:
        """The moment at which this was decided in the recording [s]."""
        self._loop.move_on(who)
        return super().woken(who)


class ReplayLoop(VirtualLoop):
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
        self,
        when: float,
        callback: Callable[[*_Args], object],
        *args: *_Args,
        context: Context | None = None,
    ) -> asyncio.TimerHandle:
        """Set a timer; it fires when the recording says."""
        fires_at = self._timetable.fires_at(self._owner(callback), when)
        return super().call_at(fires_at, callback, *args, context=context)

    def move_on(self, who: Wake) -> None:
        """Let the time pass that passed until somebody decided."""
        now = self.time()
        self.let_pass(self._timetable.decided_at(who, now) - now)

    def happens_at(self, when: float, callback: Callable[[*_Args], object], *args: *_Args) -> None:
        """Let something happen that was recorded at a moment [s]."""
        super().call_at(when, callback, *args)

    def _owner(self, callback: object) -> Timer:
        if getattr(callback, "__func__", None) is Exchange.pump:
            return Timer.LINE
        task = asyncio.current_task(self)
        return Timer.OTHER if task is None else _TASKS.get(task.get_name(), Timer.OTHER)


def spaced(times: Sequence[float]) -> list[float]:
    """Let each time be at least `APART` after the one before [s]."""
    found: list[float] = []
    for time in times:
        found.append(time if not found else max(time, found[-1] + APART))
    return found
