"""The help of every command as a program shows it in 80 columns, so that none is imported for it."""

from __future__ import annotations

import io
import json
from collections.abc import Iterator
from pathlib import Path

from cyclopts import App
from rich.console import Console

from mkdaemon.cli.mkctl.commands import ABOUT as CTL_ABOUT
from mkdaemon.cli.mkctl.commands import COMMANDS as CTL_COMMANDS
from mkdaemon.cli.mkdaemon.commands import ABOUT as DAEMON_ABOUT
from mkdaemon.cli.mkdaemon.commands import COMMANDS as DAEMON_COMMANDS
from mkdaemon.cli.program import build
from mkdaemon.cli.storedhelp import COLUMNS


def help_texts(_: Path) -> str:
    """The file that `mkdaemon.cli.storedhelp` reads.

    Args:
        _: root of the source tree; the programs are those that are imported.
    """
    texts: dict[str, str] = {}
    for name, about, table in (("mkctl", CTL_ABOUT, CTL_COMMANDS), ("mkdaemon", DAEMON_ABOUT, DAEMON_COMMANDS)):
        app = build(name, about, table)
        for first in (entry.name for entry in table if entry.is_shown):
            commands = list(_words(app, (first,)))  # all are imported: a group shows the first line of each
            texts |= {" ".join((name, *words)): _shown(app, words) for words in commands}
    return json.dumps(texts, indent=0, ensure_ascii=False) + "\n"


def _words(app: App, words: tuple[str, ...]) -> Iterator[tuple[str, ...]]:
    """A command and those below it."""
    yield words
    found = app
    for word in words:
        found = found[word]
    for name in found:
        if name not in {*found.help_flags, *found.version_flags}:
            yield from _words(app, (*words, name))


def _shown(app: App, words: tuple[str, ...]) -> str:
    """Its help."""
    text = io.StringIO()
    console = Console(file=text, width=COLUMNS, color_system=None, force_terminal=False)
    app.help_print(words, console=console)
    return "\n".join(line.rstrip() for line in text.getvalue().rstrip().splitlines())
