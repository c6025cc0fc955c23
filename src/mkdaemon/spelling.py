"""Foreign text, escaped so that no control character acts on the terminal or page that shows it."""

from __future__ import annotations

import re
from typing import Final

_ACTING: Final = re.compile(
    "\r(?!\n)|[\x00-\x08\x0b\x0c\x0e-\x1f\x7f-\x9f\xad\u061c\u180e\u200b-\u200f\u2028-\u202e\u2060-\u206f\ud800-\udfff\ufeff"
    "\ufff9-\ufffb\U000e0000-\U000e007f]"
)
"""Controls C0 (but for tab and the ends of lines) and C1, separators of lines, marks of direction, invisible ones, and
halves of letters, by which Python names bytes that are no text."""
_BREAKING: Final = re.compile(r"[\t\r\n]")


def spelled(text: str) -> str:
    """A text in which nothing acts on a terminal; lines and tabs stay."""
    return _ACTING.sub(_spell, text)


def on_one_line(text: object) -> str:
    """Foreign text as a part of one line: its line breaks cannot imitate a line of ours.

    Args:
        text: a text, or anything that has one.
    """
    return _BREAKING.sub(_spell, spelled(str(text)))


def _spell(found: re.Match[str]) -> str:
    return found.group().encode("unicode_escape").decode("ascii")
