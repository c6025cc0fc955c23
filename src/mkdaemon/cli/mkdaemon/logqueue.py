"""Standard error behind a queue: a slow or missing reader neither delays nor ends the program."""

from __future__ import annotations

import io
import os
import threading
import time
from collections import deque
from typing import Final

CAPACITY: Final = 1 << 18
"""Most that waits to be written [bytes]; what comes when it is full is dropped and counted."""
RATE: Final = 10_000.0
"""Most that is written in the long run [bytes/s]."""
BURST: Final = float(CAPACITY)
"""Most that is written at once [bytes]."""
LEAVE: Final = 0.5
"""Longest wait at the end for a reader that stands still [s]."""


class LogQueue(io.TextIOBase):
    """A text stream whose writes return at once; a separate thread writes them to a descriptor.

    An error of the descriptor (no reader, a full disk) costs the text and nothing else. Text that was dropped
    is counted, and the count is written as soon as something can be written again.
    """

    def __init__(self, descriptor: int) -> None:
        """Start the thread.

        Args:
            descriptor: where the text goes; stays open.
        """
        super().__init__()
        self._descriptor = descriptor
        self._waiting: deque[bytes] = deque()
        self._size = 0
        self._dropped = 0
        self._credit, self._credited_at = BURST, time.monotonic()
        self._news = threading.Condition()
        self._is_writing = False
        threading.Thread(target=self._run, name="log", daemon=True).start()

    def writable(self) -> bool:
        """It is."""
        return True

    def isatty(self) -> bool:
        """Whether the descriptor is a terminal."""
        return os.isatty(self._descriptor)

    def fileno(self) -> int:
        """The descriptor itself."""
        return self._descriptor

    def write(self, text: str, /) -> int:
        """Queue a text, or drop and count it."""
        raw = text.encode(errors="backslashreplace")
        with self._news:
            now = time.monotonic()
            self._credit = min(BURST, self._credit + RATE * (now - self._credited_at))
            self._credited_at = now
            if len(raw) > self._credit or self._size + len(raw) > CAPACITY:
                self._dropped += 1
            else:
                self._credit -= len(raw)
                self._size += len(raw)
                self._waiting.append(raw)
                self._news.notify_all()
        return len(text)

    def drain(self, patience: float = LEAVE) -> None:
        """Wait until all is written, or for `patience` [s]."""
        with self._news:
            self._news.wait_for(lambda: not self._waiting and not self._is_writing, patience)

    def _run(self) -> None:
        while True:
            with self._news:
                self._is_writing = False
                self._news.notify_all()
                self._news.wait_for(lambda: self._waiting)
                raw = self._waiting.popleft()
                self._size -= len(raw)
                self._is_writing = True
                dropped, self._dropped = self._dropped, 0
            note = f"({dropped} texts dropped: too many, or no reader)\n".encode() if dropped else b""
            try:
                write_whole(self._descriptor, note + raw)
            except OSError:
                with self._news:
                    self._dropped += dropped + 1


def write_whole(descriptor: int, raw: bytes) -> None:
    """Write all bytes.

    Raises:
        OSError: they cannot be written.
    """
    left = memoryview(raw)
    while left:
        left = left[os.write(descriptor, left) :]
