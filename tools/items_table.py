"""The table of mission items in docs/waypoints.md, made from `missions.items`."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Final

from mkdaemon.missions.items import COMMANDS, Otherwise, Param
from tools.markdown import table

_PLACE: Final = re.compile(r"(<!-- items: .*? -->\n).*?(<!-- end of items -->)", re.DOTALL)
_COLUMNS: Final = ("item", "parameter", "becomes", "says nothing", "anything else")
_OTHERWISE: Final = {
    Otherwise.REFUSED: "refused",
    Otherwise.NOTED: "left out and reported",
    Otherwise.NOTHING: "ignored",
}


def waypoints_page(root: Path) -> str:
    """Return docs/waypoints.md with the table of items made from the code.

    Args:
        root: root of the source tree.
    """
    rows = [
        (f"{number} {command.word}" if index == 0 else "", f"{index + 1} {param.word}", *_fate(param))
        for number, command in COMMANDS.items()
        for index, param in enumerate(command.params)
        if param.word != "empty"
    ]
    made = "\n".join(table(_COLUMNS, rows))
    text = (root / "docs/waypoints.md").read_text(encoding="utf-8")
    return _PLACE.sub(lambda place: f"{place[1]}\n{made}\n\n{place[2]}", text)


def _fate(param: Param) -> tuple[str, str, str]:
    becomes = f"`{param.field}`" if param.field else ""
    nothing = ", ".join(f"{value:g}" for value in param.nothing)
    if param.field:
        return becomes, nothing, param.why or "used; refused out of its range"
    word = _OTHERWISE[param.otherwise]
    return becomes, nothing, f"{word}: {param.why}" if param.why else word
