"""What a target at home asks of the flight: each refusal with its remedy, and the place that is meant."""

from __future__ import annotations

import math

import pytest

from mkdaemon.control.admission.navirows import LEAST_SATELLITES
from mkdaemon.control.admission.rows import refusal
from mkdaemon.control.vehicle import VehicleMemory
from mkdaemon.daemon.procedures.table import PROCEDURES
from mkdaemon.errors import CommandRejectedError
from mkdaemon.frames import enu_from_geodetic
from mkdaemon.telemetry.navi import NaviGotoRequest
from mkdaemon.telemetry.state import Gps, GpsFix, GpsMode, Position
from tests.control.admission.situations import situation_of
from tests.control.events import STAMP, flight

HOME = (53.0, 8.0)


def position(**fields):
    known = {"latitude_deg": 53.0001, "longitude_deg": 8.0, "altitude": None, "altitude_above_start": 3.0}
    home = {"home_latitude_deg": HOME[0], "home_longitude_deg": HOME[1], "home_distance": 11.0, "position_enu": None}
    return Position(stamp=STAMP, source="nc/osd", **(known | home | fields))


def gps(satellites=9, fix=GpsFix.VALID):
    return Gps(stamp=STAMP, source="nc/osd", satellites=satellites, fix=fix, is_usable=True, is_home_set=True)


def facts(*values):
    known = VehicleMemory()
    for value in (flight(is_flying=True), *values):
        known.state_received(value, 1.0)
    return known


def ask(*values, at=(30.0, -20.0, 5.0), **fields):
    """The place that is meant; raises why it is refused."""
    known, request = facts(*values), NaviGotoRequest(position=at, confirm=True, **fields)
    spec = PROCEDURES["navi_goto"]
    error = refusal(spec.begins(request), situation_of(known, 1.0))
    if error is not None:
        raise error
    return spec.prepare(request, known.newest(Position, 1.0))


@pytest.mark.parametrize("reception", [(), (gps(),), (gps(satellites=None),)])
def test_the_place_is_so_far_from_home(reception):
    point = ask(position(), *reception, heading_deg=90, hold=20, radius=4)
    place = (math.radians(point.latitude_deg), math.radians(point.longitude_deg), point.altitude)
    home = (math.radians(HOME[0]), math.radians(HOME[1]), 0.0)
    assert enu_from_geodetic(*place, home) == pytest.approx((30.0, -20.0, 5.0), abs=0.02)
    assert (point.heading_deg, point.hold, point.radius) == (90, 20, 4)


@pytest.mark.parametrize(
    ("values", "fields", "token", "words"),
    [
        ((), {}, "position_poor", "it has none"),
        ((position(), gps(fix=GpsFix.NONE)), {}, "position_poor", "it has none"),
        ((position(), gps(LEAST_SATELLITES - 1)), {}, "position_poor", "5 satellites"),
        ((position(home_latitude_deg=None),), {}, "position_poor", "home is not known"),
        ((position(home_longitude_deg=None),), {}, "position_poor", "home is not known"),
        ((position(),), {"at": (1.0, 1.0, -0.1)}, "point_unusual", "-0.1 m above the start"),
        ((position(),), {"at": (1.0, 1.0, 501.0)}, "point_unusual", "501 m above the start"),
        ((flight(is_flying=True).model_copy(update={"gps_mode": GpsMode.COME_HOME}),), {}, "switch_at_home", "GPS"),
        ((flight(is_flying=False),), {}, "route_on_ground", "it stands"),
        ((flight(is_flying=None),), {}, "route_on_ground", "no recent telemetry"),
    ],
)
def test_what_would_not_be_flown_is_refused_with_the_remedy(values, fields, token, words):
    with pytest.raises(CommandRejectedError) as refusal:
        ask(*values, **fields)
    assert refusal.value.token == token
    assert words in refusal.value.reason
    assert refusal.value.fix
