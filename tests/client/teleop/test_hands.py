"""What one pad asks for: sticks, trims, thrust by button, and what of its state can be believed."""

from __future__ import annotations

from dataclasses import replace

import pytest

from mkdaemon.client.teleop.hands import Function
from mkdaemon.client.teleop.inputs import AxisRange, PadInputs
from mkdaemon.config.gamepad import MOST_TRIM
from tests.client.teleop.pads import FACTS, HIGH, LOW, MIDDLE, TestedPad, flown_pad

CENTRED = {"pitch": 0.0, "roll": 0.0, "yaw": 0.0, "throttle": -2}
EVEN = {"expo": 0, "deadzone": 0}


@pytest.mark.parametrize(
    ("change", "asked"),
    [
        ({}, {}),
        ({"ABS_RY": LOW}, {"pitch": 30}),  # forward: nose down
        ({"ABS_RY": HIGH}, {"pitch": -30}),
        ({"ABS_RX": HIGH}, {"roll": 30}),  # right: right side down
        ({"ABS_RX": LOW}, {"roll": -30}),
        ({"ABS_X": HIGH}, {"yaw": -30}),  # right: nose right, and FLU counts to the left
        ({"ABS_X": LOW}, {"yaw": 30}),
        ({"ABS_Y": LOW}, {"throttle": 30}),  # up is more, and the middle is hover
        ({"ABS_Y": HIGH}, {"throttle": -100}),
    ],
)
def test_signs_of_each_stick(flown, change, asked):
    sticks = flown.sticks(**change)
    assert sticks == pytest.approx(CENTRED | asked, abs=0.01)
    assert "-0" not in [f"{sticks[axis]:g}" for axis in ("pitch", "roll", "yaw")], "a centred stick is a plain zero"


def test_rate_expo_and_fine_scale_each_axis():
    pad = flown_pad(pitch={"rate": 50, **EVEN}, roll={"rate": 10, **EVEN, "expo": 1})
    sticks = pad.sticks(ABS_RY=-16384, ABS_RX=16384)
    assert (sticks["pitch"], sticks["roll"]) == pytest.approx((25, 1.25), abs=0.01)
    assert pad.sticks(BTN_TR=1)["pitch"] == pytest.approx(25 * 0.35, abs=0.01)
    pad.sticks(BTN_TR=0)
    assert pad.sticks(BTN_TR=1)["pitch"] == pytest.approx(25, abs=0.01)


def test_trim_is_added_in_flight_and_left_out_until_the_daemon_flies():
    pad = flown_pad(roll={"trim": -3})
    for change in (*[{"ABS_HAT0Y": -1}, {"ABS_HAT0Y": 0}] * 2, {"ABS_HAT0X": 1}):
        pad.tick(**change)
    assert pad.sticks(ABS_HAT0X=0) == CENTRED | {"pitch": 2, "roll": -2}
    pad.is_engaged = False
    assert pad.sticks() == CENTRED
    pad.is_engaged = True
    pad.tick(BTN_SELECT=1)
    assert pad.sticks()["roll"] == -3


def test_trim_is_bounded(flown):
    for _ in range(2 * MOST_TRIM):
        flown.tick(ABS_HAT0X=-1)
        flown.tick(ABS_HAT0X=0)
    assert flown.sticks()["roll"] == -MOST_TRIM


def test_thrust_lock_recentre_and_reset_by_button(flown):
    up = flown.sticks(ABS_Y=-16384, BTN_TR=1)["throttle"]
    flown.tick(BTN_SOUTH=1)
    assert flown.sticks(ABS_Y=MIDDLE)["throttle"] == up
    flown.tick(BTN_WEST=1)
    assert flown.hands.thrust.hover == up and flown.hands.is_fine
    flown.tick(BTN_SELECT=1)
    assert flown.hands.thrust.hover == -2
    assert not flown.hands.thrust.is_locked and not flown.hands.is_fine
    assert flown.sticks()["throttle"] == up  # held until the stick has come to it


def test_what_happens_between_two_questions_counts(flown):
    flown.hands.reported("ABS_RX", HIGH, flown.now + 0.001)
    assert flown.decide(0.001).setpoint.fields["roll"] == pytest.approx(30)
    flown.hands.reported("BTN_TR", 1, flown.now + 0.001)  # a tap that is shorter than a tick
    flown.hands.reported("BTN_TR", 0, flown.now + 0.002)
    flown.decide(0.003)
    assert flown.hands.is_fine


def test_older_stamp_changes_nothing_and_an_unknown_axis_is_the_oldest():
    inputs = PadInputs(FACTS, 0.0)
    assert inputs.axis("ABS_X") == 0.0, "it stands in the middle until it is known"
    assert not any(inputs.is_pressed(reference) for reference in ("BTN_TL", "ABS_HAT0X+", "ABS_HAT0X-"))
    inputs.reported("ABS_X", HIGH, 2.0)
    inputs.reported("ABS_X", LOW, 1.0)
    assert (inputs.axis("ABS_X"), inputs.axis("-ABS_X"), inputs.reported_at) == (1.0, -1.0, 2.0)
    assert inputs.oldest(["ABS_X", "-ABS_Y"], 3.0) == ("ABS_Y", float("inf"))
    assert inputs.oldest(["ABS_X"], 3.0) == ("ABS_X", 1.0)


@pytest.mark.parametrize(("low", "high", "raw", "share"), [(5, 5, 7, 0.0), (0, 255, 999, 1.0), (0, 255, -999, -1.0)])
def test_a_range_gives_a_share_of_its_way(low, high, raw, share):
    assert AxisRange(low, high).normalise(raw) == share


def test_pad_without_a_mapped_control_does_not_fly():
    pad = TestedPad(replace(FACTS, buttons=FACTS.buttons - {"BTN_TL"}))
    pad.make_ready()
    output = pad.tick(BTN_TL=1)
    assert output.setpoint is None
    assert "has no BTN_TL" in output.reason
    assert pad.hands.missing == ["BTN_TL"]


@pytest.mark.parametrize(("raw", "pressed"), [(0.5, ""), (0.51, "+"), (-0.5, ""), (-0.51, "-"), (0.0, "")])
def test_axis_is_a_button_beyond_half_of_its_way(raw, pressed):
    inputs = PadInputs(FACTS, 0.0)
    inputs.reported("ABS_HAT0X", raw, 1.0)
    assert [side for side in "+-" if inputs.is_pressed(f"ABS_HAT0X{side}")] == list(pressed)


def test_what_is_reported_before_the_pad_has_answered_counts_for_nothing(pad):
    for control, raw in (("BTN_TL", 1), ("ABS_Y", HIGH), ("BTN_TR", 1)):
        pad.hands.reported(control, raw, pad.now)
    assert "not answered" in pad.decide(0.01).reason
    pad.tick(BTN_TL=0)
    assert not pad.hands.has_seen_zero
    assert not pad.hands.is_fine
    assert "lowest" in pad.tick(BTN_TL=1).reason


def test_setting_is_done_by_the_pad_and_handed_on_to_nobody(flown):
    flown.now += 0.02
    flown.ask(BTN_TR=1, BTN_SOUTH=1, ABS_HAT0X=1, BTN_NORTH=1)
    assert flown.hands.take_presses(flown.now) == [Function.HOLD]
    assert (flown.hands.is_fine, flown.hands.thrust.is_locked, flown.hands.trims["roll"]) == (True, True, 1.0)


@pytest.mark.parametrize(("forward", "trim", "pitch"), [(LOW, 20, 127), (HIGH, -20, -127)])
def test_deflection_with_its_trim_stays_within_what_a_stick_can_say(forward, trim, pitch):
    assert flown_pad(pitch={"rate": 127, "trim": trim}).sticks(ABS_RY=forward)["pitch"] == pitch
