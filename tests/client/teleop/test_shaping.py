"""From the way of a stick to what is asked for: dead zone, expo, stick modes, and the thrust stick."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mkdaemon.client.teleop.shaping import AxisNames, Thrust, shape
from mkdaemon.config.gamepad import ThrustSection
from tests.client.teleop.pads import gamepad

SHARES = st.floats(-1.0, 1.0)
CFG = ThrustSection(lowest=-100, hover=0, highest=50, expo=0, deadzone=0)


@given(SHARES, SHARES, st.floats(0.0, 0.5), st.floats(0.0, 1.0))
def test_shape_is_odd_bounded_grows_with_the_stick_and_reaches_its_end(one, other, deadzone, expo):
    low, high = (shape(share, deadzone=deadzone, expo=expo) for share in sorted((one, other)))
    assert low <= high + 1e-12
    value = shape(one, deadzone=deadzone, expo=expo)
    assert abs(value) <= 1.0 + 1e-9
    assert value * one >= 0.0
    assert shape(-one, deadzone=deadzone, expo=expo) == pytest.approx(-value)
    assert shape(1.0, deadzone=deadzone, expo=expo) == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("share", "deadzone", "expo", "shaped"), [(0.5, 0.0, 0.0, 0.5), (0.5, 0.0, 1.0, 0.125), (0.07, 0.08, 0.3, 0.0)]
)
def test_expo_softens_the_middle_and_dead_zone_is_zero(share, deadzone, expo, shaped):
    assert shape(share, deadzone=deadzone, expo=expo) == pytest.approx(shaped)


CHANNELS = {"aileron": "ABS_X", "elevator": "ABS_Y", "throttle": "ABS_Z", "rudder": "ABS_RX"}


@pytest.mark.parametrize(
    ("fields", "names"),
    [
        ({"mode": 1}, AxisNames("-ABS_Y", "ABS_RX", "ABS_X", "-ABS_RY")),
        ({"mode": 2}, AxisNames("-ABS_RY", "ABS_RX", "ABS_X", "-ABS_Y")),
        ({"mode": 3}, AxisNames("-ABS_Y", "ABS_X", "ABS_RX", "-ABS_RY")),
        ({"mode": 4}, AxisNames("-ABS_RY", "ABS_X", "ABS_RX", "-ABS_Y")),
        (
            {"sticks": None, "channels": CHANNELS, "mode": 1, "buttons": {"enable": "BTN_0"}},
            AxisNames("ABS_Y", "ABS_X", "ABS_RX", "ABS_Z"),
        ),
    ],
    ids=["mode 1", "mode 2", "mode 3", "mode 4", "channels"],
)
def test_stick_modes_are_those_of_radio_control_and_channels_have_their_own_meaning_in_every_mode(fields, names):
    assert AxisNames.of(gamepad(**fields)) == names


HOLD, LOCK = Thrust.hold, Thrust.toggle_lock


@pytest.mark.parametrize(
    "steps",
    [
        [(-1.0, -100), (-0.96, -100), (0.0, 0), (0.475, 25), (1.0, 50)],
        [(0.475, 25), LOCK, (-1.0, 25), (0.0, 25), (1.0, 25), LOCK, (0.0, 25), (0.2, 25), (0.46, 24.2), (0.0, 0)],
        [(0.475, 25), HOLD, (0.0, 25), (0.95, 50)],
        [(0.19, 10), Thrust.recentre, (0.95, 10), (0.0, 10), (0.475, 30)],
        [(0.475, 25), lambda thrust: thrust.hold(-50), (0.475, -50), lambda thrust: thrust.hold(40), (0.475, 40),
         (0.0, 40)],
    ],
    ids=["its ends and hover", "locked, then met again", "held, and the stick jumps across it",
         "recentred: the stick has to come to it first", "held anew on the other side of the stick: no jump"],
)  # fmt: skip
def test_thrust_follows_its_stick_or_is_held_until_the_stick_has_come_to_it(steps):
    thrust = Thrust(CFG)
    for step in steps:
        if callable(step):
            step(thrust)
        else:
            assert thrust.move(step[0]) == pytest.approx(step[1], abs=0.1)


@pytest.mark.parametrize(("position", "hover"), [(0.19, 10), (-1.0, -99), (1.0, 49)])
def test_recentred_hover_is_what_the_middle_asks_for_with_a_way_on_both_sides(position, hover):
    thrust = Thrust(CFG)
    thrust.move(position)
    thrust.recentre()
    assert thrust.hover == hover
    for passed in (-1.0, 1.0, 0.5):
        held = thrust.move(passed)
    assert not thrust.is_waiting
    thrust.reset()
    assert (thrust.hover, thrust.value, thrust.is_waiting) == (0, held, True)


def test_locked_thrust_waits_for_no_stick():
    thrust = Thrust(CFG)
    thrust.toggle_lock()
    assert not thrust.is_waiting
    thrust.toggle_lock()
    assert thrust.is_waiting
