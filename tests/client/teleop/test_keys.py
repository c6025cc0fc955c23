"""A keyboard as a pad: keys that deflect for a moment, switch, or begin something; docs/teleop.md has the figures."""

from __future__ import annotations

import pytest

from mkdaemon.client.teleop.hands import HELD_FOR
from mkdaemon.client.teleop.keys import BUTTONS, FACTS, KEYBOARD, PRESS, Keys
from mkdaemon.client.teleop.teleop import Teleop


class Typist:
    """Somebody at a keyboard whose terminal answers."""

    def __init__(self):
        self.now = 5.0
        self.keys, self.teleop = Keys(), Teleop()
        self.hands = self.teleop.attach("keyboard", KEYBOARD, FACTS, self.now)
        self.is_answering = True
        self.tick()

    def tick(self, seconds=0.02):
        self.now += seconds
        if self.is_answering:
            self.keys.alive(self.now)
        self.hands.asked(self.keys.state(self.now), self.keys.alive_at)
        output = self.teleop.tick(self.now, is_engaged=True)
        if output.let_go:
            self.keys.let_go()
        return output

    def type(self, *keys):
        for key in keys:
            self.keys.typed(key, self.now)
            output = self.tick()
        return output


@pytest.fixture
def typist():
    return Typist()


@pytest.mark.parametrize(
    ("key", "axis", "deflection"),
    [("up", "pitch", 14), ("down", "pitch", -14), ("right", "roll", 14), ("left", "roll", -14), ("a", "yaw", 21),
     ("d", "yaw", -21)],
)  # fmt: skip
def test_key_deflects_its_stick_by_seven_tenths_for_a_moment(typist, key, axis, deflection):
    output = typist.type("e", key)
    assert output.setpoint.fields[axis] == pytest.approx(deflection)
    assert typist.tick(0.279).setpoint.fields[axis] == pytest.approx(deflection)
    assert typist.tick(0.002).setpoint.fields[axis] == 0.0


def test_held_key_goes_on_with_its_repetitions_and_ends_soon_after_or_with_who_lets_go():
    keys = Keys()
    for number in range(20):
        keys.typed("up", 1.0 + 0.033 * number)
        assert keys.state(1.0 + 0.033 * number)["KEYS_PITCH"] == 0.7
    last = 1.0 + 0.033 * 19
    assert [keys.state(last + at)["KEYS_PITCH"] for at in (0.149, 0.15)] == [0.7, 0.0]
    keys.let_go()
    assert keys.state(last)["KEYS_PITCH"] == 0.0


def test_thrust_goes_in_steps_between_its_ends_and_to_hover(typist):
    assert typist.type("e").setpoint.fields["throttle"] == -100
    typist.type("w")
    assert typist.keys.thrust == pytest.approx(0.03 - 1.0)
    assert typist.type("m").setpoint.fields["throttle"] == -2
    typist.type("s")
    assert typist.keys.thrust == -0.03
    for key, end in (("s", -1.0), ("w", 1.0)):
        typist.type(*[key] * 100)
        assert typist.keys.thrust == end


def test_thrust_by_keys_is_a_straight_line(typist):
    typist.type("e")
    typist.keys.thrust = 0.475  # half of the way to where the stick counts as at its top
    middle = (KEYBOARD.thrust.hover + KEYBOARD.thrust.highest) / 2.0
    assert typist.tick().setpoint.fields["throttle"] == pytest.approx(middle)


def test_enable_button_is_a_switch_a_held_key_switches_once_and_presses_a_tenth_of_a_second_apart_are_two(typist):
    typist.type(*"eeeee")
    assert typist.keys.is_enabled
    typist.tick(0.2)
    assert typist.type("e").is_neutral
    keys = Keys()
    for at in (0.0, 0.1, 0.19):
        keys.typed("e", at)
    assert not keys.is_enabled


def test_space_lets_go_and_switches_the_enable_button_off(typist):
    assert typist.type("e", "up", " ").let_go
    assert not typist.keys.is_enabled
    assert typist.tick().setpoint is None


def test_terminal_that_is_gone_is_neutral_then_released(typist):
    typist.type("e", "up")
    typist.is_answering = False
    gone, outputs = typist.now, [typist.tick(0.0)]
    while not outputs[-1].let_go:
        outputs.append(typist.type("nothing"))
    neutral = next(number for number, output in enumerate(outputs) if output.is_neutral)
    assert 0.02 * neutral <= 0.29
    assert typist.now - gone <= 0.93
    assert "the terminal has not answered" in outputs[-1].reason


@pytest.mark.parametrize(("key", "kind"), [("T", "takeoff"), ("H", "hold"), ("L", "land")])
def test_shifted_keys_begin_manoeuvres_and_a_refused_one_lets_the_sticks_fly(typist, key, kind):
    typist.type("e", key)
    assert [typist.tick() for _ in range(40)][-1].setpoint.kind == kind
    typist.teleop.refused()
    assert typist.tick().setpoint.kind == "stick"


def test_every_button_of_the_keyboard_has_its_key_and_counts_for_longer_than_any_must_be_held():
    assert not Typist().hands.missing
    assert set(KEYBOARD.buttons.model_dump().values()) == {"KEY_E", *BUTTONS.values()}
    keys = Keys()
    for key, button in BUTTONS.items():
        keys.typed(key, 1.0)
        assert [keys.state(1.0 + at)[button] for at in (0.0, 1.19, 1.2)] == [1.0, 1.0, 0.0]
    assert max(HELD_FOR.values()) < PRESS
