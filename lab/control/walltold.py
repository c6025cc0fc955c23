"""How what happened to the whole daemon in earnest is judged: by the bytes on the wire, and by what it says."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

from lab.rigs.overtarget import Hover
from lab.rigs.wiretap import Sticks

SETTLING: Final = 3.0
"""It flies for so long before anything happens [s]."""
SHARE: Final = 1.2
"""A trigger fires at its time, at most so much later."""
SLACK: Final = 0.1
"""And this [s]: two processes stand between what happens and the wire."""
LEVEL: Final = 0.2
"""Sticks that stay level for so long are no chance [s]."""


@dataclass(frozen=True, slots=True)
class Told:
    """One story, told.

    Attributes:
        hover: who flew; what the tap heard is complete.
        at: when it happened [s; monotonic].
        ended: what came later does not count [s; monotonic].
    """

    hover: Hover
    at: float
    ended: float

    @property
    def sticks(self) -> list[Sticks]:
        """Everything on the wire that steers."""
        assert self.hover.tap is not None
        return [stick for stick in self.hover.tap.sticks() if stick[0] < self.ended]

    def released(self) -> float:
        """From the event to the first frame of a release [s]; infinite for none."""
        return min((at for at, stick in self.sticks if at > self.at and not stick.config), default=math.inf) - self.at

    def level(self) -> float:
        """From the event to the first stick frame after which none tilts for `LEVEL`, or until the release [s]."""
        until, since = self.at + self.released(), math.inf
        for at, stick in self.sticks:
            if self.at < at < until and stick.config:
                since = min(since, at) if _is_level(stick) else math.inf
                if at - since >= LEVEL:
                    break
        return min(since, until) - self.at

    def gaps(self) -> list[float]:
        """Times between stick frames, from the flight's first to its first release [s]."""
        until, since = self.at + self.released(), self.at - SETTLING
        times = [at for at, stick in self.sticks if since < at < until and stick.config]
        return [after - before for before, after in itertools.pairwise(times)]


def _is_level(stick: Any) -> bool:
    return not (stick.pitch or stick.roll or stick.yaw)


Judge = Callable[[Told], dict[str, bool]]
"""What must hold, by name."""


def says(told: Told, words: str) -> bool:
    """Whether the daemon says so."""
    return any(words in said for said in (*told.hover.seen.phases, *told.hover.seen.failsafes))


def in_time(found: float, wanted: float) -> bool:
    """Whether it came at its time."""
    return found <= SHARE * wanted + SLACK


def ends(level: float, release: float, words: str) -> Judge:
    """It is level, then released, in time, and the daemon says why."""
    return lambda told: {
        "level in time": in_time(told.level(), level),
        "released in time": in_time(told.released(), release),
        "said": says(told, words),
    }


def goes_on(told: Told) -> dict[str, bool]:
    """The flight goes on."""
    return {"not released": told.released() == math.inf}
