"""The list of a program's commands, shown without importing the library that reads command lines."""

from __future__ import annotations

import os
import shutil
import sys
import textwrap
from collections.abc import Iterable, Iterator, Sequence
from typing import Final, NamedTuple

WIDEST: Final = 100
"""Columns of text that are read comfortably."""
_HELP: Final[tuple[list[str], ...]] = (["--help"], ["-h"], [])


class CommandEntry(NamedTuple):
    """One command of a table.

    Attributes:
        name: on the command line.
        target: `module:attribute` of a function or an `App`, imported when the command is used.
        help: one line shown in the list.
        group: heading it stands under.
        is_shown: it stands in the list.
    """

    name: str
    target: str
    help: str
    group: str = "Commands"
    is_shown: bool = True


def asks_for_list(tokens: Sequence[str]) -> bool:
    """Whether a command line asks for the list.

    Args:
        tokens: without the program's name.
    """
    return list(tokens) in _HELP


def print_help(text: str) -> None:
    """Print the list, or the help of a command."""
    try:
        print(text, flush=True)
    except BrokenPipeError:  # the reader has seen enough; what is left would fail once more at the end
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def screen_width() -> int:
    """Columns of the terminal; 80 without one."""
    return shutil.get_terminal_size((80, 24)).columns


def list_lines(name: str, about: str, table: Iterable[CommandEntry], width: int | None = None) -> Iterator[str]:
    """The lines of the list.

    Args:
        name: of the program.
        about: its own help, paragraphs of Markdown.
        table: its commands, in the order in which they and their headings are shown.
        width: columns of the screen; those of the terminal by default, 80 without one.
    """
    wide = min(width or screen_width(), WIDEST)
    shown = [entry for entry in table if entry.is_shown]
    yield f"Usage: {name} COMMAND"
    for paragraph in about.replace("`", "").split("\n\n"):
        yield ""
        yield from textwrap.wrap(" ".join(paragraph.split()), wide, break_on_hyphens=False)
    room = max(len(entry.name) for entry in shown) + 2
    for heading in dict.fromkeys(entry.group for entry in shown):
        yield f"\n{heading}"
        for entry in shown:
            if entry.group == heading:
                line, indent = f"  {entry.name:{room}}{entry.help.replace('`', '')}", " " * (room + 2)
                yield from textwrap.wrap(line, wide, subsequent_indent=indent, break_on_hyphens=False)
    yield f"\n{name} COMMAND --help says more about each."
