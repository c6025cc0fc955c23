from __future__ import annotations

from dataclasses import replace

import pytest

from mkdaemon.client.teleop.hands import AXIS_AGE, QUIET
from mkdaemon.client.teleop.teleop import RELEASE_AFTER, Teleop, TeleopOutput
from tests.client.teleop.pads import FACTS, HIGH, LOW, MIDDLE, TestedPad


def kind(output: TeleopOutput) -> str | None:
    return None if output.setpoint is None else output.setpoint.kind


def test_nothing_is_sent_without_a_pad() -> None:
    output = Teleop().tick(1.0, is_engaged=False)
    assert (output.setpoint, output.let_go) == (None, False)
    assert "plug one in" in output.reason


def test_enable_button_flies_only_after_zero_thrust_was_seen(pad: TestedPad) -> None:
    pad.tick()
    assert "lowest" in pad.tick(BTN_TL=1).reason
    assert pad.tick(ABS_Y=HIGH).setpoint is None
    assert "press it again" in pad.tick(ABS_Y=MIDDLE).reason
    assert "hold BTN_TL" in pad.tick(BTN_TL=0).reason
    assert kind(pad.tick(BTN_TL=1)) == "stick"


def test_enable_button_that_is_pressed_at_the_start_counts_for_nothing_until_let_go(pad: TestedPad) -> None:
    pad.tick(BTN_TL=1)
    pad.tick(ABS_Y=HIGH)
    for _ in range(100):
        output = pad.tick(ABS_Y=MIDDLE)
        assert output.setpoint is None
        assert "pressed at the start" in output.reason
    assert pad.hands.stuck == ["BTN_TL"]
    pad.tick(BTN_TL=0)
    assert kind(pad.tick(BTN_TL=1)) == "stick"


@pytest.mark.parametrize("function", ["BTN_START", "BTN_NORTH", "BTN_EAST", "BTN_MODE"])
def test_verb_that_is_pressed_at_the_start_does_nothing(pad: TestedPad, function: str) -> None:
    pad.tick(**{function: 1})
    pad.fly()
    outputs = [pad.tick() for _ in range(80)]
    assert {kind(output) for output in outputs} == {"stick"}
    assert not any(output.stop_motors or output.let_go for output in outputs)


def test_letting_go_of_the_enable_button_is_neutral_at_once_and_a_release_later(flown: TestedPad) -> None:
    flown.tick(ABS_RX=HIGH)
    let_go_at = flown.now
    output = flown.tick(BTN_TL=0)
    assert output.is_neutral
    while not output.let_go:
        assert output.setpoint is not None
        assert [output.setpoint.fields[axis] for axis in ("pitch", "roll", "yaw")] == [0, 0, 0]
        output = flown.tick()
    assert output.setpoint is None
    assert flown.now - let_go_at == pytest.approx(RELEASE_AFTER, abs=0.021)
    assert flown.tick().setpoint is None


def test_enable_button_pressed_again_in_time_flies_on(flown: TestedPad) -> None:
    flown.tick(BTN_TL=0)
    flown.tick(0.5)
    assert not flown.tick(BTN_TL=1).is_neutral


def test_frozen_pad_is_neutral_then_released_and_thrust_is_not_above_hover(flown: TestedPad) -> None:
    assert flown.sticks(ABS_Y=LOW, ABS_RY=LOW)["throttle"] == 30
    frozen = flown.now
    assert not flown.decide(0.24).is_neutral
    output = flown.decide(0.02)
    assert output.is_neutral
    assert output.setpoint is not None
    assert dict(output.setpoint.fields) == {"pitch": 0, "roll": 0, "yaw": 0, "throttle": -2}
    while not output.let_go:
        output = flown.decide(0.02)
    assert flown.now - frozen <= RELEASE_AFTER + 0.021


def test_one_axis_that_is_not_answered_counts_as_lost(flown: TestedPad) -> None:
    del flown.state["ABS_RX"]
    outputs = [flown.tick() for _ in range(14)]
    assert outputs[-1].is_neutral
    assert "ABS_RX" in outputs[-1].reason


def test_unplugged_pad_lets_go_at_the_next_decision(flown: TestedPad) -> None:
    flown.teleop.detach("pad", "the pad was unplugged")
    output = flown.decide()
    assert (output.let_go, output.setpoint, output.reason) == (True, None, "the pad was unplugged")
    assert not flown.decide().let_go


def test_replugged_pad_needs_zero_thrust_and_the_enable_button_again() -> None:
    first = TestedPad()
    first.fly()
    first.teleop.detach("pad", "unplugged")
    first.decide()
    again = TestedPad(teleop=first.teleop)
    again.now = first.now
    assert again.tick(BTN_TL=1).setpoint is None
    again.tick(BTN_TL=0)
    assert "lowest" in again.tick(BTN_TL=1).reason


def test_second_pad_flies_nothing_while_the_first_does() -> None:
    first = TestedPad()
    second = TestedPad(teleop=first.teleop, name="second")
    second.ask()
    first.fly()
    for number in range(50):
        second.now = first.now
        second.ask(BTN_TL=1, ABS_RX=HIGH, ABS_Y=HIGH if number % 2 else LOW)
        assert first.sticks()["roll"] == 0.0
    first.teleop.detach("pad", "unplugged")
    second.now = first.now
    assert second.decide().let_go
    assert second.tick().setpoint is None


def test_release_on_any_pad_lets_go() -> None:
    first = TestedPad()
    second = TestedPad(teleop=first.teleop, name="second")
    second.ask()
    first.fly()
    second.now = first.now
    second.ask(BTN_EAST=1)
    output = first.tick()
    assert output.let_go
    assert "release pressed" in output.reason
    assert first.tick().setpoint is None


def test_pad_detached_without_flying_lets_go_of_nothing() -> None:
    first = TestedPad()
    second = TestedPad(teleop=first.teleop, name="second")
    second.ask()
    first.fly()
    first.teleop.detach("second", "unplugged")
    assert list(first.teleop.hands) == ["pad"]
    assert kind(first.tick()) == "stick"


def test_ended_lease_needs_the_enable_button_anew(flown: TestedPad) -> None:
    flown.teleop.ended("somebody took the lease")
    output = flown.tick()
    assert output.setpoint is None
    assert output.reason.startswith("somebody took the lease; release")
    flown.tick(BTN_TL=0)
    assert kind(flown.tick(BTN_TL=1)) == "stick"


def test_known_ground_wants_the_thrust_stick_at_its_lowest(pad: TestedPad) -> None:
    pad.is_on_ground = True
    pad.make_ready()
    assert "aircraft stands" in pad.tick(BTN_TL=1).reason
    pad.tick(BTN_TL=0, ABS_Y=HIGH)
    assert pad.sticks(BTN_TL=1)["throttle"] == -100


@pytest.mark.parametrize(
    ("change", "name", "seconds"),
    [({"BTN_START": 1}, "takeoff", 0.5), ({"ABS_Z": 255}, "land", 0.5), ({"BTN_NORTH": 1}, "hold", 0.0)],
)
def test_manoeuvre_begins_when_its_button_was_held_long_enough(
    change: dict[str, float], name: str, seconds: float
) -> None:
    pad = TestedPad(takeoff_height=2)
    pad.fly()
    began = pad.now + 0.02
    output = pad.tick(**change)
    while kind(output) == "stick":
        output = pad.tick()
    assert kind(output) == name
    assert pad.now - began == pytest.approx(seconds, abs=0.021)
    assert output.setpoint is not None
    assert dict(output.setpoint.fields) == ({"height": 2} if name == "takeoff" else {})
    assert kind(pad.tick(BTN_START=0, ABS_Z=0, BTN_NORTH=0)) == name


def test_short_press_takes_nothing_off(flown: TestedPad) -> None:
    flown.tick(BTN_START=1)
    flown.tick(0.3, BTN_START=0)
    assert kind(flown.tick(0.2)) == "stick"


def test_letting_go_during_a_manoeuvre_is_neutral_at_hover_thrust(pad: TestedPad) -> None:
    pad.make_ready()
    pad.tick(ABS_Y=HIGH)
    pad.tick(BTN_TL=1)
    pad.tick(BTN_NORTH=1)
    output = pad.tick(BTN_TL=0)
    assert output.is_neutral
    assert output.setpoint is not None
    assert output.setpoint.fields["throttle"] == -2


@pytest.mark.parametrize("flying", [True, False])
def test_stop_is_asked_for_once_after_a_long_press(pad: TestedPad, flying: bool) -> None:
    pad.fly() if flying else pad.make_ready()
    outputs = [pad.tick(BTN_MODE=1) for _ in range(100)]
    assert [output.stop_motors for output in outputs].count(True) == 1
    assert not any(output.stop_motors for output in outputs[:49])


def test_pad_by_radio_that_reports_nothing_with_a_deflected_stick_is_lost() -> None:
    pad = TestedPad(replace(FACTS, is_wireless=True))
    pad.fly()
    pad.hands.reported("ABS_RX", HIGH, pad.now)
    pad.state["ABS_RX"] = HIGH
    outputs = [pad.tick() for _ in range(150)]
    assert not any(output.is_neutral for output in outputs[:99])
    assert any(output.is_neutral for output in outputs)
    assert any(output.let_go and "out of reach" in output.reason for output in outputs)


def test_pad_by_radio_may_be_silent_with_its_sticks_in_the_middle() -> None:
    pad = TestedPad(replace(FACTS, is_wireless=True))
    pad.fly()
    assert not any(pad.tick().is_neutral for _ in range(500))


def test_quiet_time_of_the_mapping_counts_by_cable_too() -> None:
    pad = TestedPad(quiet_after=0.5)
    pad.fly()
    outputs = [pad.tick(ABS_RX=HIGH) for _ in range(30)]
    assert outputs[-1].is_neutral


def test_pad_by_radio_that_reports_nothing_has_no_thrust_above_hover() -> None:
    pad = TestedPad(replace(FACTS, is_wireless=True))
    pad.fly()
    pad.hands.reported("ABS_RX", HIGH, pad.now)
    pad.state |= {"ABS_RX": HIGH, "ABS_Y": LOW}
    outputs = [pad.tick() for _ in range(110)]
    assert outputs[0].setpoint is not None
    assert outputs[0].setpoint.fields["throttle"] == 30
    assert outputs[-1].is_neutral
    assert outputs[-1].setpoint is not None
    assert outputs[-1].setpoint.fields["throttle"] == -2


def test_who_lets_go_of_the_enable_button_keeps_the_thrust_of_his_stick(flown: TestedPad) -> None:
    assert flown.sticks(ABS_Y=LOW)["throttle"] == 30
    output = flown.tick(BTN_TL=0)
    assert output.is_neutral
    assert output.setpoint is not None
    assert output.setpoint.fields["throttle"] == 30


def test_enable_button_that_was_only_tapped_flies_nothing(pad: TestedPad) -> None:
    pad.make_ready()
    pad.now += 2.0
    pad.ask()
    pad.hands.reported("BTN_TL", 1, pad.now)
    pad.hands.reported("BTN_TL", 0, pad.now)
    assert pad.decide().setpoint is None
    assert pad.tick().setpoint is None


def test_manoeuvre_goes_on_while_somebody_asks_for_the_motors_to_stop(flown: TestedPad) -> None:
    flown.tick(BTN_NORTH=1)
    outputs = [flown.tick(BTN_MODE=1) for _ in range(60)]
    assert {kind(output) for output in outputs} == {"hold"}
    assert [output.stop_motors for output in outputs].count(True) == 1


def test_refusal_while_nobody_flies_changes_nothing(pad: TestedPad) -> None:
    pad.make_ready()
    pad.teleop.refused()
    assert kind(pad.tick(BTN_TL=1)) == "stick"


def test_button_held_for_just_its_time_counts_and_an_axis_just_so_old_is_still_known(flown: TestedPad) -> None:
    flown.now = 16.0  # a float holds this moment, and those a quarter of a second later, exactly
    flown.ask(BTN_START=1)
    assert kind(flown.decide()) == "stick"
    assert not flown.decide(0.25).is_neutral
    assert kind(flown.tick(0.25)) == "takeoff"


LINEAR = {"deadzone": 0.0, "expo": 0.0}


@pytest.mark.parametrize("axis", ["ABS_RX", "ABS_RY", "ABS_X", "ABS_Y"])
@pytest.mark.parametrize("way", [1, -1])
def test_stick_takes_over_from_a_manoeuvre_beyond_a_quarter_of_its_way(axis: str, way: int) -> None:
    pad = TestedPad(pitch=LINEAR, roll=LINEAR, yaw=LINEAR)
    pad.fly()
    assert kind(pad.tick(BTN_NORTH=1)) == "hold"
    assert kind(pad.tick(BTN_NORTH=0, **{axis: round(0.24 * way * HIGH)})) == "hold"
    output = pad.tick(**{axis: round(0.26 * way * HIGH)})
    assert kind(output) == "stick"
    assert output.setpoint is not None
    assert output.setpoint.fields["throttle"] == -2, "hover, until the thrust stick has come to it"
    assert pad.teleop.manoeuvre is None


def test_pad_by_radio_with_a_hardly_deflected_stick_may_be_silent() -> None:
    pad = TestedPad(replace(FACTS, is_wireless=True), roll=LINEAR)
    pad.fly()
    position = round(0.24 * HIGH)
    assert not any(pad.tick(ABS_RX=position).is_neutral for _ in range(110))
    assert pad.tick(ABS_RX=round(0.26 * HIGH)).is_neutral, "nothing was reported for two seconds"


def test_figures_that_docs_teleop_tells() -> None:
    assert RELEASE_AFTER == 0.9, "the daemon would do it after 1.0 s"
    assert (AXIS_AGE, QUIET) == (0.25, 2.0), "an axis that is not known any more; a pad by radio that says nothing"
    assert AXIS_AGE + 0.1 <= 0.35, "neutral sticks reach the wire within 350 ms"
