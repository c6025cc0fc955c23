"""Tables of the generated pages."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Final, TypeVar

from mkdaemon.errors import MkError

PLACE: Final = re.compile(r"(?P<begin><!-- table (?P<name>\w+) -->\n).*?(?P<end><!-- end -->)", re.DOTALL)
"""Where a table stands in a page whose prose is written by hand."""
_Results = TypeVar("_Results")


def table(head: tuple[str, ...], rows: Iterable[tuple[str, ...]]) -> Iterator[str]:
    """Return the lines of a table."""
    yield "| " + " | ".join(head) + " |"
    yield "|" + "---|" * len(head)
    for row in rows:
        yield "| " + " | ".join(escape(cell) for cell in row) + " |"


def escape(text: str) -> str:
    """Return a text that may stand in a cell."""
    return text.replace("|", "\\|")


def filled(root: Path, page: str, tables: Mapping[str, Callable[[_Results], Iterable[str]]], results: _Results) -> str:
    """Return a page with fresh tables.

    Args:
        root: root of the source tree.
        page: its file.
        tables: what makes the lines of each, by its name in the page.
        results: that they are made of.

    Raises:
        MkError: the page names a table that is not known, or one has no results.
    """

    def made(place: re.Match[str]) -> str:
        name = place["name"]
        if name not in tables:
            msg = f"{page}: no table '{name}'; known are {', '.join(tables)}"
            raise MkError(msg)
        try:
            lines = list(tables[name](results))
        except KeyError as missing:
            msg = f"{page}, table '{name}': no {missing} in docs/results; measure it again"
            raise MkError(msg) from None
        return place["begin"] + "\n".join(lines) + "\n" + place["end"]

    return PLACE.sub(made, (root / page).read_text(encoding="utf-8"))
