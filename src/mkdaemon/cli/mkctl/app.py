"""`mkctl`: a client of the daemon. Every command is a Zenoh client like any other program's."""

from __future__ import annotations

import sys
from collections.abc import Container, Sequence
from typing import Final, NoReturn

from mkdaemon.cli.mkctl.commands import ABOUT, COMMANDS, GROUPS
from mkdaemon.cli.program import build as _build
from mkdaemon.cli.program import main as _main

_WITH_VALUE: Final = frozenset({"--vehicle", "--connect", "--zenoh-file"})
_FLAGS: Final = frozenset({"--json"})


def move_behind_command(tokens: Sequence[str], groups: Container[str]) -> list[str]:
    """Move options that stand before the command, or inside its name, behind it.

    Args:
        tokens: the command line without the program's name.
        groups: commands whose name has a further word, for example `lease`, `board mixer`.

    Returns:
        The same words, the command first; without a command, what is left without these options.
    """
    left = list(tokens)
    options: list[str] = []
    command: list[str] = []
    while left and (not command or " ".join(command) in groups):
        name, equals, _ = left[0].partition("=")
        if name in _WITH_VALUE and not equals and len(left) > 1:
            options += [left.pop(0), left.pop(0)]
        elif name in _WITH_VALUE | _FLAGS:
            options.append(left.pop(0))
        elif left[0].startswith("-"):
            break
        else:
            command.append(left.pop(0))
    return [*command, *options, *left] if command else left


app = _build("mkctl", ABOUT, COMMANDS)


def main() -> NoReturn:
    """Entry point."""
    _main("mkctl", ABOUT, COMMANDS, move_behind_command(sys.argv[1:], GROUPS))


if __name__ == "__main__":
    main()
