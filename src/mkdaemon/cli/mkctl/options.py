"""Options of every command may stand before it: `mkctl --vehicle mk1 status`."""

from __future__ import annotations

from collections.abc import Container, Sequence
from typing import Final

_WITH_VALUE: Final = frozenset({"--vehicle", "--connect", "--zenoh-file"})
_FLAGS: Final = frozenset({"--json"})


def move_behind_command(tokens: Sequence[str], groups: Container[str]) -> list[str]:
    """Move options that stand before the command, or inside its name, behind it.

    Args:
        tokens: the command line without the program's name.
        groups: commands whose name has a second word, for example `lease take`.

    Returns:
        The same words, the command first; without a command, what is left without these options.
    """
    left = list(tokens)
    options: list[str] = []
    command: list[str] = []
    while left and (not command or (len(command) == 1 and command[0] in groups)):
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
