"""How every campaign shows its rows: one JSON object, or one table."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any, Final

from rich.table import Table

from lab.campaign import plain
from mkdaemon.cli.console import Console

LONGEST: Final = 80
"""Characters of a figure that a table shows; JSON has all of it."""


def show(rows: Sequence[Mapping[str, Any]], named: Sequence[str], *, as_json: bool, **more: Any) -> int:
    """Print rows.

    Args:
        rows: with their figures; `holds` is False where one breaks a limit.
        named: figures that name a row: the first columns of the table. The others follow by their names.
        as_json: one object in place of the table.
        more: of that object, beside the rows.

    Returns:
        Exit code: 1 where a row does not hold.
    """
    holds = all(row.get("holds", True) for row in rows)
    if as_json:
        print(json.dumps(plain({"rows": list(rows), **more, "holds": holds})))
        return 0 if holds else 1
    table = Table(*named, "measured", "holds")
    for row in rows:
        figures = (f"{name} {_cell(value)}" for name, value in row.items() if name not in (*named, "holds"))
        shown = ", ".join(words for words in figures if len(words) <= LONGEST)
        table.add_row(*(_cell(row[name]) for name in named), shown, "yes" if row.get("holds", True) else "NO")
    Console().print(table)
    return 0 if holds else 1


def _cell(value: Any) -> str:
    return value if isinstance(value, str) else json.dumps(plain(value))
