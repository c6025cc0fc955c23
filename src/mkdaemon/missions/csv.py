"""CSV missions: one header line naming the columns, one line for each point.

The columns are the fields of `MissionPoint`; only latitude, longitude and altitude are required, in any order. Other
programs' words for these three are understood (`_ALIASES`), and tables as spreadsheets save them: semicolons or
tabulators, and then decimal commas.
"""

from __future__ import annotations

import csv
import io
from typing import TYPE_CHECKING, Any

from mkdaemon.missions.source import AltitudeReference, FilePlace, MissionDraft, assemble, require_few
from mkdaemon.telemetry.mission import Mission, MissionPoint, PointKind

if TYPE_CHECKING:
    import _csv

_COLUMNS = tuple(MissionPoint.model_fields)
_REQUIRED = ("latitude_deg", "longitude_deg", "altitude")
_DECIMAL = {"latitude_deg", "longitude_deg", "altitude", "climb", "speed"}
_WORDS = {"kind", "name"}
_ALIASES = {
    **dict.fromkeys(("lat", "latitude"), "latitude_deg"),
    **dict.fromkeys(("lon", "lng", "long", "longitude"), "longitude_deg"),
    **dict.fromkeys(("height", "relative_altitude"), "altitude"),
}
_SEA_LEVEL = {"ele", "elevation", "amsl"}
_AMBIGUOUS = {"alt", "z"}


def read(text: str, name: str) -> MissionDraft:
    """Read a CSV mission.

    Raises:
        ConfigError: a column is unknown or missing, a cell is wrong, or there are too many lines; names file, line and
            fix.
    """
    text = text.lstrip("\ufeff")
    first = text.splitlines()[0] if text.strip() else ""
    delimiter = max(",;\t", key=first.count)
    rows = csv.reader(io.StringIO(text), delimiter=delimiter)
    try:
        return _read_rows(name, rows, delimiter)
    except csv.Error as error:
        raise FilePlace(name, rows.line_num).wrong(f"no table ({error})", "save it again as CSV") from error


def _read_rows(name: str, rows: _csv.Reader, delimiter: str) -> MissionDraft:
    header, reference = _read_header(FilePlace(name, 1), next(rows, []))
    points: list[MissionPoint] = []
    for row in rows:
        if not any(cell.strip() for cell in row):
            continue
        require_few(name, len(points) + 1)
        place = FilePlace(name, rows.line_num)
        if len(row) != len(header):
            raise place.wrong(f"{len(row)} cells under {len(header)} columns", "give one cell for each column")
        cells = row if delimiter == "," else [cell.replace(",", ".") for cell in row]
        points.append(_read_row(place, dict(zip(header, cells, strict=True))))
    return MissionDraft(assemble(name, points), reference)


def _read_header(place: FilePlace, cells: list[str]) -> tuple[list[str], AltitudeReference]:
    """Our columns for those of the file, and what its altitudes are measured from."""
    begin = f"begin the file with {','.join(_REQUIRED)}"
    words = [cell.strip().lower() for cell in cells]
    if words and not any(letter.isalpha() for word in words for letter in word):
        raise place.wrong("the first line names no columns", begin)
    header: list[str] = []
    reference = AltitudeReference.START
    for word in words:
        if word in _AMBIGUOUS:
            fix = "call it altitude (above the start) or elevation (above sea level)"
            raise place.wrong(f"column {word!r} does not say what it counts from", fix)
        if word in _SEA_LEVEL:
            reference = AltitudeReference.SEA_LEVEL
        column = "altitude" if word in _SEA_LEVEL else _ALIASES.get(word, word)
        if column not in _COLUMNS:
            raise place.wrong(f"no column is called {word!r}", f"use {', '.join(_COLUMNS)}")
        if column in header:
            raise place.wrong(f"column {column!r} stands twice", "delete one")
        header.append(column)
    for column in _REQUIRED:
        if column not in header:
            raise place.wrong(f"column {column!r} is missing", begin)
    return header, reference


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


def _read_row(place: FilePlace, cells: dict[str, str]) -> MissionPoint:
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


def _read_kind(place: FilePlace, cell: str) -> PointKind:
    try:
        return PointKind(cell.strip().lower())
    except ValueError:
        raise place.wrong(f"kind is {cell.strip()!r}", f"use one of {', '.join(PointKind)}") from None
