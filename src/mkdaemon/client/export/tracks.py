"""The flown track as GPX 1.1 and KML 2.2, from `state/position`.

Sources: GPX 1.1 schema (topografix.com/GPX/1/1); OGC 12-007r2, KML 2.3, `gx:Track` as Google introduced it in 2.2.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Final
from xml.etree import ElementTree

from mkdaemon.client.export.values import Value
from mkdaemon.errors import MkError

POSITION: Final = "state/position"
_GPX: Final = "http://www.topografix.com/GPX/1/1"
_KML: Final = "http://www.opengis.net/kml/2.2"
_GX: Final = "http://www.google.com/kml/ext/2.2"


@dataclass(frozen=True, slots=True)
class TrackPoint:
    """One place.

    Attributes:
        wall: Unix time [s].
        latitude_deg: WGS-84 [deg].
        longitude_deg: WGS-84 [deg].
        altitude: by GPS, as the receiver gives it [m]; None where it is not known.
        height: above the start [m]; None where it is not known.
    """

    wall: float
    latitude_deg: float
    longitude_deg: float
    altitude: float | None
    height: float | None

    @property
    def time(self) -> str:
        """In ISO 8601, UTC, with milliseconds."""
        return datetime.fromtimestamp(self.wall, UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")


def tracks_of(values: Iterable[Value]) -> dict[str, list[TrackPoint]]:
    """The track of each vehicle.

    Raises:
        MkError: there is no position in the recording.
    """
    tracks: dict[str, list[TrackPoint]] = {}
    for value in values:
        if value.suffix == POSITION:
            fields = value.fields
            point = TrackPoint(
                value.wall,
                fields["latitude_deg"],
                fields["longitude_deg"],
                fields.get("altitude"),
                fields.get("altitude_above_start"),
            )
            tracks.setdefault(value.vehicle, []).append(point)
    if not tracks:
        msg = f"no {POSITION} in this recording: a NaviCtrl with a GPS fix publishes it; --format csv takes all keys"
        raise MkError(msg)
    return tracks


def gpx(tracks: dict[str, list[TrackPoint]]) -> bytes:
    """One track a vehicle; `ele` is the receiver's altitude, left out where it is not known."""
    ElementTree.register_namespace("", _GPX)
    root = ElementTree.Element(f"{{{_GPX}}}gpx", {"version": "1.1", "creator": "mkdaemon"})
    for vehicle, points in tracks.items():
        track = ElementTree.SubElement(root, f"{{{_GPX}}}trk")
        ElementTree.SubElement(track, f"{{{_GPX}}}name").text = vehicle
        segment = ElementTree.SubElement(track, f"{{{_GPX}}}trkseg")
        for point in points:
            place = {"lat": f"{point.latitude_deg:.7f}", "lon": f"{point.longitude_deg:.7f}"}
            element = ElementTree.SubElement(segment, f"{{{_GPX}}}trkpt", place)
            if point.altitude is not None:
                ElementTree.SubElement(element, f"{{{_GPX}}}ele").text = f"{point.altitude:.2f}"
            ElementTree.SubElement(element, f"{{{_GPX}}}time").text = point.time
    return _document(root)


def kml(tracks: dict[str, list[TrackPoint]]) -> bytes:
    """One track a vehicle, heights above the ground at the start where they are known, else the receiver's altitude."""
    ElementTree.register_namespace("", _KML)
    ElementTree.register_namespace("gx", _GX)
    root = ElementTree.Element(f"{{{_KML}}}kml")
    document = ElementTree.SubElement(root, f"{{{_KML}}}Document")
    ElementTree.SubElement(document, f"{{{_KML}}}name").text = "mkdaemon"
    for vehicle, points in tracks.items():
        mark = ElementTree.SubElement(document, f"{{{_KML}}}Placemark")
        ElementTree.SubElement(mark, f"{{{_KML}}}name").text = vehicle
        track = ElementTree.SubElement(mark, f"{{{_GX}}}Track")
        is_relative = all(point.height is not None for point in points)
        mode = "relativeToGround" if is_relative else "absolute"
        ElementTree.SubElement(track, f"{{{_KML}}}altitudeMode").text = mode
        for point in points:
            ElementTree.SubElement(track, f"{{{_KML}}}when").text = point.time
        for point in points:
            up = point.height if is_relative else point.altitude
            coordinates = f"{point.longitude_deg:.7f} {point.latitude_deg:.7f} {up or 0.0:.2f}"
            ElementTree.SubElement(track, f"{{{_GX}}}coord").text = coordinates
    return _document(root)


def _document(root: ElementTree.Element) -> bytes:
    ElementTree.indent(root)
    content: bytes = ElementTree.tostring(root, encoding="utf-8", xml_declaration=True)
    return content + b"\n"
