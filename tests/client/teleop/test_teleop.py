"""Who flies: the enable button, pads that are lost or let go of, manoeuvres by button."""

from __future__ import annotations

from dataclasses import replace

import pytest

from mkdaemon.client.teleop.teleop import Teleop
from tests.client.teleop.pads import FACTS, HIGH, LOW, MIDDLE, TestedPad, flown_pad, kind

LINEAR = {"deadzone": 0.0, "expo": 0.0}
KINDS = {"stick", "neutral", "hold", "takeoff", "land"}
AT_START = "BTN_TL was pressed at the start"


def test_nothing_is_sent_without_a_pad():
    output = Teleop().tick(1.0, is_engaged=False)
    assert (output.setpoint, output.let_go) == (None, False)
    assert "plug one in" in output.reason


@pytest.mark.parametrize(
    ("begins", "steps"),
    [
        (TestedPad, [({}, "lowest"), ({"BTN_TL": 1}, "lowest"), ({"ABS_Y": HIGH}, "press it again"),
                     ({"ABS_Y": MIDDLE}, "press it again"), ({"BTN_TL": 0}, "hold BTN_TL"), ({"BTN_TL": 1}, "stick")]),
        (TestedPad, [({"BTN_TL": 1}, AT_START), ({"ABS_Y": HIGH}, AT_START), *[({"ABS_Y": MIDDLE}, AT_START)] * 100,
                     ({"BTN_TL": 0}, "hold BTN_TL"), ({"BTN_TL": 1}, "stick")]),
        (flown_pad, [({"BTN_TL": 0}, "neutral"), ({"seconds": 0.5}, "neutral"), ({"BTN_TL": 1}, "stick")]),
        (flown_pad, [({"BTN_START": 1}, "stick"), ({"seconds": 0.3, "BTN_START": 0}, "stick"),
                     ({"seconds": 0.2}, "stick")]),
    ],
    ids=["after zero thrust was seen", "pressed at the start", "again in time", "a short press takes nothing off"],
)  # fmt: skip
def test_what_the_buttons_do_one_after_the_other(begins, steps):
    pad = begins()
    for changes, does in steps:
        output = pad.tick(**changes)
        assert kind(output) == (does if does in KINDS else None)
        assert does in KINDS or does in output.reason


@pytest.mark.parametrize("function", ["BTN_START", "BTN_NORTH", "BTN_EAST", "BTN_MODE"])
def test_verb_that_is_pressed_at_the_start_does_nothing(pad, function):
    pad.tick(**{function: 1})
    assert pad.hands.stuck == [function]
    pad.fly()
    outputs = [pad.tick() for _ in range(80)]
    assert {kind(output) for output in outputs} == {"stick"}
    assert not any(output.stop_motors or output.let_go for output in outputs)


def test_letting_go_is_neutral_at_once_with_the_thrust_of_the_stick_and_a_release_later(flown):
    assert flown.sticks(ABS_RX=HIGH, ABS_Y=LOW)["throttle"] == 30
    let_go_at = flown.now
    output = flown.tick(BTN_TL=0)
    while not output.let_go:
        assert output.is_neutral
        assert dict(output.setpoint.fields) == {"pitch": 0, "roll": 0, "yaw": 0, "throttle": 30}
        output = flown.tick()
    assert output.setpoint is None
    assert flown.now - let_go_at == pytest.approx(0.9, abs=0.021), "the daemon would do it after 1.0 s"
    assert flown.tick().setpoint is None


def test_frozen_pad_is_neutral_then_released_and_thrust_is_not_above_hover(flown):
    assert flown.sticks(ABS_Y=LOW, ABS_RY=LOW)["throttle"] == 30
    frozen = flown.now
    assert not flown.decide(0.24).is_neutral
    output = flown.decide(0.02)
    assert output.is_neutral
    assert dict(output.setpoint.fields) == {"pitch": 0, "roll": 0, "yaw": 0, "throttle": -2}
    while not output.let_go:
        output = flown.decide(0.02)
    assert flown.now - frozen <= 0.9 + 0.021


def test_one_axis_that_is_not_answered_counts_as_lost(flown):
    del flown.state["ABS_RX"]
    outputs = [flown.tick() for _ in range(14)]
    assert outputs[-1].is_neutral
    assert "ABS_RX" in outputs[-1].reason


def test_unplugged_pad_lets_go_at_the_next_decision_and_begins_anew_when_it_is_back(flown):
    flown.teleop.detach("pad", "the pad was unplugged")
    output = flown.decide()
    assert (output.let_go, output.setpoint, output.reason) == (True, None, "the pad was unplugged")
    assert not flown.decide().let_go
    again = TestedPad(teleop=flown.teleop)
    again.now = flown.now
    assert again.tick(BTN_TL=1).setpoint is None
    again.tick(BTN_TL=0)
    assert "lowest" in again.tick(BTN_TL=1).reason


@pytest.fixture
def second(flown):
    """A second pad, while the first flies."""
    pad = TestedPad(teleop=flown.teleop, name="second")
    pad.now = flown.now
    pad.ask()
    return pad


def test_second_pad_flies_nothing_while_the_first_does(flown, second):
    for number in range(50):
        second.now = flown.now
        second.ask(BTN_TL=1, ABS_RX=HIGH, ABS_Y=HIGH if number % 2 else LOW)
        assert flown.sticks()["roll"] == 0.0
    flown.teleop.detach("pad", "unplugged")
    second.now = flown.now
    assert second.decide().let_go
    assert second.tick().setpoint is None


def test_release_on_any_pad_lets_go(flown, second):
    second.ask(BTN_EAST=1)
    output = flown.tick()
    assert output.let_go
    assert "release pressed" in output.reason
    assert flown.tick().setpoint is None


def test_pad_detached_without_flying_lets_go_of_nothing(flown, second):
    flown.teleop.detach("second", "unplugged")
    assert list(flown.teleop.hands) == ["pad"]
    assert kind(flown.tick()) == "stick"


def test_ended_lease_needs_the_enable_button_anew(flown):
    flown.teleop.ended("somebody took the lease")
    output = flown.tick()
    assert output.setpoint is None
    assert output.reason.startswith("somebody took the lease; release")
    flown.tick(BTN_TL=0)
    assert kind(flown.tick(BTN_TL=1)) == "stick"


def test_known_ground_wants_the_thrust_stick_at_its_lowest(pad):
    pad.is_on_ground = True
    pad.make_ready()
    assert "aircraft stands" in pad.tick(BTN_TL=1).reason
    pad.tick(BTN_TL=0, ABS_Y=HIGH)
    assert pad.sticks(BTN_TL=1)["throttle"] == -100


@pytest.mark.parametrize(
    ("change", "name", "seconds"),
    [({"BTN_START": 1}, "takeoff", 0.5), ({"ABS_Z": 255}, "land", 0.5), ({"BTN_NORTH": 1}, "hold", 0.0)],
)
def test_manoeuvre_begins_when_its_button_was_held_long_enough(change, name, seconds):
    pad = flown_pad(takeoff_height=2)
    began = pad.now + 0.02
    output = pad.tick(**change)
    while kind(output) == "stick":
        output = pad.tick()
    assert kind(output) == name
    assert pad.now - began == pytest.approx(seconds, abs=0.021)
    assert dict(output.setpoint.fields) == ({"height": 2} if name == "takeoff" else {})
    assert kind(pad.tick(BTN_START=0, ABS_Z=0, BTN_NORTH=0)) == name


def test_letting_go_during_a_manoeuvre_is_neutral_at_hover_thrust(pad):
    pad.make_ready()
    for change in ({"ABS_Y": HIGH}, {"BTN_TL": 1}, {"BTN_NORTH": 1}):
        pad.tick(**change)
    assert pad.sticks(BTN_TL=0) == {"pitch": 0, "roll": 0, "yaw": 0, "throttle": -2}


@pytest.mark.parametrize("flying", [True, False])
def test_stop_is_asked_for_once_after_a_long_press(pad, flying):
    pad.fly() if flying else pad.make_ready()
    asked = [pad.tick(BTN_MODE=1).stop_motors for _ in range(100)]
    assert asked.count(True) == 1
    assert True not in asked[:49]


def test_manoeuvre_goes_on_while_somebody_asks_for_the_motors_to_stop(flown):
    flown.tick(BTN_NORTH=1)
    outputs = [flown.tick(BTN_MODE=1) for _ in range(60)]
    assert {kind(output) for output in outputs} == {"hold"}
    assert [output.stop_motors for output in outputs].count(True) == 1


def test_pad_by_radio_that_reports_nothing_with_a_deflected_stick_is_lost_with_no_thrust_above_hover():
    pad = flown_pad(replace(FACTS, is_wireless=True))
    pad.hands.reported("ABS_RX", HIGH, pad.now)
    pad.state |= {"ABS_RX": HIGH, "ABS_Y": LOW}
    outputs = [pad.tick() for _ in range(150)]
    lost = next(number for number, output in enumerate(outputs) if output.is_neutral)
    assert 99 <= lost < 110, "nothing was reported for two seconds"
    assert [outputs[number].setpoint.fields["throttle"] for number in (0, lost)] == [30, -2]
    assert any(output.let_go and "out of reach" in output.reason for output in outputs)


def test_pad_by_radio_with_a_hardly_deflected_stick_may_be_silent():
    pad = flown_pad(replace(FACTS, is_wireless=True), roll=LINEAR)
    position = round(0.24 * HIGH)
    assert not any(pad.tick(ABS_RX=position).is_neutral for _ in range(110))
    assert pad.tick(ABS_RX=round(0.26 * HIGH)).is_neutral


def test_quiet_time_of_the_mapping_counts_by_cable_too():
    pad = flown_pad(quiet_after=0.5)
    outputs = [pad.tick(ABS_RX=HIGH) for _ in range(30)]
    assert outputs[-1].is_neutral


def test_enable_button_that_was_only_tapped_flies_nothing(pad):
    pad.make_ready()
    pad.now += 2.0
    pad.ask()
    pad.hands.reported("BTN_TL", 1, pad.now)
    pad.hands.reported("BTN_TL", 0, pad.now)
    assert pad.decide().setpoint is None
    assert pad.tick().setpoint is None


def test_refusal_while_nobody_flies_changes_nothing(pad):
    pad.make_ready()
    pad.teleop.refused()
    assert kind(pad.tick(BTN_TL=1)) == "stick"


def test_button_held_for_just_its_time_counts_and_an_axis_just_so_old_is_still_known(flown):
    flown.now = 16.0  # a float holds this moment, and those a quarter of a second later, exactly
    flown.ask(BTN_START=1)
    assert kind(flown.decide()) == "stick"
    assert kind(flown.decide(0.25)) == "stick"
    assert kind(flown.tick(0.25)) == "takeoff"


@pytest.mark.parametrize("axis", ["ABS_RX", "ABS_RY", "ABS_X", "ABS_Y"])
@pytest.mark.parametrize("way", [1, -1])
def test_stick_takes_over_from_a_manoeuvre_beyond_a_quarter_of_its_way(axis, way):
    pad = flown_pad(pitch=LINEAR, roll=LINEAR, yaw=LINEAR)
    assert kind(pad.tick(BTN_NORTH=1)) == "hold"
    assert kind(pad.tick(BTN_NORTH=0, **{axis: round(0.24 * way * HIGH)})) == "hold"
    assert pad.sticks(**{axis: round(0.26 * way * HIGH)})["throttle"] == -2, "hover, until its stick has come to it"
    assert pad.teleop.manoeuvre is None
