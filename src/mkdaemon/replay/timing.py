"""An event loop that runs what waits in the order of a recording, in its time.

In earnest, every task sees the clock at moments that never come again, and what it decides follows from them. So a
replay gives each task what it saw then (`Script`), and of all that could run it runs whoever looked next. Timers are
due when their task looked, not when they were set to.
"""

from __future__ import annotations

import asyncio
from asyncio import Handle, TimerHandle
from collections import deque
from collections.abc import Callable
from contextvars import Context
from typing import Any, Final, TypeVarTuple

from mkdaemon.actor import CALLBACK, current_actor
from mkdaemon.clock import Clock
from mkdaemon.replay.script import Moment, Script
from mkdaemon.stamp import Stamp

_Args = TypeVarTuple("_Args")
EARLY: Final = 0.02
"""A timer may have fired so long before it was due [s]: loops count from the beginning of a turn, in milliseconds."""
BREATH: Final = 1e-5
"""What came in so soon after another input came in the same turn of the loop, before anybody acted on that [s]: bytes
that were read when the daemon was told to stop are read before the reader is stopped."""
LATE: Final = 1.0
"""It may have fired so late [s]; after that nobody is expected to look because of it."""


class _Step(Handle):
    """Something that waits to be run."""

    def __init__(
        self,
        callback: Callable[[*_Args], object],
        args: tuple[*_Args],
        loop: asyncio.AbstractEventLoop,
        context: Context | None,
    ) -> None:
        super().__init__(callback, args, loop, context)
        task = getattr(callback, "__self__", None)
        self._task: asyncio.Task[Any] | None = task if isinstance(task, asyncio.Task) else None

    @property
    def owner(self) -> str | None:
        """Whose step it is: the name of a task; None for what asyncio does between them."""
        return None if self._task is None else self._task.get_name()

    def run(self) -> None:
        """Run it unless it was called off."""
        if not self.cancelled():
            self._run()


class _Timer(TimerHandle):
    """A timer that was set.

    Attributes:
        owner: who waits for it: the name of a task; `CALLBACK` for none.
    """

    owner = CALLBACK

    def run(self) -> None:
        """Run it."""
        self._run()


class ReplayLoop(asyncio.SelectorEventLoop):
    """An event loop in the time of a recording; threads and real I/O have no place in it."""

    def __init__(self, script: Script, start: float) -> None:
        """Begin.

        Args:
            script: what happened.
            start: time of the beginning [s].
        """
        self._script = script
        self._now = start
        self._brought_at = float("-inf")
        self._soon: deque[_Step] = deque()
        self._timers: list[_Timer] = []
        self._bring: Callable[[Moment], None] = lambda moment: None
        self._end: Callable[[], None] = lambda: None
        super().__init__()

    def follow(self, bring: Callable[[Moment], None], end: Callable[[], None]) -> None:
        """Hand over what comes in, and tell when the recording has ended."""
        self._bring, self._end = bring, end

    def time(self) -> float:
        """Time of the recording [s]."""
        return self._now

    def look(self) -> float:
        """What the running task sees on its clock [s]."""
        actor = current_actor()
        seen = None if actor is None else self._script.take_look(actor)
        if seen is None:
            return self._now
        self._now = max(self._now, seen)
        return seen

    def bring_what_follows(self) -> None:
        """Bring what came in while somebody was at work, right after they looked last."""
        self._bring_next()

    def call_soon(
        self, callback: Callable[[*_Args], object], *args: *_Args, context: Context | None = None
    ) -> asyncio.Handle:
        """Run something as soon as it is its turn."""
        handle = _Step(callback, args, self, context)
        self._soon.append(handle)
        return handle

    def call_soon_threadsafe(
        self, callback: Callable[[*_Args], object], *args: *_Args, context: Context | None = None
    ) -> asyncio.Handle:
        """As `call_soon`: there are no other threads."""
        return self.call_soon(callback, *args, context=context)

    def call_at(
        self, when: float, callback: Callable[[*_Args], object], *args: *_Args, context: Context | None = None
    ) -> asyncio.TimerHandle:
        """Set a timer; it fires when its owner looked on the clock because of it."""
        timer = _Timer(when, callback, args, self, context)
        task = asyncio.current_task(self)
        if task is not None and str(getattr(callback, "__module__", "")).startswith("asyncio"):
            timer.owner = task.get_name()
        self._timers.append(timer)
        return timer

    # -- what runs next -------------------------------------------------------------------------------------------

    def _run_once(self) -> None:
        """Run one thing, or let one thing come in; asyncio calls it for ever."""
        script = self._script
        self._timers = [timer for timer in self._timers if not timer.cancelled()]
        arriving, look = script.next_input, script.next_look
        if arriving is not None and arriving.at - self._brought_at < BREATH:
            self._now = max(self._now, arriving.at)
            self._bring_next()
            return
        due = None if arriving is not None or look is None else look.actor
        ready = next((step for step in self._soon if self._is_free(step) or step.owner == due), None)
        if ready is not None:
            self._run_soon(ready)
            return
        if arriving is not None:
            if not self._run_overdue(arriving.at):
                self._now = max(self._now, arriving.at)
                self._bring_next()
        elif look is None:
            self._run_last()
        elif not (self._run_of(look.actor, look.at) or self._run_first() or self._run_overdue(look.at)):
            script.skip_look()

    def _bring_next(self) -> None:
        """Bring what comes in next."""
        moment = self._script.take_input()
        self._brought_at = moment.at
        self._bring(moment)

    def _is_free(self, step: _Step) -> bool:
        """Whether nobody looks on a clock of the recording there: it may run at once."""
        return step.cancelled() or step.owner is None or self._script.next_of(step.owner) is None

    def _run_of(self, actor: str, at: float) -> bool:
        """Run what somebody does who looks then [s]; returns whether there is such a thing."""
        for step in self._soon:
            if step.owner == actor:
                self._run_soon(step)
                return True
        timers = [timer for timer in self._timers if timer.owner == actor and timer.when() <= at + EARLY]
        if timers:
            self._fire(min(timers, key=TimerHandle.when))
        return bool(timers)

    def _run_first(self) -> bool:
        """Run what has waited longest, without a look perhaps; returns whether anything waits."""
        if self._soon:
            self._run_soon(self._soon[0])
            return True
        return False

    def _run_overdue(self, at: float) -> bool:
        """Fire a timer that is due by then [s] and that nobody is expected to look because of."""
        for timer in sorted(self._timers, key=TimerHandle.when):
            if timer.when() > at:
                break
            expected = self._script.next_of(timer.owner)
            if expected is None or expected > timer.when() + LATE:
                self._now = max(self._now, timer.when())
                self._fire(timer)
                return True
        return False

    def _run_last(self) -> None:
        """Go on after the end of the recording."""
        self._end()
        if self._run_first():
            return
        if not self._timers:
            msg = "everything waits, and the recording has ended"
            raise RuntimeError(msg)
        timer = min(self._timers, key=TimerHandle.when)
        self._now = max(self._now, timer.when())
        self._fire(timer)

    def _run_soon(self, step: _Step) -> None:
        self._soon.remove(step)
        step.run()

    def _fire(self, timer: _Timer) -> None:
        self._timers.remove(timer)
        timer.run()


class ReplayClock(Clock):
    """Shows the time of a recording, to everybody what they saw then."""

    def __init__(self, loop: ReplayLoop, offset: Callable[[float], float]) -> None:
        """Follow a loop.

        Args:
            loop: of the replay.
            offset: Unix time less monotonic time, by monotonic time [s].
        """
        self._loop, self._offset_at = loop, offset
        super().__init__(
            monotonic=loop.time,
            wall=lambda: loop.time() + offset(loop.time()),
            synchronised=lambda: None,
            suspended=lambda: 0.0,
        )

    def now(self) -> float:
        """What the running task saw here [s; monotonic]."""
        return self._loop.look()

    def stamp(self, at: float | None = None) -> Stamp:
        """Stamp a moment as it was stamped."""
        if at is None:
            at = self.now()
        return Stamp(monotonic=at, wall=at + self._offset_at(at), boot="", synchronised=None)
