"""GPX 1.1 missions: the points of the one route, or else the waypoints of the file; what is left out is named.

GPX knows position, elevation above sea level and a name; everything else a point carries stands in `<extensions>` under
our own namespace, where other programs ignore it. Source: GPX 1.1 schema documentation (topografix.com/GPX/1/1).
"""

from __future__ import annotations

from typing import Any
from xml.sax.saxutils import escape, quoteattr

from mkdaemon.missions.source import AltitudeReference, FilePlace, MissionDraft, assemble, require_few, short_name
from mkdaemon.missions.xmltree import Element, parse_xml
from mkdaemon.telemetry.mission import Mission, MissionPoint, PointKind

NAMESPACE = "urn:mkdaemon:mission:1"
_WHOLE = ("radius", "hold", "heading_deg", "poi", "camera_angle_deg", "event", "photo_distance")
_DECIMAL = ("climb", "speed")


def read(text: str, name: str) -> MissionDraft:
    """Read a GPX mission.

    Raises:
        ConfigError: the file is no GPX, holds only tracks or several routes, or a value is wrong; names file,
            line and fix.
    """
    root = parse_xml(text, name)
    if root.name != "gpx":
        raise root.place.wrong(f"<{root.name}> is not a GPX document", "the outermost element must be <gpx>")
    routes = [route for route in root.walk("rte") if route.find("rtept") is not None]
    if len(routes) > 1:
        raise routes[1].place.wrong(f"the file holds {len(routes)} routes", "keep the one that is to be flown")
    route = routes[0] if routes else None
    loose = list(root.walk("wpt"))
    found = list(route.walk("rtept")) if route else loose
    if not found:
        what = "only a recorded track" if root.find("trk") else "neither a route nor waypoints"
        raise root.place.wrong(f"the file holds {what}", "export a route (<rte>) of at most 31 points")
    require_few(name, len(found))
    ours = [_extension(element) for element in found]
    relative = all("altitude" in extra for extra in ours)
    elevated = all(element.find("ele") is not None for element in found)
    points = [_read_point(element, extra, relative) for element, extra in zip(found, ours, strict=True)]
    title = (route.text_of("name") if route else None) or ""
    sea_or_none = AltitudeReference.SEA_LEVEL if elevated else AltitudeReference.ABSENT
    beside = {"waypoint": loose if route else [], "track": list(root.walk("trk"))}
    notes = tuple(f"beside the mission, {what}s: {len(left)}" for what, left in beside.items() if left)
    return MissionDraft(assemble(name, points, title), AltitudeReference.START if relative else sea_or_none, notes)


def write(mission: Mission) -> str:
    """Return the mission as a GPX 1.1 route; altitudes above the start stand in our extension only."""
    lines = [
        '<?xml version="1.0" encoding="UTF-8"?>',
        f'<gpx version="1.1" creator="mkdaemon" xmlns="http://www.topografix.com/GPX/1/1" xmlns:mk="{NAMESPACE}">',
        "  <rte>",
        f"    <name>{escape(mission.name)}</name>",
    ]
    for point in mission.points:
        lines += [
            f'    <rtept lat="{point.latitude_deg:.7f}" lon="{point.longitude_deg:.7f}">',
            f"      <name>{escape(point.name)}</name>",
            "      <extensions>",
            f"        <mk:point {_attributes(point)}/>",
            "      </extensions>",
            "    </rtept>",
        ]
    return "\n".join([*lines, "  </rte>", "</gpx>", ""])


def _attributes(point: MissionPoint) -> str:
    fields = point.model_dump(mode="json", exclude={"latitude_deg", "longitude_deg", "name"}, exclude_none=True)
    return " ".join(f"{key}={quoteattr(str(value))}" for key, value in fields.items())


def _extension(element: Element) -> dict[str, str]:
    extensions = element.find("extensions")
    point = extensions.find("point") if extensions else None
    return point.attributes if point else {}


def _read_point(element: Element, extra: dict[str, str], relative: bool) -> MissionPoint:
    place = element.place
    fields = read_extras(place, extra)
    height = extra["altitude"] if relative else element.text_of("ele") or "0"
    return place.point(
        latitude_deg=place.number("lat", element.attributes.get("lat")),
        longitude_deg=place.number("lon", element.attributes.get("lon")),
        altitude=place.number("altitude" if relative else "ele", height),
        name=(element.text_of("name") or "") if relative else short_name(element.text_of("name")),
        **fields,
    )


def read_extras(place: FilePlace, extra: dict[str, str]) -> dict[str, Any]:
    """Read the fields a general format has no element for, from our extension.

    Raises:
        ConfigError: a value is wrong.
    """
    fields: dict[str, Any] = {key: place.whole(key, extra[key]) for key in _WHOLE if key in extra}
    fields |= {key: place.number(key, extra[key]) for key in _DECIMAL if key in extra}
    if "kind" in extra:
        if extra["kind"] not in set(PointKind):
            raise place.wrong(f"kind is {extra['kind']!r}", f"use one of {', '.join(PointKind)}")
        fields["kind"] = PointKind(extra["kind"])
    return fields
