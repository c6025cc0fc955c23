"""Axes: NED and FRD against ENU and FLU."""

from __future__ import annotations

import math

import pytest

from mkdaemon.gateways.mavlink import frames

HALF = math.sqrt(0.5)


@pytest.mark.parametrize(
    ("quaternion", "turned"),
    [
        ((1.0, 0.0, 0.0, 0.0), (HALF, 0.0, 0.0, HALF)),  # looks east: heading 90
        ((HALF, 0.0, 0.0, HALF), (1.0, 0.0, 0.0, 0.0)),  # looks north
        ((HALF, 0.0, 0.0, -HALF), (0.0, 0.0, 0.0, 1.0)),  # looks south
    ],
)
def test_attitudes(quaternion, turned):
    found = frames.ned_from_frd(quaternion)
    assert abs(sum(a * b for a, b in zip(found, turned, strict=True))) == pytest.approx(1.0)
    assert found[0] >= 0.0


def test_a_roll_to_the_right_stays_one_and_the_top_of_a_print_is_ahead():
    tilt = 0.2
    north = (HALF, 0.0, 0.0, HALF)
    rolled = frames.multiplied(north, (math.cos(tilt / 2), math.sin(tilt / 2), 0.0, 0.0))
    w, x, y, z = frames.ned_from_frd(rolled)
    assert (w, x, y, z) == pytest.approx((math.cos(tilt / 2), math.sin(tilt / 2), 0.0, 0.0))
    flu_from_target = (HALF, 0.0, 0.0, -HALF)  # forward is y of the print
    assert frames.frd_from_local(flu_from_target) == pytest.approx((1.0, 0.0, 0.0, 0.0))


@pytest.mark.parametrize(
    ("yaw", "heading"), [(0.0, 9000), (math.pi / 2, 0), (math.pi, 27000), (-math.pi / 2, 18000), (1.570797, 0)]
)
def test_headings(yaw, heading):
    assert frames.heading_cdeg(yaw) == heading
