"""Published values of a recording as maps, with the units that their models declare."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, Final

from mkdaemon.client.samples import telemetry_models, typed_value
from mkdaemon.described import meanings_of
from mkdaemon.errors import ConfigError, MkError, ProtocolError
from mkdaemon.record.entry import Entry, EntryKind, unpacked
from mkdaemon.record.reader import Recording, matches_any
from mkdaemon.telemetry.base import Stamped

Row = dict[str, Any]
"""The cells of a value, by the name of their column."""
_UNIT: Final = re.compile(r"\[([^\]]+)\]")
_MATRIX: Final = re.compile(r"\((\d+), \1\)")


@dataclass(frozen=True, slots=True)
class ExportedValue:
    """One published value.

    Attributes:
        vehicle: whose.
        suffix: key without `mk/<vehicle>/`.
        wall: publish time, of its stamp [s; Unix time].
        monotonic: of its stamp, or when it was taken [s].
        fields: as published.
        schema: name and version of its model, for example `Attitude.v1`.
    """

    vehicle: str
    suffix: str
    wall: float
    monotonic: float
    fields: dict[str, Any]
    schema: str

    @property
    def typed(self) -> Any:
        """The telemetry value, for example an `Attitude`; the map where its schema is not known here.

        Raises:
            ProtocolError: the map does not fit the schema it names.
        """
        return typed_value(self.schema, self.fields)

    @property
    def stamped(self) -> Stamped:
        """The telemetry value.

        Raises:
            MkError: it is not a value of its key: another program or another version wrote it.
        """
        try:
            found, why = self.typed, f"its schema {self.schema!r} is unknown here"
        except ProtocolError as error:
            found, why = None, str(error)
        if isinstance(found, Stamped):
            return found
        raise MkError(
            f"{self.suffix} of {self.vehicle} at {self.wall:.3f} s: {why}; "
            "--format csv takes every value, `mkctl log cut` leaves some out"
        )


def read_values(path: Path, patterns: tuple[str, ...] = (), *, images: bool = False) -> Iterator[ExportedValue]:
    """Every published value of a recording, in its order.

    Args:
        path: the recording.
        patterns: keys that are wanted; all of them for none.
        images: with the images that the recorder kept, as values of `vision/<camera>/image`.

    Raises:
        MkError: the file cannot be opened.
        ConfigError: it is no recording.
    """
    recording = Recording(path)
    if recording.read_session() is None:
        raise ConfigError(f"{path}: no recording of mkdaemon; `mkctl log list` shows recordings")
    kinds = {EntryKind.SAMPLE, EntryKind.IMAGE} if images else {EntryKind.SAMPLE}
    for entry in recording.entries(lambda facts: facts.kind in kinds and matches_any(facts.key, patterns)):
        value = _value(entry)
        if value is not None:
            yield value


def _value(entry: Entry) -> ExportedValue | None:
    if "msgpack" not in entry.encoding:
        return None
    fields = unpacked(entry.payload)
    if not fields:
        return None
    stamp = entry.carried_stamp
    monotonic = entry.received if stamp is None else stamp.monotonic
    schema = entry.encoding.rpartition(";mk.")[2]
    return ExportedValue(entry.vehicle, entry.suffix, entry.published, monotonic, fields, schema)


def unit_of(schema: str, path: str) -> str:
    """Unit of a field as its model says it, for example `m/s`; empty where it says none.

    A list whose model says several units has one for each place; a matrix `(n, n)` by rows over two kinds of quantity
    has three: of the first kind, of both, of the second.

    Args:
        schema: name and version.
        path: of the field, with the number of an element: `velocity_enu.0`.
    """
    field, *parts = path.split(".")
    described = _descriptions(schema).get(field, "")
    units = [unit.partition(";")[0] for unit in _UNIT.findall(described)]
    places = [int(part) for part in parts if part.isdigit()]
    if len(set(units)) < 2 or not places:
        return units[0] if units else ""
    place, side = places[-1], _MATRIX.search(described)
    if side is not None:
        half = int(side.group(1)) // 2
        place = sum(number >= half for number in divmod(place, 2 * half))
    return units[place] if place < len(units) else ""


@cache
def _descriptions(schema: str) -> Mapping[str, str]:
    model = telemetry_models().get(schema)
    return {} if model is None else meanings_of(model)


def flat(fields: dict[str, Any], prefix: str = "") -> dict[str, Any]:
    """A map without maps and lists inside: `velocity_enu.0`, `echo.p50_ms`; bytes as hexadecimal."""
    found: dict[str, Any] = {}
    for name, value in fields.items():
        path = f"{prefix}{name}"
        if isinstance(value, dict | list) and not value:
            found[path] = None  # so that a table has the column of what was always empty
        elif isinstance(value, dict):
            found |= flat(value, f"{path}.")
        elif isinstance(value, list):
            found |= flat(dict(enumerate(value)), f"{path}.")  # type: ignore[arg-type]
        else:
            found[path] = value.hex() if isinstance(value, bytes) else value
    return found
