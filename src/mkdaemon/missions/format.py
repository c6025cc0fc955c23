"""The one table of mission file formats, by file name suffix."""

from __future__ import annotations

import logging
from collections.abc import Callable
from pathlib import Path
from typing import Final, NamedTuple

from mkdaemon.errors import ConfigError
from mkdaemon.files import refuse_existing, save
from mkdaemon.foreignfiles import read_text
from mkdaemon.missions import csv, gpx, kml, qgc, wpl, wpl110
from mkdaemon.missions.kmz import read_kmz
from mkdaemon.missions.losses import lost
from mkdaemon.missions.source import MissionDraft
from mkdaemon.telemetry.mission import Mission

log = logging.getLogger(__name__)
MAX_BYTES: Final = 4_000_000
"""Largest file read [bytes]; 31 points need some ten thousand."""


class Format(NamedTuple):
    """One file format: how it is read and written.

    Attributes:
        read: from text and file name.
        write: to text.
        about: what it is, for help texts.
        is_packed: it is a ZIP file around the text; it is only read.
    """

    read: Callable[[str, str], MissionDraft]
    write: Callable[[Mission], str]
    about: str
    is_packed: bool = False


FORMATS: Final = {
    ".gpx": Format(gpx.read, gpx.write, "GPX 1.1 route"),
    ".kml": Format(kml.read, kml.write, "KML 2.2 placemarks or path"),
    ".kmz": Format(kml.read, kml.write, "packed KML, read only", is_packed=True),
    ".plan": Format(qgc.read, qgc.write, "QGroundControl plan"),
    ".csv": Format(csv.read, csv.write, "table, one point a line"),
    ".wpl": Format(wpl.read, wpl.write, "MikroKopter-Tool waypoint list"),
    ".waypoints": Format(wpl110.read, wpl110.write, "Mission Planner list (QGC WPL 110)"),
}
"""By suffix, lower case."""
_WRITTEN: Final = tuple(suffix for suffix, form in FORMATS.items() if not form.is_packed)


def read_mission(
    path: Path,
    *,
    start_elevation: float | None = None,
    altitude: float | None = None,
    notify: Callable[[str], None] = log.warning,
) -> Mission:
    """Read a mission from a file of any known format; altitudes become heights above the start.

    Args:
        path: the file; its suffix tells the format.
        start_elevation: elevation of the starting place above mean sea level [m], for files with such altitudes.
        altitude: put every point at this height above the start [m].
        notify: is given one line for everything in the file that the mission leaves out.

    Raises:
        ConfigError: the file cannot be read or used; one line naming file, line and fix.
    """
    chosen = _format(path)
    try:
        text, others = read_kmz(path, MAX_BYTES) if chosen.is_packed else (read_text(path, limit=MAX_BYTES), [])
    except OSError as error:
        msg = f"{path}: cannot be read ({error.strerror}); check the name and its permissions"
        raise ConfigError(msg) from error
    except UnicodeDecodeError as error:
        msg = f"{path}: not UTF-8 text (byte {error.start}); save it as UTF-8"
        raise ConfigError(msg) from error
    draft = chosen.read(text, str(path))
    for note in (*draft.notes, *(f"the document {name}" for name in others)):
        notify(note if note.startswith(str(path)) else f"{path}: left out: {note}")
    return draft.settled(str(path), start_elevation=start_elevation, altitude=altitude)


def check_place(path: Path, *, overwrite: bool) -> None:
    """Check that a mission may be written to a file, before the work that fills it.

    Raises:
        ConfigError: it is there already, and `overwrite` is off; or its suffix is no format that is written.
    """
    if _format(path).is_packed:
        msg = f"{path}: {path.suffix.lower()} is only read; choose another suffix: {', '.join(_WRITTEN)}"
        raise ConfigError(msg)
    refuse_existing(path, overwrite=overwrite)


def write_mission(mission: Mission, path: Path, *, overwrite: bool = False) -> tuple[str, ...]:
    """Write a mission to a file, whole or not at all; the suffix tells the format.

    Args:
        mission: what to write.
        path: the file.
        overwrite: replace a file that is there.

    Returns:
        What the format does not keep, for example `climb of points 2 and 3`.

    Raises:
        ConfigError: the format is unknown or would fly another mission, the file is there already, or there is no such
            folder.
        MkError: the file cannot be written; what was there is untouched.
    """
    check_place(path, overwrite=overwrite)
    chosen = _format(path)
    try:
        text = chosen.write(mission)
        gone = lost(mission, chosen.read(text, path.suffix).mission)
    except ConfigError as error:
        msg = f"{path}: this format cannot keep the mission: {error}"
        raise ConfigError(msg) from error
    save(path, text, overwrite=overwrite)
    return gone


def _format(path: Path) -> Format:
    chosen = FORMATS.get(path.suffix.lower())
    if chosen is None:
        msg = f"{path}: no mission format has the suffix {path.suffix!r}; use one of {', '.join(FORMATS)}"
        raise ConfigError(msg)
    return chosen
