"""The last value of every key at a moment, and how old each is."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from fnmatch import fnmatchcase
from functools import cached_property, lru_cache
from typing import Any, Final, Generic, TypeVar

from mkdaemon.bus.keys import KEYS as TABLE
from mkdaemon.bus.keys import Use, find, fresh_for
from mkdaemon.telemetry.link import LinkHealth, LinkState

_Value = TypeVar("_Value")
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


class Knowledge:
    """Last values as they are known at a moment.

    Attributes:
        now: the moment, on the clock of the reader [s].
    """

    def __init__(self, last: Mapping[str, Known[Any]], now: float) -> None:
        """Look at values.

        Args:
            last: by their keys.
            now: the moment, on the clock of their times [s].
        """
        self.now = now
        self._last = last

    @cached_property
    def silence(self) -> float:
        """Age of the newest value of the daemon's streams [s]; infinite before the first."""
        return self.now - max((known.at for known in self._last.values() if _is_stream(known.key)), default=-math.inf)

    @property
    def is_silent(self) -> bool:
        """The daemon has missed three of its signs of life."""
        return self.silence > SIGN_OF_LIFE

    def last(self, key: str, kind: type[_Value]) -> Known[_Value] | None:
        """The last value of a key, however old; None before the first, and for one of another kind."""
        found = self._last.get(key)
        return found if found is not None and isinstance(found.value, kind) else None

    def fresh(self, key: str, kind: type[_Value]) -> _Value | None:
        """The present value of a key; None where it is stale."""
        found = self.last(key, kind)
        return None if found is None or self.is_stale(found) else found.value

    def age(self, found: Known[Any]) -> float:
        """How old a value is [s]."""
        return max(0.0, self.now - found.at)

    def is_stale(self, found: Known[Any]) -> bool:
        """Whether a value is older than its key allows."""
        fresh = fresh_for(found.key)
        return fresh is None or self.age(found) > fresh or (math.isinf(fresh) and self.is_silent)

    def cameras(self) -> list[str]:
        """Names of the cameras that published any value."""
        return sorted({key.split("/")[1] for key in self._last if key.startswith("vision/")})

    def of_kind(self, kind: type[_Value]) -> Known[_Value] | None:
        """The newest value of a kind, of any key."""
        found = (known for known in self._last.values() if isinstance(known.value, kind))
        return max(found, key=lambda known: known.at, default=None)

    def link(self) -> Known[LinkState] | None:
        """The newest verdict on the line: what comes on change is repeated in `link/health`."""
        health = self.last("link/health", LinkHealth)
        state = self.last("link/state", LinkState)
        if health is not None and (state is None or health.at >= state.at):
            return Known(health.key, health.value.state, health.at)
        return state

    def __iter__(self) -> Iterator[Known[Any]]:
        """All last values."""
        return iter(self._last.values())


@lru_cache(maxsize=512)
def _is_stream(key: str) -> bool:
    """Whether the daemon publishes a key again and again."""
    fresh, spec = fresh_for(key), find(key)
    return fresh is not None and math.isfinite(fresh) and spec is not None and spec.use is Use.PUBLISHED


def key_of(value: object) -> str:
    """The key that a value of the daemon comes under; empty for an event."""
    return _SUFFIXES.get(type(value), "").replace("<camera>", getattr(value, "camera", ""))
