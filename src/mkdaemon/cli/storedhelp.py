"""The help of every command, stored as text: cyclopts, rich and the command's own imports take half a second."""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from mkdaemon.cli.listing import screen_width

COLUMNS: Final = 80
"""Width of the stored texts."""
_TEXTS: Final = Path(__file__).with_name("help.json")
_FLAGS: Final = ("--help", "-h")


def stored_help(program: str, tokens: Sequence[str]) -> str | None:
    """The help that a command line asks for; None if it asks for none, or this screen needs another form.

    Args:
        program: its name.
        tokens: the command line without it.
    """
    if not tokens or tokens[-1] not in _FLAGS or screen_width() < COLUMNS or not _shows_boxes():
        return None
    text: str | None = json.loads(_TEXTS.read_text(encoding="utf-8")).get(" ".join((program, *tokens[:-1])))
    return text


def _shows_boxes() -> bool:
    """Whether standard output can encode the lines around a list."""
    encoding: str = getattr(sys.stdout, "encoding", None) or "utf-8"  # a closed one shows nothing
    return encoding.lower().replace("-", "") == "utf8"
