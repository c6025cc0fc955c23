"""KML 2.2 missions: the points of the placemarks, or the vertices of the one line string; the rest is named.

`relativeToGround` counts as height above the start (level ground assumed), `absolute` as above sea level, and the
default `clampToGround` gives no altitude, as the standard says. Source: OGC 07-147r2, KML 2.2.
"""

from __future__ import annotations

from collections.abc import Iterator
from xml.sax.saxutils import escape

from mkdaemon.missions.gpx import read_extras
from mkdaemon.missions.source import AltitudeReference, FilePlace, MissionDraft, assemble, require_few, short_name
from mkdaemon.missions.xmltree import Element, parse_xml
from mkdaemon.telemetry.mission import Mission, MissionPoint

_REFERENCES = {
    "relativeToGround": AltitudeReference.START,
    "absolute": AltitudeReference.SEA_LEVEL,
    "clampToGround": AltitudeReference.ABSENT,
}
_NO_ROUTE = {
    "Polygon": "polygon",
    "LinearRing": "ring",
    "Track": "track",
    "Model": "model",
    "NetworkLink": "linked document",
    "GroundOverlay": "overlay",
    "PhotoOverlay": "photograph",
    "Tour": "tour",
}
"""Elements that are left out, and what they are."""


def read(text: str, name: str) -> MissionDraft:
    """Read a KML mission.

    Raises:
        ConfigError: the file is no KML, mixes altitude modes, points and paths, or a value is wrong; names file,
            line and fix.
    """
    root = parse_xml(text, name)
    if root.name != "kml":
        raise root.place.wrong(f"<{root.name}> is not a KML document", "the outermost element must be <kml>")
    title = next((child.text_of("name") for child in root.children), None) or ""
    marks = [(mark, shape) for mark in root.walk("Placemark") for shape in mark.walk("Point")]
    lines = list(root.walk("LineString"))
    require_few(name, len(marks))
    if marks and lines:
        what = f"both {len(marks)} placemarks with a point and a path"
        raise lines[0].place.wrong(f"the file holds {what}", "keep what is to be flown, and export it alone")
    if len(lines) > 1:
        raise lines[1].place.wrong(f"the file holds {len(lines)} paths", "join them to one, or keep one")
    if marks:
        points = [_read_mark(mark, shape) for mark, shape in marks]
        modes = {_mode(shape) for _, shape in marks}
    elif lines:
        points, modes = _read_line(lines[0]), {_mode(lines[0])}
    else:
        raise root.place.wrong("no point and no path in this file", "draw a path or placemarks and export again")
    if len(modes) > 1:
        raise root.place.wrong("the points differ in altitudeMode", "use relativeToGround for all of them")
    return MissionDraft(assemble(name, points, title), modes.pop(), tuple(_beside(root)))


def _beside(root: Element) -> Iterator[str]:
    """What a document holds beside points and paths."""
    for element, what in _NO_ROUTE.items():
        count = sum(1 for _ in root.walk(element))
        if count:
            yield f"beside the mission, {what}s: {count}"


def write(mission: Mission) -> str:
    """Return the mission as KML placemarks with altitudes relative to the ground."""
    lines = [
        '<?xml version="1.0" encoding="UTF-8"?>',
        '<kml xmlns="http://www.opengis.net/kml/2.2">',
        "  <Document>",
        f"    <name>{escape(mission.name)}</name>",
    ]
    for point in mission.points:
        extras = point.model_dump(
            mode="json", exclude={"latitude_deg", "longitude_deg", "altitude", "name"}, exclude_none=True
        )
        lines += [
            "    <Placemark>",
            f"      <name>{escape(point.name)}</name>",
            "      <ExtendedData>",
            *(f'        <Data name="{key}"><value>{value}</value></Data>' for key, value in extras.items()),
            "      </ExtendedData>",
            "      <Point>",
            "        <altitudeMode>relativeToGround</altitudeMode>",
            f"        <coordinates>{point.longitude_deg:.7f},{point.latitude_deg:.7f},{point.altitude:g}</coordinates>",
            "      </Point>",
            "    </Placemark>",
        ]
    return "\n".join([*lines, "  </Document>", "</kml>", ""])


def _mode(shape: Element) -> AltitudeReference:
    word = shape.text_of("altitudeMode") or "clampToGround"
    if word not in _REFERENCES:
        raise shape.place.wrong(f"altitudeMode is {word!r}", f"use one of {', '.join(_REFERENCES)}")
    return _REFERENCES[word]


def _read_mark(mark: Element, shape: Element) -> MissionPoint:
    data = mark.find("ExtendedData")
    extra: dict[str, str] = {}
    for item in data.children if data else []:
        if item.name == "Data" and "name" in item.attributes:
            extra[item.attributes["name"]] = item.text_of("value") or ""
    corners = shape.find("coordinates")
    if corners is None or len(corners.text.split()) != 1:
        raise shape.place.wrong("a point needs one coordinate", "write longitude,latitude,altitude")
    if "kind" not in extra:  # we always write it: other programs mean other things by "speed"
        return _read_corner(corners.place, corners.text.strip(), name=short_name(mark.text_of("name")))
    name = mark.text_of("name") or ""
    return _read_corner(corners.place, corners.text.strip(), name=name, **read_extras(shape.place, extra))


def _read_line(line: Element) -> list[MissionPoint]:
    corners = line.find("coordinates")
    if corners is None:
        raise line.place.wrong("a path without coordinates", "export it again")
    first = corners.place
    require_few(first.name, len(corners.text.split()))
    return [
        _read_corner(FilePlace(first.name, first.line + row), word)
        for row, text in enumerate(corners.text.split("\n"))
        for word in text.split()
    ]


def _read_corner(place: FilePlace, word: str, **fields: object) -> MissionPoint:
    parts = word.split(",")
    if len(parts) not in (2, 3):
        raise place.wrong(f"coordinate {word!r} has {len(parts)} parts", "write longitude,latitude,altitude")
    longitude, latitude, altitude = (*parts, "0")[:3]
    return place.point(
        longitude_deg=place.number("longitude", longitude),
        latitude_deg=place.number("latitude", latitude),
        altitude=place.number("altitude", altitude),
        **fields,
    )
