from __future__ import annotations

from dataclasses import replace

import pytest

from mkdaemon.client.teleop.hands import Function
from mkdaemon.client.teleop.inputs import AxisRange, PadInputs
from mkdaemon.config.gamepad import MOST_TRIM
from tests.client.teleop.pads import FACTS, HIGH, LOW, MIDDLE, TestedPad


@pytest.mark.parametrize(
    ("change", "axis", "sign"),
    [
        ({"ABS_RY": LOW}, "pitch", 1),  # forward: nose down
        ({"ABS_RY": HIGH}, "pitch", -1),
        ({"ABS_RX": HIGH}, "roll", 1),  # right: right side down
        ({"ABS_RX": LOW}, "roll", -1),
        ({"ABS_X": HIGH}, "yaw", -1),  # right: nose right, and FLU counts to the left
        ({"ABS_X": LOW}, "yaw", 1),
    ],
)
def test_signs_of_each_stick(flown: TestedPad, change: dict[str, int], axis: str, sign: int) -> None:
    sticks = flown.sticks(**change)
    assert sticks[axis] == pytest.approx(sign * 30.0, abs=0.01)
    others = {"pitch", "roll", "yaw"} - {axis}
    assert [sticks[other] for other in others] == [0.0, 0.0]


def test_thrust_stick_up_is_more_and_its_middle_is_hover(flown: TestedPad) -> None:
    assert flown.sticks()["throttle"] == -2
    assert flown.sticks(ABS_Y=LOW)["throttle"] == 30
    assert flown.sticks(ABS_Y=HIGH)["throttle"] == -100


def test_rate_expo_and_fine_scale_each_axis() -> None:
    pad = TestedPad(pitch={"rate": 50, "expo": 0, "deadzone": 0}, roll={"rate": 10, "expo": 1, "deadzone": 0})
    pad.fly()
    sticks = pad.sticks(ABS_RY=-16384, ABS_RX=16384)
    assert sticks["pitch"] == pytest.approx(25, abs=0.01)
    assert sticks["roll"] == pytest.approx(1.25, abs=0.01)
    sticks = pad.sticks(BTN_TR=1)
    assert sticks["pitch"] == pytest.approx(25 * 0.35, abs=0.01)
    pad.sticks(BTN_TR=0)
    assert pad.sticks(BTN_TR=1)["pitch"] == pytest.approx(25, abs=0.01)


def test_trim_is_added_in_flight_and_left_out_until_the_daemon_flies() -> None:
    pad = TestedPad(roll={"trim": -3})
    pad.fly()
    for _ in range(2):
        pad.tick(ABS_HAT0Y=-1)
        pad.tick(ABS_HAT0Y=0)
    pad.tick(ABS_HAT0X=1)
    assert pad.sticks(ABS_HAT0X=0) | {"throttle": 0} == {"pitch": 2, "roll": -2, "yaw": 0, "throttle": 0}
    pad.is_engaged = False
    assert pad.sticks()["pitch"] == pad.sticks()["roll"] == 0
    pad.is_engaged = True
    pad.tick(BTN_SELECT=1)
    assert pad.sticks()["roll"] == -3


def test_trim_is_bounded(flown: TestedPad) -> None:
    for _ in range(2 * MOST_TRIM):
        flown.tick(ABS_HAT0X=-1)
        flown.tick(ABS_HAT0X=0)
    assert flown.sticks()["roll"] == -MOST_TRIM


def test_thrust_lock_recentre_and_reset_by_button(flown: TestedPad) -> None:
    up = flown.sticks(ABS_Y=-16384)["throttle"]
    flown.tick(BTN_SOUTH=1)
    assert flown.sticks(ABS_Y=MIDDLE)["throttle"] == up
    flown.tick(BTN_WEST=1)
    assert flown.hands.thrust.hover == up
    flown.tick(BTN_SELECT=1)
    assert flown.hands.thrust.hover == -2
    assert not flown.hands.thrust.is_locked
    assert flown.sticks()["throttle"] == up  # held until the stick has come to it


def test_event_between_two_questions_counts(flown: TestedPad) -> None:
    flown.hands.reported("ABS_RX", HIGH, flown.now + 0.001)
    output = flown.decide(0.002)
    assert output.setpoint is not None
    assert output.setpoint.fields["roll"] == pytest.approx(30)


def test_tap_shorter_than_a_tick_counts(flown: TestedPad) -> None:
    flown.hands.reported("BTN_TR", 1, flown.now + 0.001)
    flown.hands.reported("BTN_TR", 0, flown.now + 0.002)
    flown.decide(0.003)
    assert flown.hands.is_fine


def test_older_stamp_changes_nothing() -> None:
    inputs = PadInputs(FACTS, 0.0)
    inputs.reported("ABS_X", HIGH, 2.0)
    inputs.reported("ABS_X", LOW, 1.0)
    assert inputs.axis("ABS_X") == 1.0
    assert inputs.axis("-ABS_X") == -1.0
    assert inputs.reported_at == 2.0


def test_range_without_extent_says_nothing() -> None:
    assert AxisRange(5, 5).normalise(7) == 0.0
    assert AxisRange(0, 255).normalise(999) == 1.0
    assert AxisRange(0, 255).normalise(-999) == -1.0


def test_unknown_axis_is_the_oldest() -> None:
    inputs = PadInputs(FACTS, 0.0)
    inputs.reported("ABS_X", 0, 1.0)
    assert inputs.oldest(["ABS_X", "-ABS_Y"], 2.0) == ("ABS_Y", float("inf"))
    assert inputs.oldest(["ABS_X"], 2.0) == ("ABS_X", 1.0)


def test_pad_without_a_mapped_control_does_not_fly() -> None:
    facts = replace(FACTS, buttons=FACTS.buttons - {"BTN_TL"})
    pad = TestedPad(facts)
    pad.make_ready()
    output = pad.tick(BTN_TL=1)
    assert output.setpoint is None
    assert "has no BTN_TL" in output.reason
    assert pad.hands.missing == ["BTN_TL"]


def test_state_that_was_never_answered_does_not_fly(pad: TestedPad) -> None:
    pad.hands.reported("BTN_TL", 1, pad.now)
    assert "not answered" in pad.decide(0.01).reason


def test_control_that_was_never_known_stands_in_the_middle_and_is_not_pressed() -> None:
    inputs = PadInputs(FACTS, 0.0)
    assert inputs.axis("ABS_X") == 0.0
    assert not any(inputs.is_pressed(reference) for reference in ("BTN_TL", "ABS_HAT0X+", "ABS_HAT0X-"))


@pytest.mark.parametrize(("raw", "pressed"), [(0.5, ""), (0.51, "+"), (-0.5, ""), (-0.51, "-"), (0.0, "")])
def test_axis_is_a_button_beyond_half_of_its_way(raw: float, pressed: str) -> None:
    inputs = PadInputs(FACTS, 0.0)
    inputs.reported("ABS_HAT0X", raw, 1.0)
    assert [side for side in "+-" if inputs.is_pressed(f"ABS_HAT0X{side}")] == list(pressed)


def test_what_is_reported_before_the_pad_has_answered_counts_for_nothing(pad: TestedPad) -> None:
    pad.hands.reported("ABS_Y", HIGH, pad.now)
    pad.hands.reported("BTN_TR", 1, pad.now)
    pad.tick()
    assert not pad.hands.has_seen_zero
    assert not pad.hands.is_fine
    assert "lowest" in pad.tick(BTN_TL=1).reason


def test_setting_is_done_by_the_pad_and_handed_on_to_nobody(flown: TestedPad) -> None:
    flown.now += 0.02
    flown.ask(BTN_TR=1, BTN_SOUTH=1, ABS_HAT0X=1, BTN_NORTH=1)
    assert flown.hands.take_presses(flown.now) == [Function.HOLD]
    assert flown.hands.is_fine
    assert flown.hands.thrust.is_locked
    assert flown.hands.trims["roll"] == 1.0


def test_reset_ends_small_deflections(flown: TestedPad) -> None:
    flown.tick(BTN_TR=1)
    assert flown.hands.is_fine
    flown.tick(BTN_SELECT=1)
    assert not flown.hands.is_fine


@pytest.mark.parametrize(("forward", "trim", "pitch"), [(LOW, 20, 127), (HIGH, -20, -127)])
def test_deflection_with_its_trim_stays_within_what_a_stick_can_say(forward: int, trim: float, pitch: float) -> None:
    pad = TestedPad(pitch={"rate": 127, "trim": trim})
    pad.fly()
    assert pad.sticks(ABS_RY=forward)["pitch"] == pitch


def test_centred_sticks_are_plain_zeros(flown: TestedPad) -> None:
    sticks = flown.sticks()
    assert [f"{sticks[axis]:+g}" for axis in ("pitch", "roll", "yaw")] == ["+0", "+0", "+0"]
