"""Keys of a terminal one by one, without Return and without echo."""

from __future__ import annotations

import asyncio
import os
import re
import termios
import tty
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Final

ANSWER: Final = b"\x1b[0n"
"""What a terminal answers that is asked whether it is there: Device Status Report, ECMA-48 8.3.35."""
QUIT: Final = frozenset({"q", "\x03", "\x04"})
"""Keys that end a program."""
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
        termios.tcflush(terminal, termios.TCIFLUSH)  # the shell must not get what was typed and not read
        termios.tcsetattr(terminal, termios.TCSADRAIN, before)


@contextmanager
def taking_keys(terminal: int, take: Callable[[str], None]) -> Iterator[None]:
    """Hand over every key that is typed while the context lasts; `q` where the terminal is gone.

    Args:
        terminal: its descriptor.
        take: is called on the loop.
    """
    loop, reader = asyncio.get_running_loop(), KeyReader()

    def read() -> None:
        try:
            data = os.read(terminal, 256)
        except OSError:  # the terminal was hung up
            data = b""
        for key in reader.feed(data) if data else "q":
            take(key)

    with raw_terminal(terminal):
        loop.add_reader(terminal, read)
        try:
            yield
        finally:
            loop.remove_reader(terminal)
