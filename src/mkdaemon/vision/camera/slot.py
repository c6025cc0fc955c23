"""The only queue in the image path: one place for each sender, the newest wins."""

from __future__ import annotations

import threading
from collections import Counter
from typing import Generic, TypeVar

T = TypeVar("T")


class NewestSlot(Generic[T]):
    """Hands values from the threads of its senders to one reader.

    The newest value of a sender replaces the one before, which is `dropped` if nobody took it. Senders take turns.
    """

    def __init__(self) -> None:
        self._changed = threading.Condition()
        self._waiting: dict[str, T] = {}
        self._closed = False
        self.dropped: Counter[str] = Counter()

    def put(self, value: T, sender: str = "") -> None:
        """Replace whatever is there of this sender."""
        with self._changed:
            self.dropped[sender] += sender in self._waiting
            self._waiting[sender] = value
            self._changed.notify_all()

    def take(self, timeout: float) -> T | None:
        """Wait up to `timeout` [s] for a value and take it out; None when there is none or the slot is closed."""
        with self._changed:
            self._changed.wait_for(lambda: self._waiting or self._closed, timeout)
            if not self._waiting:
                return None
            self._changed.notify_all()
            return self._waiting.pop(next(iter(self._waiting)))

    def wait_taken(self, sender: str) -> None:
        """Wait until nothing of a sender is left: for sources that must not outrun the reader."""
        with self._changed:
            self._changed.wait_for(lambda: sender not in self._waiting or self._closed)

    def close(self) -> None:
        """Wake whoever waits; nobody waits again."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()
