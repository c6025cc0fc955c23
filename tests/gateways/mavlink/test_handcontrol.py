"""Streams of ground stations as setpoints: axes, frames (NED and FRD against ENU and FLU), and what cannot be flown."""

from __future__ import annotations

import math

import pytest
from pymavlink.dialects.v20 import all as mavlink

from mkdaemon.errors import MkError
from mkdaemon.gateways.mavlink.handcontrol import (
    attitude_target,
    axes_of_manual,
    axes_of_override,
    local_target,
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


def manual(x=0, y=0, z=500, r=0):
    return mavlink.MAVLink_manual_control_message(1, x, y, z, r, 0)


def override(*raw):
    return mavlink.MAVLink_rc_channels_override_message(1, 1, *raw, *[0] * (8 - len(raw)))


def attitude(q=(1, 0, 0, 0), thrust=0.5, mask=0b11, rate=0.0):
    return mavlink.MAVLink_set_attitude_target_message(0, 1, 1, mask, q, 0, 0, rate, thrust)


def asked(message):
    """What a message asks for; None where it is left out."""
    match message.get_type():
        case "MANUAL_CONTROL":
            axes = axes_of_manual(message)
        case "RC_CHANNELS_OVERRIDE":
            axes = axes_of_override(message)
        case "SET_ATTITUDE_TARGET":
            return attitude_target(message)
        case _:
            return local_target(message, ESTIMATE)
    return axes and sticks(axes)


STILL = {"pitch": 0.0, "roll": 0.0, "yaw": 0.0, "throttle": 0.0}
TILT = 0.1
"""Half of an angle [rad]."""
ASKED = [
    (target(POSITION, LOCAL, (1, 2, -3)), "position", {"position": (2, 1, 3), "frame": "pad", "yaw": None}),
    (target(POSITION & ~YAW, LOCAL, (1, 2, -3), yaw=0.0), "position",
     {"position": (2, 1, 3), "frame": "pad", "yaw": math.pi / 2}),
    (target(POSITION, OFFSET, (1, 2, -3)), "position", {"position": (2.3, 0.8, 5.0), "frame": "pad", "yaw": None}),
    (target(POSITION & ~YAW, BODY, (1, 2, -3), yaw=0.5), "position",
     {"position": (1, -2, 3), "frame": "body", "yaw": -0.5}),
    (target(VELOCITY, LOCAL, speed=(1, 2, -3)), "velocity", {"velocity": (2, 1, 3), "frame": "pad", "yaw_rate": 0.0}),
    (target(VELOCITY & ~YAW_RATE, BODY, speed=(1, 2, -3), rate=0.4), "velocity",
     {"velocity": (1, -2, 3), "frame": "body", "yaw_rate": -0.4}),
    (target(VELOCITY & ~YAW, LOCAL, speed=(0, 0, 0), yaw=math.pi / 2 - 0.35), "velocity",
     {"velocity": (0, 0, 0), "frame": "pad", "yaw_rate": 0.1}),
    (target(VELOCITY & ~YAW, LOCAL, yaw=math.pi), "velocity",
     {"velocity": (0, 0, 0), "frame": "pad", "yaw_rate": -0.5}),
    (target(POSITION & VELOCITY, LOCAL, (1, 2, -3), (9, 9, 9)), "position",
     {"position": (2, 1, 3), "frame": "pad", "yaw": None}),
    (manual(1000, -1000, 1000, 500), "stick", {"pitch": 60.0, "roll": -60.0, "yaw": -30.0, "throttle": 127.0}),
    *((manual(z=z), "stick", STILL | {"throttle": throttle}) for z, throttle in ((0, -127), (500, 0), (-1000, -127))),
    (override(2000, 1000, 1500, 1250), "stick", {"pitch": 60.0, "roll": 60.0, "yaw": 30.0, "throttle": 0.0}),
    (override(0, 65535, 1500, 0), "stick", STILL),
    (attitude((math.cos(TILT), math.sin(TILT), 0, 0), 0.5, rate=0.3), "attitude",
     {"roll": 0.2, "pitch": 0, "yaw_rate": -0.3, "thrust": 1.0}),
    (attitude((2 * math.cos(TILT), 0, -2 * math.sin(TILT), 0), 0.25, mask=0b111), "attitude",
     {"roll": 0, "pitch": 0.2, "yaw_rate": 0, "thrust": 0.5}),
]  # fmt: skip


@pytest.mark.parametrize(("message", "kind", "fields"), ASKED)
def test_what_a_message_asks_for(message, kind, fields):
    found = asked(message)
    assert (found.kind, found.fields.keys()) == (kind, fields.keys())
    for name, wanted in fields.items():
        assert found.fields[name] == (wanted if isinstance(wanted, str | None) else pytest.approx(wanted, abs=1e-6))


@pytest.mark.parametrize(
    "message",
    [*(manual(**{axis: 0x7FFF}) for axis in "xyzr"), override(1500, 1500, 0, 1500), override(1, 1500, 1500, 1500)],
)
def test_an_axis_that_is_not_used_flies_nothing(message):
    assert asked(message) is None


@pytest.mark.parametrize(
    ("message", "word"),
    [
        (target(0b110111111111, LOCAL), "accelerations"),
        (target(POSITION | 1 << 9, LOCAL), "forces"),
        (target(POSITION, 0), "frame 0"),
        (target(VELOCITY, 6), "frame 6"),
        (target(POSITION, LOCAL, (NAN, 0, 0)), "NaN"),
        (target(POSITION & ~YAW, LOCAL, yaw=math.inf), "NaN"),
        *((attitude(mask=mask), "an attitude target") for mask in (0b10000000, 0b1000000)),
        *((attitude(q), "an attitude target") for q in ((0, 0, 0, 0), (NAN, 0, 0, 0))),
        *((attitude(thrust=thrust), "an attitude target") for thrust in (NAN, -0.1)),
    ],
)
def test_what_cannot_be_flown_is_refused(message, word):
    with pytest.raises(MkError, match=word):
        asked(message)


def test_an_offset_needs_a_flight():
    with pytest.raises(MkError, match="needs a flight"):
        local_target(target(POSITION, OFFSET), None)
    assert local_target(target(VELOCITY & ~YAW, LOCAL, yaw=1.0), None).fields["yaw_rate"] == 0.0
