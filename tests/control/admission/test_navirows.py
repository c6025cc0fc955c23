"""What the NaviCtrl flies by itself: where points may lie, when a route may start, what a place needs."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from mkdaemon.control.admission.beginnings import ListUpload, NaviGoto, StartRoute
from mkdaemon.control.admission.rows import refusal
from mkdaemon.telemetry.mission import MissionPoint, PointKind
from mkdaemon.telemetry.state import Gps, GpsFix, GpsMode, Position
from tests.control.admission.situations import GOOD, flags
from tests.values import made

PLACE = {"latitude_deg": 53.0, "longitude_deg": 8.0, "home_latitude_deg": 53.0, "home_longitude_deg": 8.0}
HOME = made(Position, altitude_above_start=2.0, home_distance=0.0, **PLACE)
FAR, HIGH, LEAST_SATELLITES = 5000.0, 500.0, 6
"""Limits of docs/waypoints.md [m], and NaviGpsMinSat from the factory."""
METRE = 1.0 / 111_200.0
"""Degrees of latitude."""
EAST = math.cos(math.radians(53.0))
"""A degree of longitude over one of latitude, there."""


def gps(satellites=10, fix=GpsFix.VALID):
    return made(Gps, satellites=satellites, fix=fix, is_usable=True, is_home_set=True)


def upload(*places, **fields):
    points = [MissionPoint(latitude_deg=la, longitude_deg=lo, altitude=up, **fields) for la, lo, up in places]
    return ListUpload(tuple(points))


@pytest.mark.parametrize(
    ("place", "fields", "words"),
    [
        ((53.0, 8.0, 0.0), {}, ""),
        ((53.0, 8.0, -0.1), {}, "lies 0.1 m below the start"),
        ((53.0, 8.0, -5.0), {"kind": PointKind.POI}, ""),
        ((53.0, 8.0, HIGH), {}, ""),
        ((53.0, 8.0, HIGH + 0.6), {}, "lies 500.6 m above the start"),
        ((53.0 + 0.99 * FAR * METRE, 8.0, 5.0), {}, ""),
        ((53.0 + 1.01 * FAR * METRE, 8.0, 5.0), {}, "km away from the aircraft"),
        ((53.2, 8.0, 5.0), {}, "is 22 km away from the aircraft"),
        ((53.0, 8.0 - 0.99 * FAR * METRE / EAST, 5.0), {}, ""),
        ((53.0, 8.0 + 1.01 * FAR * METRE / EAST, 5.0), {}, "km away from the aircraft"),
    ],
)
def test_a_point_may_lie_up_to_its_limits_and_no_further(place, fields, words):
    error = refusal(upload((53.0, 8.0, 5.0), place, **fields), replace(GOOD, position=HOME))
    assert (error is None) is (words == "")
    assert error is None or ("point 2" in error.reason and words in error.reason)


@pytest.mark.parametrize(("up", "refused"), [(0.0, False), (500.0, False), (-0.1, True), (500.1, True)])
def test_a_place_lies_between_the_ground_and_a_height(up, refused):
    known = replace(GOOD, flight=flags(is_flying=True), position=HOME, gps=gps())
    error = refusal(NaviGoto(up), known)
    assert (error is not None) is refused
    assert error is None or error.reason == f"point 1 lies {up:g} m above the start, not 0 to 500."


def test_points_are_measured_from_the_aircraft_or_from_the_first_of_them():
    far = (53.0 + 2.0 * FAR * METRE, 8.0, 5.0)
    from_aircraft = refusal(upload(far, far), replace(GOOD, position=HOME))
    assert "point 1" in from_aircraft.reason
    assert "from the aircraft" in from_aircraft.reason
    assert refusal(upload(far, far), replace(GOOD, position=None)) is None
    apart = (53.0, 8.0 + 0.99 * FAR * METRE / EAST, 5.0)
    assert refusal(upload((53.0, 8.0, 5.0), apart), replace(GOOD, position=None)) is None
    assert refusal(upload(apart, far), replace(GOOD, position=None)).reason.count("km away from point 1") == 1
    from_first = refusal(upload((53.0, 8.0, 5.0), far), replace(GOOD, position=None))
    assert "from point 1" in from_first.reason
    assert "point 2" in from_first.reason


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({}, ""),
        ({"gps": None}, ""),
        ({"gps": gps(satellites=LEAST_SATELLITES)}, ""),
        ({"gps": gps(satellites=LEAST_SATELLITES - 1)}, f"{LEAST_SATELLITES - 1} satellites"),
        ({"gps": gps(satellites=None)}, ""),
        ({"gps": gps(fix=GpsFix.NONE)}, "it has none"),
        ({"position": None}, "it has none"),
        ({"position": HOME.model_copy(update={"home_latitude_deg": None})}, "home is not known"),
        ({"position": HOME.model_copy(update={"home_longitude_deg": None})}, "home is not known"),
    ],
)
def test_a_place_is_flown_to_with_a_position_that_is_good_enough(change, words):
    known = replace(GOOD, flight=flags(is_flying=True), position=HOME, gps=gps())
    error = refusal(NaviGoto(2.0), replace(known, **change))
    assert (error is None) is (words == "")
    assert error is None or words in error.reason


@pytest.mark.parametrize(
    ("flight", "token", "words"),
    [
        (None, "route_on_ground", "no recent telemetry"),
        (flags(is_flying=None), "route_on_ground", "no recent telemetry"),
        (flags(is_flying=False), "route_on_ground", "it stands"),
        (flags(is_flying=True), None, ""),
        (flags(is_flying=True, waypoint_index=0), None, ""),
        (flags(is_flying=True, waypoint_index=2, waypoint_count=5), "route_active", "2 of 5"),
    ],
)
def test_a_route_begins_in_the_air_and_after_the_one_before(flight, token, words):
    error = refusal(StartRoute(), replace(GOOD, flight=flight))
    assert (None if error is None else error.token) == token
    assert error is None or words in error.reason


@pytest.mark.parametrize(("mode", "refused"), [(mode, mode is GpsMode.COME_HOME) for mode in GpsMode])
def test_no_place_is_given_while_the_switch_would_fly_to_it_at_once(mode, refused):
    known = replace(GOOD, flight=flags(is_flying=True, gps_mode=mode), position=HOME, gps=gps())
    error = refusal(NaviGoto(2.0), known)
    assert (error is not None and error.token == "switch_at_home") is refused
