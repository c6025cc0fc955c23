"""The flown track as GPX 1.1 and KML 2.2, from `state/position`.

Sources: GPX 1.1 schema (topografix.com/GPX/1/1); OGC 12-007r2, KML 2.3, `gx:Track` as Google introduced it in 2.2.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from datetime import UTC, datetime
from typing import Final, NamedTuple
from xml.sax.saxutils import escape

from mkdaemon.client.export.values import ExportedValue
from mkdaemon.errors import MkError
from mkdaemon.telemetry.state import Position

POSITION: Final = "state/position"
XML: Final = '<?xml version="1.0" encoding="utf-8"?>\n'
_GPX: Final = "http://www.topografix.com/GPX/1/1"
_KML: Final = "http://www.opengis.net/kml/2.2"
_GX: Final = "http://www.google.com/kml/ext/2.2"


class TrackPoint(NamedTuple):
    """One place.

    Attributes:
        wall: Unix time [s].
        place: as it was published.
    """

    wall: float
    place: Position

    @property
    def time(self) -> str:
        """In ISO 8601, UTC, with milliseconds."""
        return datetime.fromtimestamp(self.wall, UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")


def tracks_of(values: Iterable[ExportedValue]) -> dict[str, list[TrackPoint]]:
    """The track of each vehicle.

    Raises:
        MkError: there is no position in the recording, or one is none.
    """
    tracks: dict[str, list[TrackPoint]] = {}
    for value in values:
        if value.suffix == POSITION and isinstance(place := value.stamped, Position):
            tracks.setdefault(value.vehicle, []).append(TrackPoint(value.wall, place))
    if not tracks:
        msg = f"no {POSITION} in this recording: a NaviCtrl with a GPS fix publishes it; --format csv takes all keys"
        raise MkError(msg)
    return tracks


def gpx(tracks: dict[str, list[TrackPoint]]) -> Iterator[str]:
    """One track a vehicle, line by line; `ele` is the receiver's altitude, left out where it is not known."""
    yield XML
    yield f'<gpx xmlns="{_GPX}" version="1.1" creator="mkdaemon">\n'
    for vehicle, points in tracks.items():
        yield f"  <trk>\n    <name>{escape(vehicle)}</name>\n    <trkseg>\n"
        for point in points:
            at = point.place
            height = "" if at.altitude is None else f"<ele>{at.altitude:.2f}</ele>"
            where = f'lat="{at.latitude_deg:.7f}" lon="{at.longitude_deg:.7f}"'
            yield f"      <trkpt {where}>{height}<time>{point.time}</time></trkpt>\n"
        yield "    </trkseg>\n  </trk>\n"
    yield "</gpx>\n"


def kml(tracks: dict[str, list[TrackPoint]]) -> Iterator[str]:
    """One track a vehicle, line by line.

    Heights are above the ground at the start where they are known, else the receiver's altitude.
    """
    yield XML
    yield f'<kml xmlns="{_KML}" xmlns:gx="{_GX}">\n  <Document>\n    <name>mkdaemon</name>\n'
    for vehicle, points in tracks.items():
        is_relative = all(point.place.altitude_above_start is not None for point in points)
        mode = "relativeToGround" if is_relative else "absolute"
        yield f"    <Placemark>\n      <name>{escape(vehicle)}</name>\n      <gx:Track>\n"
        yield f"        <altitudeMode>{mode}</altitudeMode>\n"
        for point in points:
            yield f"        <when>{point.time}</when>\n"
        for point in points:
            at = point.place
            up = at.altitude_above_start if is_relative else at.altitude
            coordinates = f"{at.longitude_deg:.7f} {at.latitude_deg:.7f} {up or 0.0:.2f}"
            yield f"        <gx:coord>{coordinates}</gx:coord>\n"
        yield "      </gx:Track>\n    </Placemark>\n"
    yield "  </Document>\n</kml>\n"
