"""What a procedure asks of the flight before it begins: where points may lie, and when a route may start."""

from __future__ import annotations

import math
from typing import Final, NamedTuple

from mkdaemon.control.vehicle import VehicleFacts
from mkdaemon.frames import enu_from_geodetic
from mkdaemon.telemetry.mission import PointKind, RouteStartRequest, WaypointsUploadRequest
from mkdaemon.telemetry.refusals import Token, refuse

FAR: Final = 5_000.0
"""A point further away than this is a mistake, unless the request says otherwise [m]."""
HIGH: Final = 500.0
"""The same of a point above the start [m]."""


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


def check_places(request: WaypointsUploadRequest, facts: VehicleFacts, now: float) -> None:
    """Refuse points that nobody means: far from the aircraft, below its start or far above.

    Without a position of the aircraft the first point stands for it.

    Raises:
        CommandRejectedError: `point_unusual`.
    """
    if request.allow_unusual:
        return
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


def check_route(request: RouteStartRequest, facts: VehicleFacts, now: float) -> None:
    """Refuse to start a route where that would have no effect or another one.

    Raises:
        CommandRejectedError: `route_on_ground`, `route_active`.
    """
    flight = facts.flight(now)
    if flight is None or not flight.is_flying:
        detail = (
            "nobody has told lately whether it flies" if flight is None or flight.is_flying is None else "it stands"
        )
        raise refuse(Token.ROUTE_ON_GROUND, detail=detail)
    if flight.waypoint_index:
        raise refuse(Token.ROUTE_ACTIVE, index=flight.waypoint_index, count=flight.waypoint_count or 0)
