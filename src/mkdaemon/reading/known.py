"""The last value of every key at a moment, how old each is, and what looks at them have found."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from functools import lru_cache
from typing import Any, Final, Generic, Self, TypeVar

from mkdaemon.bus.keys import KEYS as TABLE
from mkdaemon.bus.keys import Use, find, fresh_for
from mkdaemon.telemetry.link import LinkHealth, LinkState

_Value = TypeVar("_Value")
_Found = TypeVar("_Found")
_CAMERA: Final = "<camera>"
KEYS: Final = (
    "health",
    "link/state",
    "link/health",
    "control/status",
    "control/estimate",
    "control/error",
    "state/*",
    "vision/*/stats",
    "vision/*/tags",
    "vision/*/pose",
    "vision/*/refused",
    "record/status",
)
"""Patterns of the keys that facts and alarms stand on."""
SLOW_KEYS: Final = (
    *("health", "link/state", "control/status", "state/battery", "state/flight", "state/position"),
    *("vision/*/stats", "record/status"),
)
"""Those of them that say enough of one vehicle of many, each about once a second."""


_STREAMS: Final = [spec for spec in TABLE if spec.use is Use.PUBLISHED and spec.fresh is not None]
_SUFFIXES: Final[dict[type[Any] | None, str]] = {spec.carries: spec.suffix for spec in _STREAMS}
EACH: Final = tuple(spec.pattern for spec in _STREAMS if any(fnmatchcase(spec.pattern, one) for one in KEYS))
"""The same keys as `KEYS`, each by itself."""
EVENTS: Final = tuple(spec.suffix for spec in TABLE if spec.suffix.startswith("event/"))
"""Keys of events."""
MOST_CAMERAS: Final = 16
"""Cameras of one vehicle; values of further ones are left: strangers may put under any name."""
SIGN_OF_LIFE: Final = fresh_for("health") or 0.0
"""A daemon whose newest value is older is silent [s]."""


@dataclass(frozen=True, slots=True)
class Known(Generic[_Value]):
    """A last value.

    Attributes:
        key: its key, without the vehicle.
        value: the value.
        at: when it was true, on the clock of its reader [s].
    """

    key: str
    value: _Value
    at: float


class Grounds:
    """What one look at the values has read: as long as that stays the same, another look finds the same.

    Attributes:
        values: of every key that was read; None where there was none.
        cameras: names that were read; None for not read.
        is_silent: what was read of the daemon's silence; None for not read.
        since: the moment of the look [s].
        until: the last moment at which every age is on the same side of its limits [s].
    """

    __slots__ = ("cameras", "is_silent", "since", "until", "values")

    def __init__(self, since: float) -> None:
        self.values: dict[str, Known[Any] | None] = {}
        self.cameras: tuple[str, ...] | None = None
        self.is_silent: bool | None = None
        self.since, self.until = since, math.inf

    def hold(self, known: Knowledge) -> bool:
        """Whether everything that was read is the same there."""
        held, now = known.held, known.now
        if not self.since <= now <= self.until:
            return False
        for key, value in self.values.items():
            if held.last.get(key) is not value:
                return False
        if self.is_silent is not None and self.is_silent is not (now > held.silent_from):
            return False
        return self.cameras is None or self.cameras == held.cameras


@dataclass(slots=True)
class LastValues:
    """What is kept of the values of a vehicle.

    Attributes:
        last: value of each key.
        cameras: names of those that published any value, in order.
        silent_from: the daemon is silent after this moment, unless a value comes [s].
        looks: what each look found last, and on what grounds; shared by all pictures of one reading.
    """

    last: dict[str, Known[Any]] = field(default_factory=dict)
    cameras: tuple[str, ...] = ()
    silent_from: float = -math.inf
    looks: dict[str, tuple[Grounds, Any]] = field(default_factory=dict)

    def take(self, new: Known[Any]) -> None:
        """Keep a value; one that is older than what is known is left."""
        before = self.last.get(new.key)
        if before is not None and new.at < before.at:
            return
        if before is None and new.key.startswith("vision/"):
            cameras = {*self.cameras, new.key.split("/")[1]}
            if len(cameras) > MOST_CAMERAS:
                return
            self.cameras = tuple(sorted(cameras))
        self.last[new.key] = new
        if _is_stream(new.key):
            self.silent_from = max(self.silent_from, new.at + SIGN_OF_LIFE)

    def copy(self) -> LastValues:
        """The same now, whatever comes later."""
        return LastValues(dict(self.last), self.cameras, self.silent_from, self.looks)


class Knowledge:
    """Last values as they are known at a moment.

    A look is a function of this class alone. What it reads here is noted, and `remembered` looks again only where
    something of it has changed: a value, a camera, the daemon's silence, or an age that passed a limit.

    Attributes:
        held: the values.
        now: the moment, on the clock of the reader [s].
    """

    def __init__(self, held: LastValues, now: float) -> None:
        """Look at values.

        Args:
            held: the values.
            now: the moment, on the clock of their times [s].
        """
        self.held, self.now = held, now
        self._grounds: Grounds | None = None

    def remembered(self, name: str, look: Callable[[Self], _Found]) -> _Found:
        """What a look finds, which may not call another one; that of before where nothing it read has changed.

        Args:
            name: of the look, its own among all of one reading.
            look: reads this knowledge and nothing else.
        """
        before = self.held.looks.get(name)
        if before is not None and before[0].hold(self):
            found: _Found = before[1]
            return found
        grounds = self._grounds = Grounds(self.now)
        try:
            found = look(self)
        finally:
            self._grounds = None
        self.held.looks[name] = grounds, found
        return found

    @property
    def silence(self) -> float:
        """Age of the newest value of the daemon's streams [s]; infinite before the first."""
        self._is_of_this_moment()
        return self.now - self.held.silent_from + SIGN_OF_LIFE

    @property
    def is_silent(self) -> bool:
        """The daemon has missed three of its signs of life."""
        is_silent = self.now > self.held.silent_from
        if self._grounds is not None:
            self._grounds.is_silent = is_silent
        return is_silent

    def last(self, key: str, kind: type[_Value]) -> Known[_Value] | None:
        """The last value of a key, however old; None before the first, and for one of another kind."""
        found = self.held.last.get(key)
        if self._grounds is not None:
            self._grounds.values[key] = found
        return found if found is not None and isinstance(found.value, kind) else None

    def fresh(self, key: str, kind: type[_Value]) -> _Value | None:
        """The present value of a key; None where it is stale."""
        found = self.last(key, kind)
        return None if found is None or self.is_stale(found) else found.value

    def age(self, found: Known[Any]) -> float:
        """How old a value is [s]; a look that asks for it is made again at every moment."""
        self._is_of_this_moment()
        return max(0.0, self.now - found.at)

    def is_over(self, moment: float) -> bool:
        """Whether it is later than a moment [s]."""
        is_over = self.now > moment
        if self._grounds is not None and not is_over:
            self._grounds.until = min(self._grounds.until, moment)
        return is_over

    def is_stale(self, found: Known[Any]) -> bool:
        """Whether a value is older than its key allows."""
        fresh = fresh_for(found.key)
        return fresh is None or self.is_over(found.at + fresh) or (math.isinf(fresh) and self.is_silent)

    def cameras(self) -> tuple[str, ...]:
        """Names of the cameras that published any value."""
        if self._grounds is not None:
            self._grounds.cameras = self.held.cameras
        return self.held.cameras

    def of_kind(self, kind: type[_Value]) -> Known[_Value] | None:
        """The newest value of a kind; of several cameras that of any."""
        suffix = _SUFFIXES.get(kind, "")
        if _CAMERA not in suffix:
            return self.last(suffix, kind)
        keys = (suffix.replace(_CAMERA, name) for name in self.cameras())
        found = [known for known in (self.last(key, kind) for key in keys) if known is not None]
        return max(found, key=lambda known: known.at, default=None)

    def link(self) -> Known[LinkState] | None:
        """The newest verdict on the line: what comes on change is repeated in `link/health`."""
        health = self.last("link/health", LinkHealth)
        state = self.last("link/state", LinkState)
        if health is not None and (state is None or health.at >= state.at):
            return Known(health.key, health.value.state, health.at)
        return state

    def _is_of_this_moment(self) -> None:
        if self._grounds is not None:
            self._grounds.until = self.now


@lru_cache(maxsize=512)
def _is_stream(key: str) -> bool:
    """Whether the daemon publishes a key again and again."""
    fresh, spec = fresh_for(key), find(key)
    return fresh is not None and math.isfinite(fresh) and spec is not None and spec.use is Use.PUBLISHED


def key_of(value: object) -> str:
    """The key that a value of the daemon comes under; empty for an event."""
    suffix = _SUFFIXES.get(type(value), "")
    return suffix.replace(_CAMERA, getattr(value, "camera", "")) if _CAMERA in suffix else suffix
