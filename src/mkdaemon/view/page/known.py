"""The last value of every key, and how old each is."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Generic, TypeVar

from mkdaemon.client.summary import fresh_for
from mkdaemon.telemetry.base import Stamped

_Value = TypeVar("_Value", bound=Stamped)


@dataclass(frozen=True, slots=True)
class Known(Generic[_Value]):
    """A last value.

    Attributes:
        value: the value.
        at: its stamp [s; the daemon's monotonic].
    """

    value: _Value
    at: float


class Knowledge:
    """Last values as they are known at a moment.

    Attributes:
        now: the moment [s; the daemon's monotonic].
    """

    def __init__(self) -> None:
        """Know nothing."""
        self.now = 0.0
        self._last: dict[str, Known[Any]] = {}

    def take(self, suffix: str, value: Stamped) -> None:
        """Know a value; one that is older than what is known is left."""
        before = self._last.get(suffix)
        if before is None or value.stamp.monotonic >= before.at:
            self._last[suffix] = Known(value, value.stamp.monotonic)

    def forget(self) -> None:
        """Know nothing again."""
        self._last.clear()

    def last(self, suffix: str, kind: type[_Value]) -> Known[_Value] | None:
        """The last value of a key, however old; None before the first."""
        found = self._last.get(suffix)
        return found if found is not None and isinstance(found.value, kind) else None

    def fresh(self, suffix: str, kind: type[_Value]) -> _Value | None:
        """The last value of a key; None where it is stale."""
        found = self.last(suffix, kind)
        return None if found is None or self.is_stale(suffix, found) else found.value

    def age(self, found: Known[Any]) -> float:
        """How old a value is [s]."""
        return max(0.0, self.now - found.at)

    def is_stale(self, suffix: str, found: Known[Any]) -> bool:
        """Whether a value is older than its key allows."""
        return self.age(found) > fresh_for(suffix)

    def cameras(self) -> list[str]:
        """Names of the cameras that said anything."""
        return sorted({key.split("/")[1] for key in self._last if key.startswith("vision/")})
