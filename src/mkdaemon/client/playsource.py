"""The published values of a recording, from any place in it: what a player reads."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Protocol

from mkdaemon.record.entry import Entry, EntryKind
from mkdaemon.record.layout import ChannelFacts
from mkdaemon.record.reader import Recording, matches_any

Progress = Callable[[int], None]
"""Takes how many bytes of a file have been read."""
Choice = Callable[[str], bool]
"""Chooses keys."""


class PlaySource(Protocol):
    """Values that can be played. All times are those of the file [ns]."""

    def times(self, progress: Progress) -> Iterator[tuple[ChannelFacts, int]]:
        """Channel and time of every value, in order."""

    def entries(self, first: int, last: int | None = None, choice: Choice | None = None) -> Iterator[Entry]:
        """Values from one time to another, of all keys or of some, in order."""

    def latest(self, before: int) -> list[Entry]:
        """The last value of each key before a time, also from before the part that is played."""


class RecordedSamples:
    """The published values of a file, or of a part of it."""

    def __init__(
        self, file: Path, keys: tuple[str, ...] = (), first: int | None = None, last: int | None = None
    ) -> None:
        """Name the part.

        Args:
            file: the recording.
            keys: patterns of the keys that are wanted; none for all.
            first: time in the file of the first value [ns]; None for the beginning.
            last: of the last one; None for the end.
        """
        self._recording, self._keys = Recording(file), keys
        self._first, self._last = first or 0, last

    def times(self, progress: Progress) -> Iterator[tuple[ChannelFacts, int]]:
        """See `PlaySource`; reads the whole file once.

        Raises:
            MkError: it cannot be read.
        """
        for number, (facts, at) in enumerate(self._recording.times(self._is_wanted)):
            if number % 1000 == 0:
                progress(self._recording.position)
            if self._first <= at and (self._last is None or at <= self._last):
                yield facts, at

    def entries(self, first: int, last: int | None = None, choice: Choice | None = None) -> Iterator[Entry]:
        """See `PlaySource`."""
        ends = [one for one in (last, self._last) if one is not None]
        yield from self._recording.again().entries(
            lambda facts: self._is_wanted(facts) and (choice is None or choice(facts.key)),
            first=max(first, self._first, 1),
            last=min(ends, default=None),
        )

    def latest(self, before: int) -> list[Entry]:
        """See `PlaySource`."""
        return self._recording.again().latest(self._is_wanted, before)

    def _is_wanted(self, facts: ChannelFacts) -> bool:
        return facts.kind is EntryKind.SAMPLE and matches_any(facts.key, self._keys)
