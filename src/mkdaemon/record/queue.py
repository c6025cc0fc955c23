"""Entries on their way to the thread that writes them: bounded, never waits, counts what it loses."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable, Sequence
from typing import Final

from mkdaemon.record.entry import Entry

OVERHEAD: Final = 600
"""What an entry takes in memory beside its payload [bytes]."""
DEFERRED_SHARE: Final = 0.25
"""Deferred entries are taken only while less than this share is full: images give way to everything else."""

Deferred = Callable[[], Entry | None]
"""Makes an entry on the writing thread; None where nothing came of it."""


class EntryQueue:
    """First in, first out; from any thread.

    What has no room is lost: entries that wait are older, and come first in the file as well. Sequence numbers, given
    before, show the loss.

    Attributes:
        capacity: how much may wait [bytes].
    """

    def __init__(self, capacity: int) -> None:
        self.capacity = capacity
        self._waiting: deque[tuple[Entry | Deferred, int]] = deque()
        self._size = 0
        self._lost = 0
        self._lock = threading.Lock()

    def put(self, entry: Entry) -> None:
        """Take an entry; returns at once."""
        self._put(entry, len(entry.payload) + OVERHEAD, self.capacity)

    def defer(self, deferred: Deferred, size: int) -> None:
        """Take something that becomes an entry on the writing thread.

        Args:
            deferred: makes it.
            size: what it holds meanwhile [bytes].
        """
        self._put(deferred, size + OVERHEAD, int(self.capacity * DEFERRED_SHARE))

    def take(self, most: int) -> list[Entry | Deferred]:
        """Return up to this number of entries, the oldest first."""
        with self._lock:
            taken = [self._waiting.popleft() for _ in range(min(most, len(self._waiting)))]
            self._size -= sum(size for _, size in taken)
        return [item for item, _ in taken]

    def put_back(self, entries: Sequence[Entry]) -> None:
        """Take entries again that could not be written; they come first next time.

        Args:
            entries: in the order in which they were taken.
        """
        with self._lock:
            for entry in reversed(entries):
                size = len(entry.payload) + OVERHEAD
                if self._size + size > self.capacity:
                    self._lost += 1
                else:
                    self._waiting.appendleft((entry, size))
                    self._size += size

    def count_lost(self, number: int) -> None:
        """Count entries that were taken and could not be written."""
        with self._lock:
            self._lost += number

    @property
    def size(self) -> int:
        """How much waits [bytes]."""
        return self._size

    @property
    def lost(self) -> int:
        """Entries lost since the beginning."""
        return self._lost

    def __len__(self) -> int:
        return len(self._waiting)

    def _put(self, item: Entry | Deferred, size: int, limit: int) -> None:
        with self._lock:
            if self._size + size > limit:
                self._lost += 1
                return
            self._waiting.append((item, size))
            self._size += size
