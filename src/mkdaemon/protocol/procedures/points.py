"""Missions as points of one NaviCtrl release, and back.

The 30 bytes are the same in every release, but what the last of them mean is not; a mission that needs what a release
cannot express is refused, never trimmed. Sources: docs/protocol.md, "Points" and "Disagreements" (altitude of points of
interest: cm up to 0.28, dm from 0.30 on).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

from mkdaemon.protocol.flags import PointType, PositionStatus
from mkdaemon.protocol.generations import Release, nc_generation
from mkdaemon.protocol.messages import WriteWaypoint024, WriteWaypoint027, WriteWaypoint2x
from mkdaemon.protocol.procedures.labels import read_version
from mkdaemon.protocol.procedures.steps import Patience, Procedure
from mkdaemon.protocol.wire import Board, WireMessage
from mkdaemon.telemetry.mission import Mission, MissionPoint, PointKind
from mkdaemon.telemetry.refusals import Token, refuse

_CLASSES: Final[dict[str, type[WireMessage]]] = {
    "024": WriteWaypoint024,
    "027": WriteWaypoint027,
    "2x": WriteWaypoint2x,
}
_KINDS: Final = {
    PointKind.WAYPOINT: (PointType.WAYPOINT, (0, 0)),
    PointKind.POI: (PointType.POINT_OF_INTEREST, (0, 24)),
    PointKind.FAILSAFE: (PointType.FAILSAFE, (2, 0)),
    PointKind.LAND: (PointType.LANDING, (2, 16)),
}
"""Each kind on the wire, and the first NaviCtrl release that knows it."""
_OPTIONAL: Final = {
    "speed": "speed",
    "camera_angle_deg": "camera_angle",
    "name": "name",
    "photo_distance": "photo_distance",
}
"""Fields of a mission point that only some releases have, and their names on the wire."""
_LIST_024: Final = 31
_LIST_2X: Final = 254
"""Later lists are longer by an unknown amount: the board refuses what it cannot hold, and the upload says so."""


@dataclass(frozen=True, slots=True)
class PointFormat:
    """Format of points of one NaviCtrl release.

    Attributes:
        release: of the NaviCtrl.
        kind: class of its points.
        poi_scale: counts of a point of interest's altitude [1/m].
        limit: points its list holds.
    """

    release: Release
    kind: type[WireMessage]
    poi_scale: int
    limit: int


def point_format(release: Release) -> PointFormat:
    """Return how a NaviCtrl release writes points.

    Raises:
        CommandRejectedError: `unknown_navictrl`: the release is in no table, or its points are not documented.
    """
    generation = nc_generation(release)
    kind = _CLASSES.get(generation.point or "") if generation else None
    if kind is None:
        raise refuse(Token.UNKNOWN_NAVICTRL, release=release)
    return PointFormat(
        release=release,
        kind=kind,
        poi_scale=100 if release < (0, 29) else 10,
        limit=_LIST_024 if release < (2, 0) else _LIST_2X,
    )


def to_points(mission: Mission, form: PointFormat) -> tuple[WireMessage, ...]:
    """Return the mission as write messages, numbered from 1.

    Raises:
        CommandRejectedError: `too_many_points` or `point_not_expressible`.
    """
    if len(mission.points) > form.limit:
        raise refuse(Token.TOO_MANY_POINTS, count=len(mission.points), limit=form.limit)
    return tuple(_to_point(number, point, form) for number, point in enumerate(mission.points, 1))


def from_points(points: Sequence[WireMessage], form: PointFormat) -> Mission:
    """Return what a board holds as a mission.

    Raises:
        CommandRejectedError: `point_not_expressible`: a stored point is no valid one.
    """
    found = tuple(_from_point(number, point, form) for number, point in enumerate(points, 1))
    try:
        return Mission(points=found)
    except ValueError as error:
        number = next(n for n, point in enumerate(found, 1) if point.poi and not _is_poi(found, point.poi))
        detail = f"it looks at point {found[number - 1].poi}, which is not a point of interest of this list"
        raise refuse(Token.POINT_NOT_EXPRESSIBLE, number=number, detail=detail) from error


def _is_poi(points: Sequence[MissionPoint], number: int) -> bool:
    return number <= len(points) and points[number - 1].kind is PointKind.POI


def _to_point(number: int, point: MissionPoint, form: PointFormat) -> WireMessage:
    kind, since = _KINDS[point.kind]
    if form.release[:2] < since:
        detail = f"NaviCtrl {form.release} knows no {point.kind} points (since {since[0]}.{since[1]:02d})"
        raise refuse(Token.POINT_NOT_EXPRESSIBLE, number=number, detail=detail)
    scale = form.poi_scale if point.kind is PointKind.POI else 10
    fields: dict[str, Any] = {
        "longitude": round(point.longitude_deg * 1e7),
        "latitude": round(point.latitude_deg * 1e7),
        "altitude": round(point.altitude * scale),
        "status": PositionStatus.NEW,
        "heading": -point.poi if point.poi else point.heading_deg or 0,
        "tolerance_radius": point.radius,
        "hold_time": point.hold,
        "index": number,
        "type": kind,
        "event_channel": point.event,
        "altitude_rate": round(point.climb * 10),
    }
    for ours, wire in _OPTIONAL.items():
        value = getattr(point, ours)
        if wire in form.kind.model_fields:
            fields[wire] = round(value * 10) if ours == "speed" else value
        elif ours != "name" and value:
            # A name is only for people; anything else left out would fly differently.
            detail = f"NaviCtrl {form.release} points carry no {ours}, the mission says {value}"
            raise refuse(Token.POINT_NOT_EXPRESSIBLE, number=number, detail=detail)
    return form.kind(**fields)


def _from_point(number: int, point: WireMessage, form: PointFormat) -> MissionPoint:
    values = point.model_dump()
    kinds = {wire: ours for ours, (wire, _) in _KINDS.items()}
    kind = kinds.get(values["type"])
    if kind is None or values["status"] == PositionStatus.INVALID:
        raise refuse(
            Token.POINT_NOT_EXPRESSIBLE, number=number, detail=f"the board holds an invalid one (type {values['type']})"
        )
    heading = values["heading"]
    fields: dict[str, Any] = {ours: values[wire] for ours, wire in _OPTIONAL.items() if wire in values}
    if "speed" in fields:
        fields["speed"] /= 10
    try:
        return MissionPoint(
            latitude_deg=values["latitude"] / 1e7,
            longitude_deg=values["longitude"] / 1e7,
            altitude=values["altitude"] / (form.poi_scale if kind is PointKind.POI else 10),
            kind=kind,
            radius=values["tolerance_radius"],
            hold=values["hold_time"],
            heading_deg=heading if heading > 0 else None,
            poi=-heading if heading < 0 else None,
            climb=values["altitude_rate"] / 10,
            event=values["event_channel"],
            **fields,
        )
    except ValueError as error:
        detail = f"the board holds one out of range (latitude {values['latitude']}, longitude {values['longitude']})"
        raise refuse(Token.POINT_NOT_EXPRESSIBLE, number=number, detail=detail) from error


def read_format(patience: Patience) -> Procedure[PointFormat]:
    """Ask the NaviCtrl for its release, and return how it writes points.

    Raises:
        RequestTimeoutError: no answer.
        CommandRejectedError: `unknown_navictrl`.
    """
    version = yield from read_version(Board.NC, patience)
    return point_format(Release(version.major, version.minor, version.patch))
