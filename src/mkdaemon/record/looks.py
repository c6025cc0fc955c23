"""Looks at the clock by the part of the daemon that a replay runs again, many in one notice.

The payload is a msgpack map: `actors` (names), `who` (one byte a look: a place in `actors`), `first` (time of the first
look [ns; monotonic]), `steps` (from each look to the next [ns]), `backlogs` (pairs: so many looks of this notice before
it, bytes that waited in the port from then on).
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Final, NamedTuple

import msgpack

from mkdaemon.record.entry import nanoseconds, seconds

MOST: Final = 128
"""Looks in one notice, after which it ends with the next change of actors."""
LONGEST: Final = 0.4
"""Time after which it does so too [s]."""
ACTORS: Final = 250
"""Most actors in one notice: their number is a byte."""


class Look(NamedTuple):
    """One look at the clock.

    Attributes:
        actor: who looked; see `mkdaemon.actor`.
        at: what was seen [s; monotonic].
    """

    actor: str
    at: float


@dataclass(frozen=True, slots=True)
class Looks:
    """What one notice says.

    Attributes:
        looks: in order.
        backlogs: how many of these looks came before, and bytes that waited in the port from then on.
    """

    looks: tuple[Look, ...]
    backlogs: tuple[tuple[int, int], ...]


class LookLog:
    """Collects looks until they are taken for a notice."""

    def __init__(self) -> None:
        self._last = ""
        self._begin()

    def _begin(self) -> None:
        self._actors: dict[str, int] = {}
        self._who = bytearray()
        self._times: list[int] = []
        self._backlogs: list[tuple[int, int]] = []

    @property
    def is_empty(self) -> bool:
        """Whether there is nothing to take."""
        return not self._times and not self._backlogs

    def ends_with(self, actor: str, at: float) -> bool:
        """Whether a notice should end before this look: it is long enough, and another one acts."""
        if not self._times or actor == self._last:
            return False
        is_long = len(self._times) >= MOST or nanoseconds(at - LONGEST) > self._times[0]
        return is_long or len(self._actors) >= ACTORS

    def add(self, actor: str, at: float) -> None:
        """Keep a look."""
        self._last = actor
        self._who.append(self._actors.setdefault(actor, len(self._actors)))
        self._times.append(nanoseconds(at))

    def add_backlog(self, size: int) -> None:
        """Keep how much waits in the port from now on [bytes]."""
        self._backlogs.append((len(self._times), size))

    def take(self) -> tuple[bytes, float | None]:
        """Return a payload, and when it begins [s; monotonic], and begin anew."""
        times = self._times
        steps = [after - before for before, after in pairwise(times)]
        fields = {
            "actors": list(self._actors),
            "who": bytes(self._who),
            "first": times[0] if times else 0,
            "steps": steps,
            "backlogs": self._backlogs,
        }
        payload: bytes = msgpack.packb(fields)
        began = seconds(times[0]) if times else None
        self._begin()
        return payload, began


def unpack_looks(payload: bytes) -> Looks:
    """Read a notice."""
    fields = msgpack.unpackb(payload)
    looks, at = [], fields["first"]
    for place, who in enumerate(fields["who"]):
        at += fields["steps"][place - 1] if place else 0
        looks.append(Look(fields["actors"][who], seconds(at)))
    return Looks(tuple(looks), tuple((before, size) for before, size in fields["backlogs"]))
