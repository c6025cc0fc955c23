"""Tables of the generated pages."""

from __future__ import annotations

import importlib
import json
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, Final, NamedTuple

from lab.campaign import Results
from mkdaemon.errors import MkError

PLACE: Final = re.compile(r"(?P<begin><!-- table (?P<name>\w+) -->\n).*?(?P<end><!-- end -->)", re.DOTALL)
"""Where a table stands in a page whose prose is written by hand."""


def table(head: tuple[str, ...], rows: Iterable[tuple[str, ...]]) -> Iterator[str]:
    """Return the lines of a table."""
    yield "| " + " | ".join(head) + " |"
    yield "|" + "---|" * len(head)
    for row in rows:
        yield "| " + " | ".join(escape(cell) for cell in row) + " |"


def escape(text: str) -> str:
    """Return a text that may stand in a cell."""
    return text.replace("|", "\\|")


class Filled(NamedTuple):
    """A page whose prose is written by hand, between whose `<!-- table NAME -->` and `<!-- end -->` tables are made.

    Attributes:
        module: its `TABLES` are what makes the lines of each, by its name in the page, of the results.
        results: file that they are made of, relative to the root: JSON, or rows of campaigns; empty for none.
    """

    module: str
    results: str = ""

    def page(self, name: str, root: Path) -> str:
        """Return a page with fresh tables.

        Raises:
            MkError: the page names a table that is not known, or one has no results.
        """
        tables: Mapping[str, Callable[[Any], Iterable[str]]] = importlib.import_module(self.module).TABLES
        results = _read(root / self.results) if self.results else None

        def made(place: re.Match[str]) -> str:
            if place["name"] not in tables:
                msg = f"{name}: no table '{place['name']}'; known are {', '.join(tables)}"
                raise MkError(msg)
            try:
                lines = list(tables[place["name"]](results))
            except KeyError as missing:
                msg = f"{name}, table '{place['name']}': no {missing} in docs/results; measure it again"
                raise MkError(msg) from None
            return place["begin"] + "\n" + "\n".join(lines).strip() + "\n\n" + place["end"]

        return PLACE.sub(made, (root / name).read_text(encoding="utf-8"))


def _read(file: Path) -> Any:
    """Rows of campaigns by campaign, or one object."""
    return Results(file).rows if file.suffix == ".jsonl" else json.loads(file.read_text(encoding="utf-8"))
