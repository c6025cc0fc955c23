"""One Parquet file that is written in row groups. Importing this needs `pyarrow`."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from types import TracebackType
from typing import Any, BinaryIO, Final, Self

import pyarrow
from pyarrow import parquet

from mkdaemon.client.export.values import Row
from mkdaemon.errors import MkError

LONG: Final = 100
"""Number of characters of a text that count as one cell."""
_TYPES: Final = {bool: pyarrow.bool_(), int: pyarrow.int64(), float: pyarrow.float64(), str: pyarrow.string()}


class RowGroups:
    """Rows that wait, and a file of those that were written.

    Attributes:
        waiting: cells that wait.
    """

    def __init__(self, file: BinaryIO, path: Path, columns: Mapping[str, set[type]]) -> None:
        """Begin a file.

        Args:
            file: written to.
            path: named in errors.
            columns: their names, and the kinds of their values: numbers become floats where they are mixed, other
                mixtures text.
        """
        self.waiting = 0
        self._path = path
        self._kinds = {name: _kind_of(kinds) for name, kinds in columns.items()}
        fields = [(name, pyarrow.null() if kind is None else _TYPES[kind]) for name, kind in self._kinds.items()]
        self._schema = pyarrow.schema(fields)
        self._rows: list[Row] = []
        self._writer = parquet.ParquetWriter(file, self._schema)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        try:
            if kind is None:
                self.write()
        finally:
            self._writer.close()

    def add(self, row: Row) -> int:
        """Let a row wait; returns how many cells it counts as."""
        self._rows.append(row)
        size = len(row) + sum(len(part) // LONG for part in row.values() if isinstance(part, str))
        self.waiting += size
        return size

    def write(self) -> int:
        """Write what waits; returns how many cells it was.

        Raises:
            MkError: a value is none of Parquet.
        """
        written, self.waiting = self.waiting, 0
        if not self._rows:
            return written
        try:
            columns = {name: [_as(row.get(name), kind) for row in self._rows] for name, kind in self._kinds.items()}
            self._writer.write_table(pyarrow.table(columns, schema=self._schema))
        except (pyarrow.ArrowException, OverflowError) as error:
            msg = f"{self._path}: a column does not fit Parquet ({error}); --format csv takes everything"
            raise MkError(msg) from error
        self._rows.clear()
        return written


def _kind_of(kinds: set[type]) -> type | None:
    if not kinds:
        return None
    if kinds == {int, float}:
        return float
    (kind,) = kinds if len(kinds) == 1 else (str,)
    return kind if kind in _TYPES else str


def _as(value: Any, kind: type | None) -> Any:
    return value if value is None or kind is None or isinstance(value, kind) else kind(value)
