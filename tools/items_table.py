"""The table of mission items in docs/waypoints.md, made from `missions.items`."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from mkdaemon.missions.items import COMMANDS, Otherwise, Param
from tools.markdown import table

_COLUMNS: Final = ("item", "parameter", "becomes", "says nothing", "anything else")
_OTHERWISE: Final = {
    Otherwise.REFUSED: "refused",
    Otherwise.NOTED: "left out and reported",
    Otherwise.NOTHING: "ignored",
}


def _items(_: None) -> Iterator[str]:
    """What becomes of every parameter of every item."""
    rows = (
        (f"{number} {command.word}" if index == 0 else "", f"{index + 1} {param.word}", *_fate(param))
        for number, command in COMMANDS.items()
        for index, param in enumerate(command.params)
        if param.word != "empty"
    )
    return table(_COLUMNS, rows)


def _fate(param: Param) -> tuple[str, str, str]:
    becomes = f"`{param.field}`" if param.field else ""
    nothing = ", ".join(f"{value:g}" for value in param.nothing)
    if param.field:
        return becomes, nothing, param.why or "used; refused out of its range"
    word = _OTHERWISE[param.otherwise]
    return becomes, nothing, f"{word}: {param.why}" if param.why else word


TABLES: Final = {"items": _items}
"""By the name that the page gives it."""
