from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mkdaemon.client.teleop.shaping import AxisNames, Thrust, shape
from mkdaemon.config.gamepad import ThrustSection
from tests.client.teleop.pads import gamepad

SHARES = st.floats(-1.0, 1.0)
CFG = ThrustSection(lowest=-100, hover=0, highest=50, expo=0, deadzone=0)


@given(SHARES, st.floats(0.0, 0.5), st.floats(0.0, 1.0))
def test_shape_is_odd_bounded_and_reaches_its_end(position: float, deadzone: float, expo: float) -> None:
    value = shape(position, deadzone=deadzone, expo=expo)
    assert abs(value) <= 1.0 + 1e-9
    assert shape(-position, deadzone=deadzone, expo=expo) == pytest.approx(-value)
    assert shape(1.0, deadzone=deadzone, expo=expo) == pytest.approx(1.0)
    assert value * position >= 0.0


@given(SHARES, SHARES, st.floats(0.0, 0.5), st.floats(0.0, 1.0))
def test_shape_grows_with_the_stick(a: float, b: float, deadzone: float, expo: float) -> None:
    low, high = sorted((a, b))
    assert shape(low, deadzone=deadzone, expo=expo) <= shape(high, deadzone=deadzone, expo=expo) + 1e-12


def test_expo_softens_the_middle_and_dead_zone_is_zero() -> None:
    assert shape(0.5, deadzone=0.0, expo=0.0) == pytest.approx(0.5)
    assert shape(0.5, deadzone=0.0, expo=1.0) == pytest.approx(0.125)
    assert shape(0.07, deadzone=0.08, expo=0.3) == 0.0


@pytest.mark.parametrize(
    ("mode", "names"),
    [
        (1, AxisNames("-ABS_Y", "ABS_RX", "ABS_X", "-ABS_RY")),
        (2, AxisNames("-ABS_RY", "ABS_RX", "ABS_X", "-ABS_Y")),
        (3, AxisNames("-ABS_Y", "ABS_X", "ABS_RX", "-ABS_RY")),
        (4, AxisNames("-ABS_RY", "ABS_X", "ABS_RX", "-ABS_Y")),
    ],
)
def test_stick_modes_are_those_of_radio_control(mode: int, names: AxisNames) -> None:
    assert AxisNames.of(gamepad(mode=mode)) == names


def test_channels_have_their_own_meaning_in_every_mode() -> None:
    channels = {"aileron": "ABS_X", "elevator": "ABS_Y", "throttle": "ABS_Z", "rudder": "ABS_RX"}
    names = AxisNames.of(gamepad(sticks=None, channels=channels, mode=1, buttons={"enable": "BTN_0"}))
    assert names == AxisNames("ABS_Y", "ABS_X", "ABS_RX", "ABS_Z")


def test_thrust_stick_reaches_lowest_hover_and_highest() -> None:
    thrust = Thrust(CFG)
    assert [thrust.move(position) for position in (-1.0, -0.96, 0.0, 0.475, 1.0)] == [-100, -100, 0, 25, 50]


def test_locked_thrust_stays_and_is_taken_up_where_the_stick_meets_it() -> None:
    thrust = Thrust(CFG)
    assert thrust.move(0.475) == 25
    thrust.toggle_lock()
    assert [thrust.move(position) for position in (-1.0, 0.0, 1.0)] == [25, 25, 25]
    thrust.toggle_lock()
    assert thrust.move(0.0) == 25
    assert thrust.move(0.2) == 25
    assert thrust.move(0.46) == pytest.approx(24.2, abs=0.1)
    assert thrust.move(0.0) == 0


def test_thrust_is_taken_up_also_when_the_stick_jumps_across_it() -> None:
    thrust = Thrust(CFG)
    thrust.move(0.475)
    thrust.hold()
    assert thrust.move(0.0) == 25
    assert thrust.move(0.95) == 50


def test_recentred_hover_is_what_the_middle_asks_for() -> None:
    thrust = Thrust(CFG)
    thrust.move(0.19)
    thrust.recentre()
    assert thrust.hover == 10
    assert thrust.move(0.95) == 10  # the stick has to come to the held thrust first
    assert thrust.move(0.0) == 10
    assert thrust.move(0.475) == 30
    thrust.reset()
    assert (thrust.hover, thrust.value, thrust.is_waiting) == (0, 30, True)


@pytest.mark.parametrize(("position", "hover"), [(-1.0, -99), (1.0, 49)])
def test_middle_moved_to_an_end_leaves_a_way_on_both_sides(position: float, hover: float) -> None:
    thrust = Thrust(CFG)
    thrust.move(position)
    thrust.recentre()
    assert thrust.hover == hover


def test_locked_thrust_waits_for_no_stick() -> None:
    thrust = Thrust(CFG)
    thrust.toggle_lock()
    assert not thrust.is_waiting
    thrust.toggle_lock()
    assert thrust.is_waiting


def test_thrust_held_anew_on_the_other_side_of_the_stick_does_not_jump() -> None:
    thrust = Thrust(CFG)
    thrust.move(0.475)
    thrust.hold(-50)
    assert thrust.move(0.475) == -50  # the stick stands above
    thrust.hold(40)
    assert thrust.move(0.475) == 40  # and now below
    assert thrust.move(0.0) == 40
