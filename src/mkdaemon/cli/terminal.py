r"""Text on its way to a terminal: nothing in it acts on the terminal, and what its encoding lacks has other letters.

The texts of a program are mixed with what others wrote: keys and values from the bus, names of files, what stands in
files, what boards call themselves. A caller of `print` need not know: the streams of a program are guarded while it
runs (`guarded_streams`), and every control character, every mark that turns the direction of writing and every
invisible one comes out as Python spells it, `\x1b` for example. Pictures of rich go through `mkdaemon.cli.console`,
which guards their text and lets their own colours pass; a screen that is drawn by hand goes to `drawing_stream`.
"""

from __future__ import annotations

import codecs
import io
import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import Final, TextIO, cast

from mkdaemon.spelling import on_one_line as on_one_line
from mkdaemon.spelling import spelled as spelled

_ERRORS: Final = "mkdaemon.plain"
_PLAIN: Final = {"°": " deg", "²": "2", "±": "+/-", "µ": "u", "×": "x", "·": ".", "–": "-", "—": "-", "…": "..."}
_PLAIN.update(zip("▁▂▃▄▅▆▇█", "_.-=+*%#", strict=True))


class GuardedStream:
    """A text stream that spells what would act on a terminal.

    Attributes:
        rich_proxied_file: the stream beneath; rich, which asks for this name, draws on it.
    """

    def __init__(self, beneath: TextIO) -> None:
        self.rich_proxied_file = beneath

    def write(self, text: str, /) -> int:
        """Write a text."""
        self.rich_proxied_file.write(spelled(text))
        return len(text)

    def writelines(self, lines: Iterable[str], /) -> None:
        """Write several."""
        for line in lines:
            self.write(line)

    def __getattr__(self, name: str) -> object:
        return getattr(self.rich_proxied_file, name)


def guarded(stream: TextIO) -> TextIO:
    """A stream that spells what would act on a terminal."""
    return stream if isinstance(stream, GuardedStream) else cast("TextIO", GuardedStream(stream))


def drawing_stream(stream: TextIO) -> TextIO:
    """The stream beneath, for what draws a screen; every text of others in it has to go through `on_one_line` first.

    Args:
        stream: `sys.stdout` or `sys.stderr`.
    """
    return stream.rich_proxied_file if isinstance(stream, GuardedStream) else stream


@contextmanager
def guarded_streams() -> Iterator[None]:
    """Let nothing that is printed while the context lasts act on a terminal."""
    before = sys.stdout, sys.stderr
    sys.stdout, sys.stderr = ours = guarded(sys.stdout), guarded(sys.stderr)
    try:
        yield
    finally:
        # Who put another stream in the place of one, as the daemon's log does, has guarded it himself.
        if sys.stdout is ours[0]:
            sys.stdout = before[0]
        if sys.stderr is ours[1]:
            sys.stderr = before[1]


def print_whatever_the_encoding() -> None:
    """Let nothing that is printed fail because the terminal's encoding lacks a letter, as `LC_ALL=C` does."""
    codecs.register_error(_ERRORS, _in_plain_letters)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors=_ERRORS)


def _in_plain_letters(error: UnicodeError) -> tuple[str | bytes, int]:
    if not isinstance(error, UnicodeEncodeError):
        raise error
    lacking = error.object[error.start : error.end]
    return "".join(_PLAIN.get(letter, "?") for letter in lacking), error.end
