"""The only queue in the image path: one place, the newest wins."""

from __future__ import annotations

import threading
from typing import Generic, TypeVar

T = TypeVar("T")


class NewestSlot(Generic[T]):
    """Hands the newest value from one thread to another; an older one nobody took is dropped and counted."""

    def __init__(self, changed: threading.Condition | None = None) -> None:
        self._changed = changed or threading.Condition()
        self._value: T | None = None
        self._closed = False
        self.dropped = 0

    def put(self, value: T) -> None:
        """Replace whatever is there."""
        with self._changed:
            if self._value is not None:
                self.dropped += 1
            self._value = value
            self._changed.notify_all()

    def take(self, timeout: float) -> T | None:
        """Wait up to `timeout` [s] for a value and empty the slot; None when there is none or the slot is closed."""
        with self._changed:
            self._changed.wait_for(lambda: self._value is not None or self._closed, timeout)
            value, self._value = self._value, None
            self._changed.notify_all()
            return value

    @property
    def is_full(self) -> bool:
        """Whether a value waits."""
        return self._value is not None

    def wait_taken(self) -> None:
        """Wait until the slot is empty or closed: for sources that must not outrun their reader."""
        with self._changed:
            self._changed.wait_for(lambda: self._value is None or self._closed)

    def close(self) -> None:
        """Wake whoever waits; later values are never seen."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()


class NewestSlots(Generic[T]):
    """Several slots with one reader, who takes from each in turn."""

    def __init__(self) -> None:
        self._changed = threading.Condition()
        self._slots: list[NewestSlot[T]] = []

    def add(self) -> NewestSlot[T]:
        """One more slot."""
        slot: NewestSlot[T] = NewestSlot(self._changed)
        self._slots.append(slot)
        return slot

    def take(self, timeout: float) -> T | None:
        """Wait up to `timeout` [s] for a value in any slot; the slots take turns, so none starves."""
        with self._changed:
            self._changed.wait_for(lambda: any(slot.is_full for slot in self._slots), timeout)
            full = next((slot for slot in self._slots if slot.is_full), None)
            if full is None:
                return None
            self._slots.remove(full)
            self._slots.append(full)  # the others first, next time
            return full.take(0.0)
