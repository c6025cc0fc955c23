"""Angles and positions of the boards, in ENU and FLU."""

from __future__ import annotations

import math
from dataclasses import dataclass

from mkdaemon.frames import (
    enu_from_geodetic,
    quaternion_from_rotation,
    rotation_from_euler,
    yaw_enu_from_heading,
)
from mkdaemon.telemetry.state import AngleScale, Attitude, Position
from mkdaemon.translate.origin import Origin


@dataclass(frozen=True, slots=True)
class Home:
    """Where the aircraft started [deg; WGS-84]."""

    latitude: float
    longitude: float


def attitude(
    origin: Origin, *, roll: float, pitch: float, heading: float, scale: AngleScale = AngleScale.STICKS
) -> Attitude:
    """Make an attitude.

    Args:
        origin: when and from where.
        roll: right side down positive [rad; FLU].
        pitch: nose down positive [rad; FLU].
        heading: clockwise from magnetic north [rad].
        scale: of roll and pitch, as the board reports them.
    """
    yaw = yaw_enu_from_heading(heading)
    quaternion = quaternion_from_rotation(rotation_from_euler(roll, pitch, yaw))
    return Attitude(**origin._asdict(), quaternion=quaternion, roll=roll, pitch=pitch, yaw=yaw, scale=scale)


def position(
    origin: Origin,
    *,
    latitude: float,
    longitude: float,
    altitude: float | None,
    above_start: float | None,
    home: Home | None,
    board_home_distance: float | None,
) -> Position:
    """Make a position; east and north of home by GPS, up by the barometer, which is the better of the two.

    Args:
        origin: when and from where.
        latitude: [deg].
        longitude: [deg].
        altitude: by GPS [m].
        above_start: by barometer [m]; None where it is not known.
        home: where it started, if known.
        board_home_distance: as the board says it [m].
    """
    position_enu = home_distance = None
    if home is not None:
        east, north = east_north(latitude, longitude, home)
        position_enu = None if above_start is None else (east, north, above_start)
        home_distance = math.hypot(east, north)
    return Position(
        **origin._asdict(),
        latitude_deg=latitude,
        longitude_deg=longitude,
        altitude=altitude,
        altitude_above_start=above_start,
        position_enu=position_enu,
        home_latitude_deg=None if home is None else home.latitude,
        home_longitude_deg=None if home is None else home.longitude,
        home_distance=home_distance,
        board_home_distance=board_home_distance,
    )


def east_north(latitude: float, longitude: float, origin: Home) -> tuple[float, float]:
    """Return how far east and north of a place another one lies [m]; latitude and longitude in degrees."""
    east, north, _ = enu_from_geodetic(
        math.radians(latitude),
        math.radians(longitude),
        0.0,
        (math.radians(origin.latitude), math.radians(origin.longitude), 0.0),
    )
    return east, north
