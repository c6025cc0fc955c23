"""A pseudo terminal: what a program shows on it, and what is typed."""

from __future__ import annotations

import os
import pty
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress

import pytest


class PseudoTerminal:
    """Both ends of it.

    Attributes:
        near: the end of the program.
        screen: the same, to write to.
        shown: everything that came out so far.
    """

    def __init__(self) -> None:
        self._far, self.near = pty.openpty()
        os.set_blocking(self._far, False)
        self.keys, self.screen = os.fdopen(os.dup(self.near)), os.fdopen(os.dup(self.near), "w", buffering=1)
        self.shown = b""

    def type(self, data: bytes) -> None:
        """Type on it."""
        os.write(self._far, data)

    def shows(self, expected: bytes) -> bool:
        """Whether it has shown something by now; a worker of the kernel carries it."""
        with suppress(BlockingIOError):
            self.shown += os.read(self._far, 65536)
        return expected in self.shown

    def close(self) -> None:
        """Close both ends."""
        self.keys.close()
        self.screen.close()
        for end in (self.near, self._far):
            os.close(end)


@contextmanager
def own_terminal(monkeypatch: pytest.MonkeyPatch, *screens: str) -> Iterator[PseudoTerminal]:
    """A terminal in place of this program's own, for its keys and for some streams of `sys`."""
    fake = PseudoTerminal()
    with monkeypatch.context() as patch:
        patch.setenv("TERM", "xterm")
        patch.setenv("COLUMNS", "160")
        patch.delenv("NO_COLOR", raising=False)
        patch.setattr(sys, "stdin", fake.keys)
        for name in screens:
            patch.setattr(sys, name, fake.screen)
        yield fake
    fake.close()
