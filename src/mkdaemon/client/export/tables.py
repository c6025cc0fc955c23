"""Tables: one file a key, as CSV or Parquet, units in the names of the columns.

A recording is read twice: once for its columns and their kinds, once for its rows, which are written as they come. So
the longest recording takes no more memory than `WAITING` and what its keys are.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Iterable
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from mkdaemon.client.export.values import ExportedValue, Row, flat, unit_of
from mkdaemon.errors import ConfigError, MkError
from mkdaemon.files import refuse_existing, saving

TIMES: Final = ("time [s]", "monotonic [s]")
"""First columns: publish time (Unix time), and the time that never jumps."""
MOST_COLUMNS: Final = 5000
"""Of a table; ours have up to a few hundred."""
WAITING: Final = 200_000
"""Cells that wait for their row group of a Parquet file, of all tables together; 20 MB."""
Read = Callable[[], Iterable[ExportedValue]]
"""Gives all values of a recording, in order, every time it is called."""
Place = tuple[str, str]
"""Vehicle and key of a table."""


@dataclass
class Table:
    """What is known of the values of one key before they are written.

    Attributes:
        name: of its file.
        columns: names with units, in the order in which they came first, and the kinds of their values.
    """

    name: str
    columns: dict[str, set[type]] = field(default_factory=lambda: {name: {float} for name in TIMES})

    def take(self, row: Row) -> None:
        """Learn from a row.

        Raises:
            MkError: there are too many columns.
        """
        if len(row) + len(self.columns) > MOST_COLUMNS and len({*row, *self.columns}) > MOST_COLUMNS:
            raise MkError(f"{self.name}: more than {MOST_COLUMNS} columns; export other keys, with --key")
        for name, part in row.items():
            kinds = self.columns.setdefault(name, set())
            if part is not None:
                kinds.add(type(part))


def row_of(value: ExportedValue) -> Row:
    """The cells of a value, by the name of their column."""
    row: Row = dict(zip(TIMES, (float(value.wall), float(value.monotonic)), strict=True))
    for name, part in flat({name: part for name, part in value.fields.items() if name != "stamp"}).items():
        unit = unit_of(value.schema, name)
        row[f"{name} [{unit}]" if unit else name] = part
    return row


def tables_of(values: Iterable[ExportedValue]) -> dict[Place, Table]:
    """The table of each vehicle and key."""
    tables: dict[Place, Table] = {}
    for value in values:
        place = (value.vehicle, value.suffix)
        if place not in tables:
            tables[place] = Table(f"{value.vehicle}.{value.suffix.replace('/', '_')}")
        tables[place].take(row_of(value))
    return tables


def write_csv(read: Read, folder: Path, *, overwrite: bool) -> list[Path]:
    """Write each table as CSV (RFC 4180); an empty cell is a value that is not there.

    Raises:
        ConfigError: a file is there already, and `overwrite` is off.
        MkError: it cannot be written, or there is nothing to write.
    """
    tables = tables_of(read())
    paths = _paths(tables, folder, "csv", overwrite=overwrite)
    with ExitStack() as files:
        writers = {}
        for place, table in tables.items():
            file = files.enter_context(saving(paths[place], overwrite=overwrite))
            text = io.TextIOWrapper(file, encoding="utf-8", newline="", write_through=True)
            files.callback(text.detach)
            writers[place] = csv.DictWriter(text, list(table.columns), restval="")
            writers[place].writeheader()
        for value in read():
            writers[value.vehicle, value.suffix].writerow(row_of(value))
    return list(paths.values())


def write_parquet(read: Read, folder: Path, *, overwrite: bool) -> list[Path]:
    """Write each table as Parquet.

    Raises:
        ConfigError: pyarrow is not installed, or a file is there already and `overwrite` is off.
        MkError: it cannot be written, there is nothing to write, or a value is none of Parquet.
    """
    try:
        from mkdaemon.client.export.parquet import RowGroups
    except ImportError:
        raise ConfigError('Parquet needs pyarrow: pip install "mkdaemon[export]"') from None
    tables = tables_of(read())
    paths = _paths(tables, folder, "parquet", overwrite=overwrite)
    with ExitStack() as files:
        groups = {}
        for place, table in tables.items():
            file = files.enter_context(saving(paths[place], overwrite=overwrite))
            groups[place] = files.enter_context(RowGroups(file, paths[place], table.columns))
        waiting = 0
        for value in read():
            waiting += groups[value.vehicle, value.suffix].add(row_of(value))
            if waiting > WAITING:
                waiting -= max(groups.values(), key=lambda one: one.waiting).write()
    return list(paths.values())


def _paths(tables: dict[Place, Table], folder: Path, suffix: str, *, overwrite: bool) -> dict[Place, Path]:
    """Make the folder, and make sure that no file of these is there, before the first is written."""
    if not tables:
        msg = (
            "nothing to export: the recording has no published value of these keys; `mkctl log info` shows what it has"
        )
        raise MkError(msg)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise MkError(f"{folder}: cannot be created ({error.strerror}); choose another place") from error
    paths = {place: folder / f"{table.name}.{suffix}" for place, table in tables.items()}
    for path in paths.values():
        refuse_existing(path, overwrite=overwrite)
    return paths
