"""CSV missions: one header line naming the columns, one line for each point.

The columns are the fields of `MissionPoint`; only latitude, longitude and altitude are required, in any order.
"""

from __future__ import annotations

import csv
import io
from typing import Any

from mkdaemon.cli.mission_files.source import MissionDraft, Place, assemble
from mkdaemon.protocol.mission import Mission, MissionPoint, PointKind

_COLUMNS = tuple(MissionPoint.model_fields)
_REQUIRED = ("latitude_deg", "longitude_deg", "altitude")
_DECIMAL = {"latitude_deg", "longitude_deg", "altitude", "climb", "speed"}
_WORDS = {"kind", "name"}


def read(text: str, name: str) -> MissionDraft:
    """Read a CSV mission; a semicolon may stand for the comma.

    Raises:
        ConfigError: a column is unknown or missing, or a cell is wrong; names file, line and fix.
    """
    first = text.lstrip("\ufeff").splitlines()[0] if text.strip() else ""
    rows = csv.reader(io.StringIO(text.lstrip("\ufeff")), delimiter=";" if first.count(";") > first.count(",") else ",")
    header = [cell.strip() for cell in next(rows, [])]
    place = Place(name, 1)
    for column in header:
        if column not in _COLUMNS:
            raise place.wrong(f"no column is called {column!r}", f"use {', '.join(_COLUMNS)}")
    for column in _REQUIRED:
        if column not in header:
            raise place.wrong(f"column {column!r} is missing", f"begin the file with {','.join(_REQUIRED)}")
    points = []
    for row in rows:
        if not any(cell.strip() for cell in row):
            continue
        place = Place(name, rows.line_num)
        if len(row) != len(header):
            raise place.wrong(f"{len(row)} cells under {len(header)} columns", "give one cell for each column")
        points.append(_read_row(place, dict(zip(header, row, strict=True))))
    return MissionDraft(assemble(name, points))


def write(mission: Mission) -> str:
    """Return the mission as CSV."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(_COLUMNS)
    for point in mission.points:
        cells = point.model_dump(mode="json")
        cells["latitude_deg"] = f"{point.latitude_deg:.7f}"
        cells["longitude_deg"] = f"{point.longitude_deg:.7f}"
        writer.writerow("" if cells[column] is None else cells[column] for column in _COLUMNS)
    return out.getvalue()


def _read_row(place: Place, cells: dict[str, str]) -> MissionPoint:
    fields: dict[str, Any] = {}
    for column, cell in cells.items():
        if not cell.strip() and column not in _REQUIRED:
            continue
        if column == "kind":
            fields[column] = _read_kind(place, cell)
        elif column in _WORDS:
            fields[column] = cell.strip()
        else:
            fields[column] = place.number(column, cell) if column in _DECIMAL else place.whole(column, cell)
    return place.point(**fields)


def _read_kind(place: Place, cell: str) -> PointKind:
    try:
        return PointKind(cell.strip().lower())
    except ValueError:
        raise place.wrong(f"kind is {cell.strip()!r}", f"use one of {', '.join(PointKind)}") from None
