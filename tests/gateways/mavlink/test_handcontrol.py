"""Streams of ground stations as setpoints: axes, frames (NED and FRD against ENU and FLU), and what cannot be flown."""

from __future__ import annotations

import math

import pytest
from pymavlink.dialects.v20 import all as mavlink

from mkdaemon.errors import MkError
from mkdaemon.gateways.mavlink import frames
from mkdaemon.gateways.mavlink.handcontrol import (
    attitude_target,
    axes_of_manual,
    axes_of_override,
    local_target,
    speeds,
    sticks,
)
from tests.gateways.mavlink.rig import ESTIMATE

POSITION, VELOCITY = 0b110111111000, 0b110111000111
YAW, YAW_RATE = 0b010000000000, 0b100000000000
LOCAL, OFFSET, BODY = 1, 7, 12
NAN = float("nan")


def target(mask, frame, place=(0, 0, 0), speed=(0, 0, 0), yaw=0.0, rate=0.0):
    return mavlink.MAVLink_set_position_target_local_ned_message(
        0, 1, 1, frame, mask, *place, *speed, 0, 0, 0, yaw, rate
    )


@pytest.mark.parametrize(
    ("message", "kind", "fields"),
    [
        (target(POSITION, LOCAL, (1, 2, -3)), "position", {"position": (2, 1, 3), "frame": "pad", "yaw": None}),
        (target(POSITION & ~YAW, LOCAL, (1, 2, -3), yaw=0.0), "position",
         {"position": (2, 1, 3), "frame": "pad", "yaw": math.pi / 2}),
        (target(POSITION, OFFSET, (1, 2, -3)), "position", {"position": (2.3, 0.8, 5.0), "frame": "pad", "yaw": None}),
        (target(POSITION & ~YAW, BODY, (1, 2, -3), yaw=0.5), "position",
         {"position": (1, -2, 3), "frame": "body", "yaw": -0.5}),
        (target(VELOCITY, LOCAL, speed=(1, 2, -3)), "velocity",
         {"velocity": (2, 1, 3), "frame": "pad", "yaw_rate": 0.0}),
        (target(VELOCITY & ~YAW_RATE, BODY, speed=(1, 2, -3), rate=0.4), "velocity",
         {"velocity": (1, -2, 3), "frame": "body", "yaw_rate": -0.4}),
        (target(VELOCITY & ~YAW, LOCAL, speed=(0, 0, 0), yaw=math.pi / 2 - 0.35), "velocity",
         {"velocity": (0, 0, 0), "frame": "pad", "yaw_rate": 0.1}),
        (target(VELOCITY & ~YAW, LOCAL, yaw=math.pi), "velocity",
         {"velocity": (0, 0, 0), "frame": "pad", "yaw_rate": -0.5}),
        (target(POSITION & VELOCITY, LOCAL, (1, 2, -3), (9, 9, 9)), "position",
         {"position": (2, 1, 3), "frame": "pad", "yaw": None}),
    ],
)  # fmt: skip
def test_local_targets(message, kind, fields):
    found = local_target(message, ESTIMATE)
    assert found.kind == kind
    assert found.fields.keys() == fields.keys()
    for name, wanted in fields.items():
        assert found.fields[name] == (
            pytest.approx(wanted, abs=1e-6) if wanted not in (None, "pad", "body") else wanted
        )


@pytest.mark.parametrize(
    ("message", "word"),
    [
        (target(0b110111111111, LOCAL), "accelerations"),
        (target(POSITION | 1 << 9, LOCAL), "forces"),
        (target(POSITION, 0), "frame 0"),
        (target(VELOCITY, 6), "frame 6"),
        (target(POSITION, LOCAL, (NAN, 0, 0)), "NaN"),
        (target(POSITION & ~YAW, LOCAL, yaw=math.inf), "NaN"),
    ],
)
def test_targets_that_cannot_be_flown(message, word):
    with pytest.raises(MkError, match=word):
        local_target(message, ESTIMATE)


def test_an_offset_needs_a_flight():
    with pytest.raises(MkError, match="needs a flight"):
        local_target(target(POSITION, OFFSET), None)
    assert local_target(target(VELOCITY & ~YAW, LOCAL, yaw=1.0), None).fields["yaw_rate"] == 0.0


def manual(x, y, z, r):
    return mavlink.MAVLink_manual_control_message(1, x, y, z, r, 0)


def test_full_sticks_and_overridden_channels():
    axes = axes_of_manual(manual(1000, -1000, 1000, 500))
    assert sticks(axes).fields == {"pitch": 60.0, "roll": -60.0, "yaw": -30.0, "throttle": 127.0}
    assert speeds(axes).fields == {"velocity": (1.0, 1.0, 0.5), "frame": "body", "yaw_rate": -0.5}
    axes = axes_of_override(override(2000, 1000, 1500, 1250))
    assert sticks(axes).fields == pytest.approx({"pitch": 60.0, "roll": 60.0, "yaw": 30.0, "throttle": 0.0})
    assert axes_of_override(override(0, 65535, 1100, 0)).forward == 0.0
    assert axes_of_override(override(1500, 1500, 0, 1500)) is None
    assert axes_of_override(override(1, 1500, 1500, 1500)) is None


@pytest.mark.parametrize(("z", "throttle"), [(0, -127.0), (500, 0.0), (1000, 127.0), (-1000, -127.0)])
def test_thrust_is_from_nothing_to_full(z, throttle):
    assert sticks(axes_of_manual(manual(0, 0, z, 0))).fields["throttle"] == pytest.approx(throttle)


@pytest.mark.parametrize("axis", range(4))
def test_an_axis_that_is_not_used_flies_nothing(axis):
    parts = [0, 0, 500, 0]
    parts[axis] = 0x7FFF
    assert axes_of_manual(manual(*parts)) is None


def override(*raw):
    return mavlink.MAVLink_rc_channels_override_message(1, 1, *raw, *[0] * (8 - len(raw)))


def attitude(q, thrust, mask=0b11, rate=0.0):
    return mavlink.MAVLink_set_attitude_target_message(0, 1, 1, mask, q, 0, 0, rate, thrust)


def test_attitudes():
    half = 0.1
    rolled = attitude((math.cos(half), math.sin(half), 0, 0), 0.5, rate=0.3)
    assert attitude_target(rolled).fields == pytest.approx({"roll": 0.2, "pitch": 0, "yaw_rate": -0.3, "thrust": 1.0})
    nose_down = attitude((2 * math.cos(half), 0, -2 * math.sin(half), 0), 0.25, mask=0b111)
    assert attitude_target(nose_down).fields == pytest.approx({"roll": 0, "pitch": 0.2, "yaw_rate": 0, "thrust": 0.5})


@pytest.mark.parametrize(
    "message",
    [
        attitude((1, 0, 0, 0), 0.5, mask=0b10000000), attitude((1, 0, 0, 0), 0.5, mask=0b1000000),
        attitude((0, 0, 0, 0), 0.5), attitude((1, 0, 0, 0), NAN), attitude((NAN, 0, 0, 0), 0.5),
        attitude((1, 0, 0, 0), -0.1),
    ],
)  # fmt: skip
def test_attitudes_that_cannot_be_flown(message):
    with pytest.raises(MkError, match="an attitude target"):
        attitude_target(message)


HALF = math.sqrt(0.5)


@pytest.mark.parametrize(
    ("quaternion", "turned"),
    [
        ((1.0, 0.0, 0.0, 0.0), (HALF, 0.0, 0.0, HALF)),  # looks east: heading 90
        ((HALF, 0.0, 0.0, HALF), (1.0, 0.0, 0.0, 0.0)),  # looks north
        ((HALF, 0.0, 0.0, -HALF), (0.0, 0.0, 0.0, 1.0)),  # looks south
    ],
)
def test_quaternions(quaternion, turned):
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
