"""The keyboard of a terminal, here or behind ssh: keys one by one, and whether the terminal is still there."""

from __future__ import annotations

import asyncio
import os
from collections.abc import Callable
from typing import Final, TextIO

from mkdaemon.cli.keyreader import QUIT, KeyReader
from mkdaemon.cli.mkctl.teleop.devices import DeviceLostError, DeviceState
from mkdaemon.client.teleop.keys import FACTS, Keys

ASKING: Final = 0.08
"""Between two questions whether the terminal is there [s]."""
QUESTION: Final = b"\x1b[5n"
"""Whether a terminal is there; every one since the VT100 answers."""
PATIENCE: Final = 2.0
"""Longest wait for the first answer [s]."""


class Keyboard:
    """The keyboard of a terminal as a pad.

    Attributes:
        name: `keyboard`.
        facts: what it says about itself.
        keys: the pad that its keys stand for.
    """

    def __init__(
        self,
        keys: int,
        screen: TextIO,
        quit_now: Callable[[], None],
        report: Callable[[str, str, float, float], None],
    ) -> None:
        """Begin to read a terminal, which is in raw mode already; see `raw_terminal`.

        Args:
            keys: descriptor it is read from.
            screen: what is written to it.
            quit_now: is called for Q and Ctrl-C.
            report: called with every key: name, control, raw value, time.
        """
        self.name, self.facts, self.keys = "keyboard", FACTS, Keys()
        self._descriptor, self._screen = keys, screen
        self._quit, self._report = quit_now, report
        self._reader = KeyReader()
        self._loop = asyncio.get_running_loop()
        self._began = self._asked_at = self._loop.time()
        self._is_open = True
        self._loop.add_reader(self._descriptor, self._read)

    def _read(self) -> None:
        try:
            data = os.read(self._descriptor, 256)
        except OSError:  # the terminal was hung up
            data = b""
        now = self._loop.time()
        if not data:
            self._is_open = False
            self._loop.remove_reader(self._descriptor)
        for key in self._reader.feed(data):
            if key == "alive":
                self.keys.alive(now)
            elif key in QUIT:
                self._quit()
            else:
                self.keys.typed(key, now)
                self._report(self.name, "", 1.0, now)

    def ask(self, now: float) -> DeviceState | None:
        """Return the state of the keys, as old as the last answer of the terminal; ask the terminal again.

        Raises:
            DeviceLostError: the terminal was closed, or never answered.
        """
        if not self._is_open:
            raise DeviceLostError("the terminal was closed")
        if now - self._asked_at >= ASKING:
            self._asked_at = now
            try:
                self._screen.write(QUESTION.decode())
                self._screen.flush()
            except OSError as error:
                raise DeviceLostError(f"the terminal is gone: {error.strerror}") from error
        alive_at = self.keys.alive_at
        if alive_at is None:
            if now - self._began > PATIENCE:
                msg = "this terminal does not answer ESC[5n, so its loss could not be detected: use another one"
                raise DeviceLostError(msg)
            return None
        return DeviceState(self.keys.state(now), alive_at)

    def alarm(self) -> None:
        """Ring the bell."""
        self._screen.write("\a")
        self._screen.flush()

    def let_go(self) -> None:
        """Switch the enable button off."""
        self.keys.let_go()

    def close(self) -> None:
        """Read no more; without its keyboard the program ends."""
        self._loop.remove_reader(self._descriptor)
        self._quit()
