"""Text for every terminal: what its encoding lacks is written in letters that it has."""

from __future__ import annotations

import codecs
import io
import sys
from typing import Final

_ERRORS: Final = "mkdaemon.plain"
_PLAIN: Final = {"°": " deg", "²": "2", "±": "+/-", "µ": "u", "×": "x", "·": ".", "–": "-", "—": "-", "…": "..."}


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
