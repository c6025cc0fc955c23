"""The place that a target at home means; what refuses it is asked in `tests/control/admission/test_navirows.py`."""

from __future__ import annotations

import math

import pytest

from mkdaemon.daemon.procedures.table import PROCEDURES
from mkdaemon.frames import enu_from_geodetic
from mkdaemon.telemetry.navi import NaviGotoRequest
from mkdaemon.telemetry.state import Position
from tests.control.events import STAMP

HOME = (53.0, 8.0)


def test_the_place_is_so_far_from_home():
    known = Position(
        stamp=STAMP, source="nc/osd", latitude_deg=53.0001, longitude_deg=8.0, altitude=None, altitude_above_start=3.0,
        home_latitude_deg=HOME[0], home_longitude_deg=HOME[1], home_distance=11.0, position_enu=None,
    )  # fmt: skip
    request = NaviGotoRequest(position=(30.0, -20.0, 5.0), confirm=True, heading_deg=90, hold=20, radius=4)
    point = PROCEDURES["navi_goto"].prepare(request, known)
    place = (math.radians(point.latitude_deg), math.radians(point.longitude_deg), point.altitude)
    home = (math.radians(HOME[0]), math.radians(HOME[1]), 0.0)
    assert enu_from_geodetic(*place, home) == pytest.approx((30.0, -20.0, 5.0), abs=0.02)
    assert (point.heading_deg, point.hold, point.radius) == (90, 20, 4)
