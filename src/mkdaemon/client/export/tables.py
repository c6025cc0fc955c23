"""Tables: one file a key, as CSV or Parquet, units in the names of the columns."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from mkdaemon.client.export.values import Value, flat, unit_of
from mkdaemon.errors import ConfigError, MkError
from mkdaemon.files import refuse_existing, save, saving

TIMES: Final = ("time [s]", "monotonic [s]")
"""First columns: publish time (Unix time), and the time that never jumps."""


@dataclass
class Table:
    """The values of one key.

    Attributes:
        name: of its file.
        columns: names with units, in the order in which they came first.
        rows: by name of the column.
    """

    name: str
    columns: dict[str, None] = field(default_factory=lambda: dict.fromkeys(TIMES))
    rows: list[dict[str, Any]] = field(default_factory=list)

    def add(self, value: Value) -> None:
        """Take a value."""
        fields = {name: part for name, part in value.fields.items() if name != "stamp"}
        row: dict[str, Any] = dict(zip(TIMES, (value.wall, value.monotonic), strict=True))
        for name, part in flat(fields).items():
            unit = unit_of(value.schema, name.partition(".")[0])
            row[f"{name} [{unit}]" if unit else name] = part
        self.columns |= dict.fromkeys(row)
        self.rows.append(row)


def tables_of(values: Iterable[Value]) -> list[Table]:
    """Sort values into tables, by vehicle and key."""
    tables: dict[tuple[str, str], Table] = {}
    for value in values:
        place = (value.vehicle, value.suffix)
        if place not in tables:
            tables[place] = Table(f"{value.vehicle}.{value.suffix.replace('/', '_')}")
        tables[place].add(value)
    return list(tables.values())


def write_csv(tables: Iterable[Table], folder: Path, *, overwrite: bool) -> list[Path]:
    """Write each table as CSV (RFC 4180); an empty cell is a value that is not there.

    Raises:
        ConfigError: a file is there already, and `overwrite` is off.
        MkError: it cannot be written.
    """
    return [
        _write_csv(table, folder / f"{table.name}.csv", overwrite) for table in _free(tables, folder, "csv", overwrite)
    ]


def write_parquet(tables: Iterable[Table], folder: Path, *, overwrite: bool) -> list[Path]:
    """Write each table as Parquet.

    Raises:
        ConfigError: pyarrow is not installed, or a file is there already and `overwrite` is off.
        MkError: it cannot be written, or a column has values of several kinds.
    """
    try:
        import pyarrow
        from pyarrow import parquet
    except ImportError:
        msg = 'Parquet needs pyarrow: pip install "mkdaemon[export]"'
        raise ConfigError(msg) from None
    written = []
    for table in _free(tables, folder, "parquet", overwrite):
        path = folder / f"{table.name}.parquet"
        try:
            columns = {name: [_alike(row.get(name), table, name) for row in table.rows] for name in table.columns}
            content = io.BytesIO()
            parquet.write_table(pyarrow.table(columns), content)
        except pyarrow.ArrowException as error:
            msg = f"{path}: a column of it is no column of Parquet ({error}); --format csv takes everything"
            raise MkError(msg) from error
        save(path, content.getvalue(), overwrite=overwrite)
        written.append(path)
    return written


def _alike(value: Any, table: Table, name: str) -> Any:
    """A value of the one kind that its column has: numbers as floats where they are mixed, else text."""
    kinds = {type(row[name]) for row in table.rows if row.get(name) is not None}
    if value is None or len(kinds) <= 1:
        return value
    return float(value) if kinds == {int, float} else str(value)


def _write_csv(table: Table, path: Path, overwrite: bool) -> Path:
    with saving(path, overwrite=overwrite) as file:
        text = io.TextIOWrapper(file, encoding="utf-8", newline="", write_through=True)
        writer = csv.DictWriter(text, list(table.columns), restval="")
        writer.writeheader()
        writer.writerows(table.rows)
        text.detach()
    return path


def _free(tables: Iterable[Table], folder: Path, suffix: str, overwrite: bool) -> list[Table]:
    """Make the folder, and make sure that no file of these is there, before the first is written."""
    found = list(tables)
    folder.mkdir(parents=True, exist_ok=True)
    for table in found:
        refuse_existing(folder / f"{table.name}.{suffix}", overwrite=overwrite)
    return found
