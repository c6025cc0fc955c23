"""The tables of docs/configuration.md, made from the models that read the files."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Final

from mkdaemon.cli.mkdaemon.documentedfiles import documented_files
from mkdaemon.config.keys import ConfigKey
from tools.markdown import table

_COLUMNS: Final = ("key", "type", "unit", "default", "range", "meaning", "if it is wrong")


def _sections(_: None) -> Iterator[str]:
    """Every section of every file."""
    for file in documented_files():
        yield f"## {file.title}\n"
        yield from (f"{file.about}\n",) if file.about else ()
        for section, keys in file.sections().items():
            if section:
                yield f"### `{file.heading(section)}`\n\n{file.about_section(section)}\n"
            yield from _table(keys)
            yield ""


def _table(keys: Sequence[ConfigKey]) -> Iterator[str]:
    """The keys of a section, with the effect of a wrong value if it is declared."""
    columns = _COLUMNS if any(key.consequence for key in keys) else _COLUMNS[:-1]
    rows = [
        (
            f"`{key.name}`{' (reload)' if key.is_reloadable else ''}",
            *(key.kind, key.unit, key.default, key.limits, key.meaning, key.consequence),
        )
        for key in keys
    ]
    yield from table(columns, [row[: len(columns)] for row in rows])


TABLES: Final = {"sections": _sections}
"""By the name that the page gives it."""
