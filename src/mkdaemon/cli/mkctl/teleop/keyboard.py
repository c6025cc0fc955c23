"""The keyboard of a terminal, here or behind ssh: keys one by one, and whether the terminal is still there."""

from __future__ import annotations

import asyncio
import os
import re
import termios
import tty
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Final, TextIO

from mkdaemon.cli.mkctl.teleop.devices import DeviceLostError, DeviceState
from mkdaemon.client.teleop.keys import FACTS, Keys

ASKING: Final = 0.08
"""Between two questions whether the terminal is there [s]."""
QUESTION: Final = b"\x1b[5n"
"""Device Status Report, ECMA-48 8.3.35; every terminal since the VT100 answers `ESC [ 0 n`."""
ANSWER: Final = b"\x1b[0n"
PATIENCE: Final = 2.0
"""Longest wait for the first answer [s]."""
QUIT: Final = frozenset({"q", "\x03", "\x04"})
_ARROWS: Final = {"A": "up", "B": "down", "C": "right", "D": "left"}
_TOKEN: Final = re.compile(
    rb"\x1b\[(?P<arguments>[0-9;?]*)(?P<final>[@-~])|\x1bO(?P<arrow>[A-D])|(?P<key>[^\x1b])|\x1b"
)
_UNFINISHED: Final = re.compile(rb"\x1b(\[[0-9;?]*|O)?$")


class KeyReader:
    """Splits what a terminal sends into keys; an escape sequence that is cut in two stays whole."""

    def __init__(self) -> None:
        self._rest = b""

    def feed(self, data: bytes) -> Iterator[str]:
        """Yield keys: characters, `up`, `down`, `left`, `right`, and `alive` for an answer of the terminal."""
        text = self._rest + data
        rest = _UNFINISHED.search(text)
        self._rest = b"" if rest is None else rest[0]
        for token in _TOKEN.finditer(text[: len(text) - len(self._rest)]):
            if token[0] == ANSWER:
                yield "alive"
            elif (arrow := token["arrow"] or token["final"]) is not None:
                if (key := _ARROWS.get(arrow.decode())) is not None:
                    yield key
            elif token["key"] is not None:
                yield token["key"].decode("latin-1")


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
            report: is told that something was typed: name, control, raw value, time.
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
        """Return what the keys stand for, as old as the last sign of the terminal; ask it anew.

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
                msg = "this terminal does not answer ESC[5n, so nobody would know when it is gone: use another one"
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


@contextmanager
def raw_terminal(terminal: int) -> Iterator[None]:
    """Give keys without Return and without echo; everything is as before afterwards, whatever happens.

    Args:
        terminal: its descriptor.
    """
    before = termios.tcgetattr(terminal)
    try:
        tty.setcbreak(terminal)
        yield
    finally:
        termios.tcflush(terminal, termios.TCIFLUSH)
        termios.tcsetattr(terminal, termios.TCSADRAIN, before)
