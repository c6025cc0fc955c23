"""What happened in a recorded daemon, in order: what it saw on its clock, and what came in between two looks."""

from __future__ import annotations

from bisect import bisect_right
from collections import deque
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from mkdaemon.record.entry import Entry, Kind
from mkdaemon.record.looks import Look


@dataclass(frozen=True, slots=True)
class Moment:
    """Something that came in.

    Attributes:
        at: when it was taken [s; monotonic].
        entry: what was recorded.
        place: so many looks came before it.
    """

    at: float
    entry: Entry
    place: int


class Script:
    """Looks and inputs of a recording, and how far a replay has come.

    A look belongs to whoever looked. It can be taken until the next input has come: so code that looks more often or
    less often than it did is in step again with every input.
    """

    def __init__(
        self, looks: Sequence[Look], inputs: Iterable[Moment] = (), backlogs: Sequence[tuple[int, int]] = ()
    ) -> None:
        """Begin at the beginning.

        Args:
            looks: in order.
            inputs: in order.
            backlogs: before which look, and how many bytes waited in the port from then on; in order.
        """
        self._looks = looks
        self._inputs = deque(inputs)
        self._backlogs = backlogs
        self._mine: dict[str, deque[int]] = {}
        for place, look in enumerate(looks):
            self._mine.setdefault(look.actor, deque()).append(place)
        self._is_taken = bytearray(len(looks))
        self._head = self._last = 0

    @property
    def next_input(self) -> Moment | None:
        """What comes in next, where nothing is seen on the clock before it."""
        if self._inputs and self._inputs[0].place <= self._head:
            return self._inputs[0]
        return None

    @property
    def next_look(self) -> Look | None:
        """What is seen next; None at the end."""
        return self._looks[self._head] if self._head < len(self._looks) else None

    @property
    def backlog(self) -> int:
        """Bytes that wait in the port now."""
        place = bisect_right(self._backlogs, self._last, key=lambda pair: pair[0])
        return self._backlogs[place - 1][1] if place else 0

    def take_input(self) -> Moment:
        """Return what comes in next."""
        self._last = max(self._last, self._inputs[0].place)
        return self._inputs.popleft()

    def comes_next(self) -> Moment | None:
        """What came in right after the look that was taken last, in the same breath."""
        return self._inputs[0] if self._inputs and self._inputs[0].place == self._last else None

    def take_look(self, actor: str) -> float | None:
        """Return what somebody sees [s]; None where they did not look before the next input."""
        mine = self._mine.get(actor)
        if not mine or (self._inputs and mine[0] >= self._inputs[0].place):
            return None
        place = mine.popleft()
        self._is_taken[place] = True
        self._last = place + 1
        self._go_on()
        return self._looks[place].at

    def skip_look(self) -> None:
        """Leave out what is seen next: nobody is there to see it."""
        self._mine[self._looks[self._head].actor].popleft()
        self._is_taken[self._head] = True
        self._go_on()

    def next_of(self, actor: str) -> float | None:
        """When somebody looks next [s]; None where they never do again."""
        mine = self._mine.get(actor)
        return self._looks[mine[0]].at if mine else None

    def brings(self, kind: Kind, *, before: str) -> bool:
        """Whether something of a kind comes in before somebody looks again."""
        mine = self._mine.get(before)
        for moment in self._inputs:
            if mine and moment.place > mine[0]:
                return False
            if moment.entry.kind is kind:
                return True
        return False

    def _go_on(self) -> None:
        while self._head < len(self._looks) and self._is_taken[self._head]:
            self._head += 1
