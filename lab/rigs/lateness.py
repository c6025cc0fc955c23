"""How late the machine is: the running loop, and the kernel that carries the bytes of a pseudo terminal.

Such bytes wait for a worker of the kernel, an ordinary program to the scheduler: beside a load of 6 to 8 on two cores
it was late by 0.35 s (docs/lab/attacks.md). What is measured through a pseudo terminal is late by as much.
"""

from __future__ import annotations

import asyncio
import os
import threading
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Final

from lab.rigs.waiting import running
from mksim.runtime import PseudoTerminal

LOOK: Final = 0.005
"""Time between two looks [s]."""


class Lateness:
    """The longest delays since the last `forget`.

    Attributes:
        loop: of the running loop [s].
        terminal: of one byte through a pseudo terminal, until the loop had it [s].
        thread: of an ordinary thread of this process, as those are that carry what a client puts [s].
    """

    def __init__(self) -> None:
        self.loop = self.terminal = self.thread = 0.0
        self._is_over = threading.Event()
        self._terminal = PseudoTerminal()
        self._far = os.open(self._terminal.name, os.O_WRONLY | os.O_NOCTTY)
        self._sent: float | None = None

    def forget(self) -> None:
        """Begin anew."""
        self.loop = self.terminal = self.thread = 0.0

    async def run(self) -> None:
        """Look for ever."""
        loop = asyncio.get_running_loop()
        loop.add_reader(self._terminal.fileno(), self._arrived)
        thread = threading.Thread(target=self._look_from_thread, name="lateness")
        thread.start()
        try:
            while True:
                due = loop.time() + LOOK
                await asyncio.sleep(LOOK)
                self.loop = max(self.loop, loop.time() - due)
                if self._sent is None:
                    self._sent = loop.time()
                    os.write(self._far, b".")
                else:
                    self.terminal = max(self.terminal, loop.time() - self._sent)
        finally:
            self._is_over.set()
            thread.join()
            loop.remove_reader(self._terminal.fileno())
            os.close(self._far)
            self._terminal.close()

    def _look_from_thread(self) -> None:
        while not self._is_over.is_set():
            due = time.monotonic() + LOOK
            self._is_over.wait(LOOK)
            self.thread = max(self.thread, time.monotonic() - due)

    def _arrived(self) -> None:
        if self._terminal.read() and self._sent is not None:
            self.terminal = max(self.terminal, asyncio.get_running_loop().time() - self._sent)
            self._sent = None


@asynccontextmanager
async def measured_lateness() -> AsyncIterator[Lateness]:
    """Look for as long as the context lasts."""
    lateness = Lateness()
    async with running(lateness.run()):
        yield lateness
