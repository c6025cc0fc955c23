"""Rotations and projections: named signs by hand, everything else by round trip."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mkdaemon.frames import (
    enu_from_geodetic,
    euler_from_rotation,
    geodetic_from_enu,
    rotation_from_euler,
    rotation_from_quaternion,
)

ANGLE = st.floats(-math.pi, math.pi)
STEEP = st.floats(-math.pi / 2 + 1e-3, math.pi / 2 - 1e-3)
FORWARD, LEFT, UP = np.eye(3)


@pytest.mark.parametrize(
    ("roll", "pitch", "yaw", "body", "world"),
    [
        (0.0, 0.5, 0.0, FORWARD, (math.cos(0.5), 0.0, -math.sin(0.5))),  # nose down
        (0.5, 0.0, 0.0, LEFT, (0.0, math.cos(0.5), math.sin(0.5))),  # right side down lifts the left
        (0.0, 0.0, 0.5, FORWARD, (math.cos(0.5), math.sin(0.5), 0.0)),  # nose left
        (0.0, 0.0, math.pi / 2, FORWARD, (0.0, 1.0, 0.0)),  # yaw of a quarter turn looks north
    ],
)
def test_signs(roll, pitch, yaw, body, world):
    assert rotation_from_euler(roll, pitch, yaw) @ body == pytest.approx(world)


@given(roll=ANGLE, pitch=STEEP, yaw=ANGLE)
def test_euler_round_trip(roll, pitch, yaw):
    rotation = rotation_from_euler(roll, pitch, yaw)
    again = rotation_from_euler(*euler_from_rotation(rotation))
    assert again == pytest.approx(rotation, abs=1e-9)
    assert np.linalg.det(rotation) == pytest.approx(1.0)


@pytest.mark.parametrize("pitch", [math.pi / 2, -math.pi / 2])
def test_euler_at_the_poles_keeps_the_rotation(pitch):
    rotation = rotation_from_euler(0.3, pitch, 0.8)
    assert rotation_from_euler(*euler_from_rotation(rotation)) == pytest.approx(rotation, abs=1e-6)


@given(
    latitude=st.floats(-1.3, 1.3),
    longitude=ANGLE,
    east=st.floats(-1e3, 1e3),
    north=st.floats(-1e3, 1e3),
    up=st.floats(-100, 500),
)
def test_geodetic_round_trip(latitude, longitude, east, north, up):
    origin = (latitude, longitude, 50.0)
    there = geodetic_from_enu(east, north, up, origin)
    assert enu_from_geodetic(*there, origin) == pytest.approx((east, north, up), abs=1e-5)


def test_one_arc_minute_north_is_a_nautical_mile():
    origin = (math.radians(45.0), 0.0, 0.0)
    _, north, _ = enu_from_geodetic(math.radians(45.0 + 1 / 60), 0.0, 0.0, origin)
    assert north == pytest.approx(1852.0, abs=1.0)


def test_a_quaternion_without_length_is_refused():
    with pytest.raises(ValueError, match="length zero"):
        rotation_from_quaternion((0.0, 0.0, 0.0, 0.0))
