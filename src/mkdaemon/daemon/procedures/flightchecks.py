"""What a procedure asks of the flight before it begins: where points may lie, when a route may start, where home is."""

from __future__ import annotations

import math
from typing import Final, NamedTuple

from mkdaemon.control.vehicle import VehicleFacts
from mkdaemon.frames import enu_from_geodetic, geodetic_from_enu
from mkdaemon.telemetry.mission import MissionPoint, PointKind, RouteStartRequest, WaypointsUploadRequest
from mkdaemon.telemetry.navi import NaviGotoRequest
from mkdaemon.telemetry.refusals import Token, refuse
from mkdaemon.telemetry.state import Flight, GpsFix, GpsMode

FAR: Final = 5_000.0
"""A point further away than this is a mistake, unless the request says otherwise [m]."""
HIGH: Final = 500.0
"""The same of a point above the start [m]."""
LEAST_SATELLITES: Final = 6
"""With fewer no target is taken: what NaviCtrls ask for from the factory, docs/protocol.md, NaviGpsMinSat."""


class Place(NamedTuple):
    """A place on the ground.

    Attributes:
        latitude: [deg].
        longitude: [deg].
    """

    latitude: float
    longitude: float

    def distance_to(self, other: Place) -> float:
        """Distance over ground [m]."""
        here = (math.radians(self.latitude), math.radians(self.longitude), 0.0)
        east, north, _ = enu_from_geodetic(math.radians(other.latitude), math.radians(other.longitude), 0.0, here)
        return math.hypot(east, north)


def check_places(request: WaypointsUploadRequest, facts: VehicleFacts, now: float) -> WaypointsUploadRequest:
    """Refuse points that nobody means: far from the aircraft, below its start or far above; else return the request.

    Without a position of the aircraft the first point stands for it.

    Raises:
        CommandRejectedError: `point_unusual`.
    """
    if request.allow_unusual:
        return request
    position = facts.position(now)
    if position is None:
        origin, of = Place(request.points[0].latitude_deg, request.points[0].longitude_deg), "point 1"
    else:
        origin, of = Place(position.latitude_deg, position.longitude_deg), "the aircraft"
    for number, point in enumerate(request.points, 1):
        away = origin.distance_to(Place(point.latitude_deg, point.longitude_deg))
        if not away <= FAR:
            raise refuse(Token.POINT_UNUSUAL, number=number, detail=f"is {away / 1000:,.0f} km away from {of}")
        if point.kind is not PointKind.POI and point.altitude < 0:
            raise refuse(Token.POINT_UNUSUAL, number=number, detail=f"lies {-point.altitude:g} m below the start")
        if point.altitude > HIGH:
            raise refuse(Token.POINT_UNUSUAL, number=number, detail=f"lies {point.altitude:g} m above the start")
    return request


def check_route(request: RouteStartRequest, facts: VehicleFacts, now: float) -> RouteStartRequest:
    """Refuse to start a route where that would have no effect or another one; else return the request.

    Raises:
        CommandRejectedError: `route_on_ground`, `route_active`.
    """
    flight = _require_flight(facts, now)
    if flight.waypoint_index:
        raise refuse(Token.ROUTE_ACTIVE, index=flight.waypoint_index, count=flight.waypoint_count or 0)
    return request


def target_point(request: NaviGotoRequest, facts: VehicleFacts, now: float) -> MissionPoint:
    """Return the place a request means, from the home position that the NaviCtrl tells.

    Raises:
        CommandRejectedError: `route_on_ground`, `switch_at_home`, `position_poor`, `point_unusual`.
    """
    flight = _require_flight(facts, now)
    if flight.gps_mode is GpsMode.COME_HOME:
        raise refuse(Token.SWITCH_AT_HOME)
    position, gps = facts.position(now), facts.gps(now)
    if position is None or (gps is not None and gps.fix is GpsFix.NONE):
        raise refuse(Token.POSITION_POOR, detail="it has none")
    if gps is not None and gps.satellites is not None and gps.satellites < LEAST_SATELLITES:
        raise refuse(Token.POSITION_POOR, detail=f"{gps.satellites} satellites, less than {LEAST_SATELLITES}")
    if position.home_latitude_deg is None or position.home_longitude_deg is None:
        raise refuse(Token.POSITION_POOR, detail="home is not known")
    east, north, up = request.position
    if not 0.0 <= up <= HIGH:
        raise refuse(Token.POINT_UNUSUAL, number=1, detail=f"lies {up:g} m above the start, not 0 to {HIGH:g}")
    home = (math.radians(position.home_latitude_deg), math.radians(position.home_longitude_deg), 0.0)
    latitude, longitude, _ = geodetic_from_enu(east, north, 0.0, home)
    return MissionPoint(
        latitude_deg=math.degrees(latitude),
        longitude_deg=math.degrees(longitude),
        altitude=up,
        radius=request.radius,
        hold=request.hold,
        heading_deg=request.heading_deg,
    )


def _require_flight(facts: VehicleFacts, now: float) -> Flight:
    """Return what the aircraft does, which is to fly.

    Raises:
        CommandRejectedError: `route_on_ground`.
    """
    flight = facts.flight(now)
    if flight is None or not flight.is_flying:
        is_unknown = flight is None or flight.is_flying is None
        detail = "nobody has told lately whether it flies" if is_unknown else "it stands"
        raise refuse(Token.ROUTE_ON_GROUND, detail=detail)
    return flight
