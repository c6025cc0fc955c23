"""The MikroKopter-Tool's waypoint list (`.wpl`): an INI file.

The format has no specification; these facts were taken from programs that exchange such files with the tool.

* Version 3 (`Route+WPL` of the iPhone application iKopter, 2012, and several converters): `[General]` with
  `FileVersion`, `NumberOfWaypoints` and sometimes `Name`, then `[Point1]`... with the keys of `_ENTRIES`, and
  `Latitude`, `Longitude` [deg], `Heading` [deg, negative: number of a point of interest], `Type` (1 waypoint, 2 point
  of interest) and `Prefix`. Early iKopter files have a `Name` and count `Type` from 0.
* Version 2 (settings header of the portable terminal PKT, 2013, and a converter): sections `[Waypoint1]`... without
  speed, camera and type, and one `[POI]` with `UsePOI`; there, `Heading=-1` means that POI, which therefore stands
  first in the list that is sent.

The text format "QGC WPL" of Mission Planner shares the file name: it is read by `missions.wpl110`.
"""

from __future__ import annotations

import re
from typing import Any, Final, NamedTuple

from mkdaemon.missions import wpl110
from mkdaemon.missions.source import FilePlace, MissionDraft, assemble, require_few
from mkdaemon.telemetry.mission import Mission, MissionPoint, PointKind


class _Entry(NamedTuple):
    """One key of a point: its word in the file, our field, how many counts make one of ours, and since when."""

    mk: str
    field: str
    counts: int = 1
    since: int = 2
    is_optional: bool = False


_ENTRIES: Final = (
    _Entry(mk="Radius", field="radius"),
    _Entry(mk="Altitude", field="altitude"),
    _Entry(mk="ClimbRate", field="climb", counts=10),
    _Entry(mk="DelayTime", field="hold"),
    _Entry(mk="WP_Event_Channel_Value", field="event"),
    _Entry(mk="Speed", field="speed", counts=10, since=3),
    _Entry(mk="CAM-Nick", field="camera_angle_deg", since=3),
    _Entry(mk="AutoTrigger", field="photo_distance", since=3, is_optional=True),
)
_KINDS = (PointKind.WAYPOINT, PointKind.POI, PointKind.FAILSAFE, PointKind.LAND)
_SECTION = re.compile(r"\[(?P<name>[^\]]+)\]$")

Section = dict[str, tuple[str, FilePlace]]
"""Entries of one section by lower-case key, each with its place; the key "" holds the section's own place."""


def read(text: str, name: str) -> MissionDraft:
    """Read a `.wpl` file of version 2 or 3.

    Raises:
        ConfigError: it is another format, its counts disagree, or a value is wrong; names file, line and fix.
    """
    if text.lstrip("\ufeff").startswith(wpl110.HEAD):
        return wpl110.read(text, name)
    sections = _split(text, name)
    general = sections.get("general")
    if general is None:
        raise FilePlace(name, 1).wrong("no [General] section", "export the list again from the MikroKopter-Tool")
    version = _whole(general, "FileVersion")
    if version not in (2, 3):
        raise general["fileversion"][1].wrong(f"FileVersion {version} is unknown", "versions 2 and 3 can be read")
    count = _whole(general, "NumberOfWaypoints")
    require_few(name, count)
    word = "point" if version == 3 else "waypoint"
    found = [_section(sections, f"{word}{number}", general) for number in range(1, count + 1)]
    if f"{word}{count + 1}" in sections:
        place = sections[f"{word}{count + 1}"][""][1]
        raise place.wrong(f"more points than NumberOfWaypoints={count}", "correct the number in [General]")
    from_zero = "name" in general and any(section.get("type", ("", None))[0] == "0" for section in found)
    has_poi = version == 2 and general.get("usepoi", ("0", None))[0] not in ("0", "")
    points = [_read_point(section, version, from_zero, has_poi) for section in found]
    if has_poi:
        points.insert(0, _read_poi(_section(sections, "poi", general)))
    title = general["name"][0] if "name" in general else ""
    return MissionDraft(assemble(name, points, title))


def write(mission: Mission) -> str:
    """Return the mission as a `.wpl` file of version 3; altitudes are rounded to metres, as the format has it."""
    lines = ["[General]", "FileVersion=3", f"NumberOfWaypoints={len(mission.points)}"]
    for number, point in enumerate(mission.points, 1):
        lines += [
            f"[Point{number}]",
            f"Latitude={point.latitude_deg:.7f}",
            f"Longitude={point.longitude_deg:.7f}",
            *(f"{entry.mk}={round(getattr(point, entry.field) * entry.counts)}" for entry in _ENTRIES),
            f"Heading={-point.poi if point.poi else point.heading_deg or 0}",
            f"Type={_KINDS.index(point.kind) + 1}",
            f"Prefix={point.name or 'P'}",
        ]
    return "\n".join([*lines, ""])


def _split(text: str, name: str) -> dict[str, Section]:
    """Sections by lower-case name; duplicate sections and keys, and lines that are neither, are refused."""
    sections: dict[str, Section] = {}
    current: Section | None = None
    for line, raw in enumerate(text.lstrip("\ufeff").splitlines(), 1):
        content, place = raw.strip(), FilePlace(name, line)
        if not content or content[0] in ";#":
            continue
        header = _SECTION.match(content)
        if header:
            title = header["name"].strip().lower()
            if title in sections:
                raise place.wrong(f"section [{header['name']}] occurs twice", "delete one")
            current = sections[title] = {"": (header["name"], place)}
            continue
        key, equals, value = content.partition("=")
        if not equals or current is None:
            raise place.wrong(f"{content[:30]!r} is neither [Section] nor key=value", "correct or delete the line")
        if key.strip().lower() in current:
            raise place.wrong(f"{key.strip()} occurs twice in one section", "delete one")
        current[key.strip().lower()] = (value.strip(), place)
    return sections


def _section(sections: dict[str, Section], title: str, general: Section) -> Section:
    if title not in sections:
        raise general[""][1].wrong(f"section [{title.title()}] is missing", "correct the counts in [General]")
    return sections[title]


def _whole(section: Section, key: str) -> int:
    text, place = section.get(key.lower(), (None, section[""][1]))
    return place.whole(key, text)


def _number(section: Section, key: str) -> float:
    text, place = section.get(key.lower(), (None, section[""][1]))
    return place.number(key, text)


def _position(section: Section) -> dict[str, Any]:
    return {
        "latitude_deg": _number(section, "Latitude"),
        "longitude_deg": _number(section, "Longitude"),
    }


def _read_poi(section: Section) -> MissionPoint:
    return section[""][1].point(**_position(section), altitude=_number(section, "Altitude"), kind=PointKind.POI)


def _read_point(section: Section, version: int, from_zero: bool, has_poi: bool) -> MissionPoint:
    place = section[""][1]
    heading = _whole(section, "Heading")
    fields = _position(section) | {
        "heading_deg": heading if heading > 0 else None,
        # Without a POI in the list, version 2 writes -1 for "no heading".
        "poi": -heading if heading < 0 and (version == 3 or has_poi) else None,
    }
    for entry in _ENTRIES:
        if entry.since <= version and not (entry.is_optional and entry.mk.lower() not in section):
            fields[entry.field] = _value(section, entry)
    if version == 3:
        kind = _whole(section, "Type") - (0 if from_zero else 1)
        if not 0 <= kind < len(_KINDS):
            raise section["type"][1].wrong(f"Type={section['type'][0]} is unknown", "1 waypoint, 2 point of interest")
        fields |= {"kind": _KINDS[kind], "name": section["prefix"][0] if "prefix" in section else ""}
    return place.point(**fields)


def _value(section: Section, entry: _Entry) -> float | int:
    if entry.field == "altitude":
        return _number(section, entry.mk)
    value = _whole(section, entry.mk)
    return value / entry.counts if entry.counts > 1 else value
