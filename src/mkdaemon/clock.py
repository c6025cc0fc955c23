"""The clock that stamps.

Monotonic time orders and measures; wall time compares machines. Wall time is monotonic time plus an offset, and the
offset follows the system clock: when NTP or a person sets it, later stamps are right again. docs/frames.md.
"""

from __future__ import annotations

import ctypes
import threading
import time
from collections import deque
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Final, NamedTuple

from mkdaemon.stamp import Stamp

LOOK_PERIOD: Final = 0.1
"""The offset is read again at most this often [s]."""
SYNCHRONISED_PERIOD: Final = 1.0
"""The kernel is asked at most this often whether the system clock is synchronised [s]."""
STEP: Final = 0.1
"""An offset that changed by more than this between two looks was set, not slewed [s]: the kernel slews by at most a
tenth (adjtimex(2), `tick`), which is 0.01 s in one `LOOK_PERIOD`."""
_BRACKET: Final = 0.0001
"""Two readings of the monotonic clock around one of the system clock lie this close unless the process was paused
between them [s]; such a look is repeated."""
_ATTEMPTS: Final = 5
_KEPT_STEPS: Final = 16
_TIME_ERROR: Final = 5
"""adjtimex(2): the clock is not synchronised."""
_TIMEX_BYTES: Final = 256
"""Room for `struct timex`, which has 208 bytes on a 64-bit kernel."""


class ClockStep(NamedTuple):
    """The system clock was set.

    Attributes:
        at: when it was noticed [s; monotonic].
        step: how far it jumped against the monotonic clock, forward positive [s].
        suspended: how much of that the machine slept [s].
    """

    at: float
    step: float
    suspended: float


@cache
def boot_id() -> str:
    """Name of this machine's monotonic clock: eight digits that change with every boot; empty where there are none."""
    try:
        return Path("/proc/sys/kernel/random/boot_id").read_text(encoding="ascii")[:8]
    except OSError:
        return ""


def kernel_synchronised() -> bool | None:
    """Whether the kernel says that the system clock follows a time server; None where it cannot be asked."""
    adjtimex = _adjtimex()
    state: int = -1 if adjtimex is None else adjtimex(ctypes.create_string_buffer(_TIMEX_BYTES))
    return None if state < 0 else state != _TIME_ERROR


@cache
def _adjtimex() -> Callable[[object], int] | None:
    # A zeroed `struct timex` has modes 0: it only reads.
    return getattr(ctypes.CDLL(None), "adjtimex", None)


def time_suspended() -> float:
    """Time that the machine was suspended since its start [s]; the monotonic clock stood still meanwhile."""
    return time.clock_gettime(time.CLOCK_BOOTTIME) - time.clock_gettime(time.CLOCK_MONOTONIC)


class SleepWatch:
    """Tells one listener how long the machine slept since he last asked: the monotonic clock does not."""

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._slept = clock.time_slept()

    def take(self) -> float:
        """Return the time slept since the last call [s]."""
        before, self._slept = self._slept, self._clock.time_slept()
        return self._slept - before


class Clock:
    """Monotonic time, and stamps that follow the system clock; may be used from any thread."""

    def __init__(
        self,
        *,
        monotonic: Callable[[], float] = time.monotonic,
        wall: Callable[[], float] = time.time,
        synchronised: Callable[[], bool | None] = kernel_synchronised,
        suspended: Callable[[], float] = time_suspended,
    ) -> None:
        """Read the clocks once.

        Args:
            monotonic: never jumps [s].
            wall: the system clock, Unix time [s]; may be set at any moment.
            synchronised: whether the system clock follows a time server; None for unknown.
            suspended: how long the machine has slept [s].
        """
        self._monotonic = monotonic
        self._wall = wall
        self._ask_synchronised = synchronised
        self._ask_suspended = suspended
        self._boot = boot_id()
        self._synchronised = synchronised()
        self._suspended = suspended()
        self._steps: deque[ClockStep] = deque(maxlen=_KEPT_STEPS)
        self._lock = threading.Lock()
        self._offset = self._read_offset()
        self._look_at = monotonic() + LOOK_PERIOD
        self._ask_at = monotonic() + SYNCHRONISED_PERIOD

    def now(self) -> float:
        """The present moment [s; monotonic]."""
        return self._monotonic()

    def stamp(self, at: float | None = None) -> Stamp:
        """Stamp a moment; now if none is given.

        Args:
            at: [s; monotonic].
        """
        at = self.now() if at is None else at
        return Stamp(monotonic=at, wall=self.wall(at), boot=self._boot, synchronised=self._synchronised)

    def wall(self, at: float) -> float:
        """Unix time of a moment [s; monotonic]."""
        now = self.now()
        if now >= self._look_at:
            self._look(now)
        return at + self._offset

    def monotonic_of(self, stamp: Stamp) -> float:
        """A stamp of any machine on this monotonic clock [s]: directly on one machine, through wall time otherwise."""
        if stamp.boot and stamp.boot == self._boot:
            return stamp.monotonic
        self._look(self.now())
        return stamp.wall - self._offset

    def time_slept(self) -> float:
        """How long the machine has slept since its start [s]."""
        return self._ask_suspended()

    def take_steps(self) -> list[ClockStep]:
        """Look at the system clock; returns every step since the last call, the oldest first."""
        self._look(self.now())
        steps = []
        while self._steps:
            steps.append(self._steps.popleft())
        return steps

    def _look(self, now: float) -> None:
        with self._lock:
            if now < self._look_at:
                return
            self._look_at = now + LOOK_PERIOD
            before, self._offset = self._offset, self._read_offset()
            if abs(self._offset - before) > STEP:
                slept, self._suspended = self._suspended, self._ask_suspended()
                self._steps.append(ClockStep(now, self._offset - before, max(self._suspended - slept, 0.0)))
            if now >= self._ask_at:
                self._ask_at = now + SYNCHRONISED_PERIOD
                self._synchronised = self._ask_synchronised()

    def _read_offset(self) -> float:
        """Unix time less monotonic time [s], from the tightest of a few looks."""
        best, narrowest = 0.0, float("inf")
        for _ in range(_ATTEMPTS):
            before = self.now()
            wall = self._wall()
            width = self.now() - before
            if width < narrowest:
                best, narrowest = wall - before - width / 2, width
            if width <= _BRACKET:
                break
        return best
