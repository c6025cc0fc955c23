"""Rows about what the NaviCtrl flies by itself: where points may lie, when a route may start, where home is."""

from __future__ import annotations

import math
from typing import Final, NamedTuple

from mkdaemon.control.admission.beginnings import Concern, ListUpload, NaviGoto, StartRoute
from mkdaemon.control.admission.row import Rows, Verdict, passed, stands
from mkdaemon.control.admission.situation import Situation
from mkdaemon.frames import enu_from_geodetic
from mkdaemon.telemetry.mission import MissionPoint, PointKind
from mkdaemon.telemetry.refusals import Token, refuse
from mkdaemon.telemetry.state import GpsFix, GpsMode

FAR: Final = 5_000.0
"""A point further away than this is a mistake, unless the request says otherwise [m]."""
HIGH: Final = 500.0
"""The same of a point above the start [m]."""
LEAST_SATELLITES: Final = 6
"""With fewer no target is taken: what NaviCtrls ask for from the factory, docs/protocol.md, NaviGpsMinSat."""

_NAVI_GOTO: Final = (Concern.NAVI_GOTO,)

NAVI_ROWS: Final = Rows()
"""What prevents points, routes and places."""


class GroundPlace(NamedTuple):
    """A place on the ground, latitude and longitude [deg]."""

    latitude: float
    longitude: float

    def distance_to(self, other: GroundPlace) -> float:
        """Distance over ground [m]."""
        here = (math.radians(self.latitude), math.radians(self.longitude), 0.0)
        east, north, _ = enu_from_geodetic(math.radians(other.latitude), math.radians(other.longitude), 0.0, here)
        return math.hypot(east, north)


@NAVI_ROWS.row(
    "places",
    (Concern.UPLOAD,),
    f"a point is more than {FAR / 1000:g} km away, below the start, or more than {HIGH:g} m above it, and "
    "the request does not say `allow_unusual`",
    Token.POINT_UNUSUAL,
)
def _usual(now: Situation, wanted: ListUpload) -> Verdict:
    """Refuse implausible points, by distance from the aircraft; if its position is unknown, from the first point."""
    if wanted.allow_unusual:
        return passed()
    if now.position is None:
        origin, of = GroundPlace(wanted.points[0].latitude_deg, wanted.points[0].longitude_deg), "point 1"
    else:
        origin, of = GroundPlace(now.position.latitude_deg, now.position.longitude_deg), "the aircraft"
    for number, point in enumerate(wanted.points, 1):
        detail = _mistake(point, origin, of)
        if detail:
            return stands(refuse(Token.POINT_UNUSUAL, number=number, detail=detail))
    return passed()


def _mistake(point: MissionPoint, origin: GroundPlace, of: str) -> str:
    """What is strange about a point; empty for nothing."""
    away = origin.distance_to(GroundPlace(point.latitude_deg, point.longitude_deg))
    if not away <= FAR:
        return f"is {away / 1000:,.0f} km away from {of}"
    if point.kind is not PointKind.POI and point.altitude < 0:
        return f"lies {-point.altitude:g} m below the start"
    return f"lies {point.altitude:g} m above the start" if point.altitude > HIGH else ""


@NAVI_ROWS.row(
    "aircraft in the air",
    (Concern.ROUTE, Concern.NAVI_GOTO),
    "it stands, or no recent telemetry says whether it flies",
    Token.ROUTE_ON_GROUND,
)
def _in_flight(now: Situation, wanted: StartRoute | NaviGoto) -> Verdict:
    if now.flight is not None and now.flight.is_flying:
        return passed()
    is_unknown = now.flight is None or now.flight.is_flying is None
    detail = "no recent telemetry says whether it flies" if is_unknown else "it stands"
    return stands(refuse(Token.ROUTE_ON_GROUND, detail=detail))


@NAVI_ROWS.row("no route under way", (Concern.ROUTE,), "it flies a route already", Token.ROUTE_ACTIVE)
def _no_route(now: Situation, wanted: StartRoute) -> Verdict:
    flight = now.flight
    if flight is None or not flight.waypoint_index:
        return passed()
    return stands(refuse(Token.ROUTE_ACTIVE, index=flight.waypoint_index, count=flight.waypoint_count or 0))


@NAVI_ROWS.row("switch at home", _NAVI_GOTO, "the pilot's GPS switch is at coming home", Token.SWITCH_AT_HOME)
def _not_coming_home(now: Situation, wanted: NaviGoto) -> Verdict:
    is_coming = now.flight is not None and now.flight.gps_mode is GpsMode.COME_HOME
    return stands(refuse(Token.SWITCH_AT_HOME)) if is_coming else passed()


@NAVI_ROWS.row(
    "position by GPS",
    _NAVI_GOTO,
    f"it has none, fewer than {LEAST_SATELLITES} satellites, or does not know home",
    Token.POSITION_POOR,
)
def _position(now: Situation, wanted: NaviGoto) -> Verdict:
    position, gps = now.position, now.gps
    if position is None or (gps is not None and gps.fix is GpsFix.NONE):
        return stands(refuse(Token.POSITION_POOR, detail="it has none"))
    if gps is not None and gps.satellites is not None and gps.satellites < LEAST_SATELLITES:
        return stands(refuse(Token.POSITION_POOR, detail=f"{gps.satellites} satellites, less than {LEAST_SATELLITES}"))
    if position.home_latitude_deg is None or position.home_longitude_deg is None:
        return stands(refuse(Token.POSITION_POOR, detail="home is not known"))
    return passed()


@NAVI_ROWS.row(
    "height of the place", _NAVI_GOTO, f"it lies below the start, or more than {HIGH:g} m above it", Token.POINT_UNUSUAL
)
def _height(now: Situation, wanted: NaviGoto) -> Verdict:
    if 0.0 <= wanted.up <= HIGH:
        return passed()
    detail = f"lies {wanted.up:g} m above the start, not 0 to {HIGH:g}"
    return stands(refuse(Token.POINT_UNUSUAL, number=1, detail=detail))
