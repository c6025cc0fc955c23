"""Rows of flights that were flown, in a file that grows with every flight, so that a run that ends early goes on."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from mkdaemon.errors import ConfigError
from mkdaemon.files import write_whole

Row = dict[str, Any]
KINDS: Final = ("scenes", "triggers", "flights")
"""Cases whose flights are kept."""


class Results:
    """What was flown so far.

    Attributes:
        rows: of every kind, in the order in which they were flown.
    """

    def __init__(self, path: Path | None) -> None:
        """Go on with a file, or without one.

        Raises:
            ConfigError: it is none of results.
        """
        self._path = path
        self.rows: dict[str, list[Row]] = {kind: [] for kind in KINDS}
        if path is not None and path.exists():
            try:
                self.rows |= {kind: list(_stored(path).get(kind, [])) for kind in self.rows}
            except (ValueError, KeyError, TypeError) as error:
                raise ConfigError(f"{path}: no results of lab hil ({error}); move it away or name another") from None

    def has(self, kind: str, key: Mapping[str, Any]) -> bool:
        """Whether there is a row with these values."""
        return any(all(row.get(name) == value for name, value in key.items()) for row in self.rows[kind])

    def add(self, kind: str, row: Row) -> None:
        """Add a row, and write the file."""
        self.rows[kind].append(_plain(row))
        if self._path is None:
            return
        lists = (
            f"{json.dumps(name)}: [\n" + ",\n".join(json.dumps(each, allow_nan=False) for each in rows) + "\n]"
            for name, rows in self.rows.items()
        )
        write_whole(self._path, "{" + ",\n".join(lists) + "}\n", overwrite=True)


def _stored(path: Path) -> dict[str, Any]:
    """The rows of a file, by kind; one that holds none of the kinds is no file of results."""
    stored = dict(json.loads(path.read_text(encoding="utf-8")))
    if not stored.keys() & set(KINDS):
        raise KeyError(", ".join(KINDS))
    return stored


def _plain(value: Any) -> Any:
    """The same, rounded to four digits, and nothing where a number is none."""
    if isinstance(value, dict):
        return {name: _plain(each) for name, each in value.items()}
    if isinstance(value, list):
        return [_plain(each) for each in value]
    if isinstance(value, float):
        return round(value, 4) if math.isfinite(value) else None
    return value
