from __future__ import annotations

import pytest

from mkdaemon.client.teleop.hands import HELD_FOR
from mkdaemon.client.teleop.keys import BUTTONS, DEFLECTION, FACTS, KEYBOARD, PRESS, REPEAT, REPEATED, STEP, TAP, Keys
from mkdaemon.client.teleop.teleop import Teleop, TeleopOutput


class Typist:
    """Somebody at a keyboard whose terminal answers."""

    def __init__(self) -> None:
        self.now = 5.0
        self.keys = Keys()
        self.teleop = Teleop()
        self.hands = self.teleop.attach("keyboard", KEYBOARD, FACTS, self.now)
        self.is_answering = True
        self.tick()

    def tick(self, seconds: float = 0.02) -> TeleopOutput:
        self.now += seconds
        if self.is_answering:
            self.keys.alive(self.now)
        assert self.keys.alive_at is not None
        self.hands.asked(self.keys.state(self.now), self.keys.alive_at)
        output = self.teleop.tick(self.now, is_engaged=True)
        if output.let_go:
            self.keys.let_go()
        return output

    def type(self, key: str) -> TeleopOutput:
        self.keys.typed(key, self.now)
        return self.tick()


@pytest.fixture
def typist() -> Typist:
    return Typist()


@pytest.mark.parametrize(
    ("key", "axis", "sign"),
    [
        ("up", "pitch", 1),
        ("down", "pitch", -1),
        ("right", "roll", 1),
        ("left", "roll", -1),
        ("a", "yaw", 1),
        ("d", "yaw", -1),
    ],
)
def test_key_deflects_its_stick_for_a_moment(typist: Typist, key: str, axis: str, sign: int) -> None:
    typist.type("e")
    output = typist.type(key)
    assert output.setpoint is not None
    rate = {"pitch": 20, "roll": 20, "yaw": 30}[axis]
    assert output.setpoint.fields[axis] == pytest.approx(sign * DEFLECTION * rate)
    output = typist.tick(TAP)
    assert output.setpoint is not None
    assert output.setpoint.fields[axis] == 0.0


def test_held_key_goes_on_with_its_repetitions_and_ends_soon_after() -> None:
    keys = Keys()
    for number in range(20):
        keys.typed("up", 1.0 + 0.033 * number)
        assert keys.state(1.0 + 0.033 * number)["KEYS_PITCH"] == DEFLECTION
    last = 1.0 + 0.033 * 19
    assert keys.state(last + REPEAT - 0.001)["KEYS_PITCH"] == DEFLECTION
    assert keys.state(last + REPEAT)["KEYS_PITCH"] == 0.0


def test_thrust_goes_in_steps_and_to_hover(typist: Typist) -> None:
    output = typist.type("e")
    assert output.setpoint is not None
    assert output.setpoint.fields["throttle"] == -100
    typist.type("w")
    assert typist.keys.thrust == pytest.approx(STEP - 1.0)
    output = typist.type("m")
    assert output.setpoint is not None
    assert output.setpoint.fields["throttle"] == -2
    typist.type("s")
    assert typist.keys.thrust == -STEP
    for _ in range(100):
        typist.type("s")
    assert typist.keys.thrust == -1.0


def test_enable_button_is_a_switch_and_a_held_key_switches_once(typist: Typist) -> None:
    for _ in range(5):
        typist.type("e")
    assert typist.keys.is_enabled
    typist.tick(0.2)
    assert typist.type("e").is_neutral


def test_space_lets_go_and_switches_the_enable_button_off(typist: Typist) -> None:
    typist.type("e")
    typist.type("up")
    assert typist.type(" ").let_go
    assert not typist.keys.is_enabled
    assert typist.tick().setpoint is None


def test_terminal_that_is_gone_is_neutral_then_released(typist: Typist) -> None:
    typist.type("e")
    typist.type("up")
    typist.is_answering = False
    gone = typist.now
    outputs = []
    while not (outputs and outputs[-1].let_go):
        outputs.append(typist.type("nothing"))
    neutral = next(number for number, output in enumerate(outputs) if output.is_neutral)
    assert 0.02 * (neutral + 1) <= 0.29
    assert typist.now - gone <= 0.93
    assert "the terminal has not answered" in outputs[-1].reason


@pytest.mark.parametrize(("key", "kind"), [("T", "takeoff"), ("H", "hold"), ("L", "land")])
def test_shifted_keys_begin_manoeuvres(typist: Typist, key: str, kind: str) -> None:
    typist.type("e")
    typist.type(key)
    outputs = [typist.tick() for _ in range(40)]
    assert outputs[-1].setpoint is not None
    assert outputs[-1].setpoint.kind == kind


def test_every_button_of_the_keyboard_is_one_it_has() -> None:
    assert not Typist().hands.missing
    keys = Keys()
    for key, button in BUTTONS.items():
        keys.typed(key, 1.0)
        assert keys.state(1.0)[button] == 1.0
        assert keys.state(1.0 + PRESS)[button] == 0.0


def test_refused_manoeuvre_lets_the_sticks_fly(typist: Typist) -> None:
    typist.type("e")
    typist.type("H")
    typist.teleop.refused()
    output = typist.tick()
    assert output.setpoint is not None
    assert output.setpoint.kind == "stick"


def test_presses_a_tenth_of_a_second_apart_are_two() -> None:
    keys = Keys()
    for at in (0.0, REPEATED, REPEATED + 0.09):
        keys.typed("e", at)
    assert not keys.is_enabled


def test_who_lets_go_centres_the_sticks() -> None:
    keys = Keys()
    keys.typed("up", 1.0)
    keys.let_go()
    assert keys.state(1.0)["KEYS_PITCH"] == 0.0


def test_thrust_by_keys_ends_at_the_top(typist: Typist) -> None:
    for _ in range(100):
        typist.type("w")
    assert typist.keys.thrust == 1.0


def test_thrust_by_keys_is_a_straight_line(typist: Typist) -> None:
    typist.type("e")
    typist.keys.thrust = 0.475  # half of the way to where the stick counts as at its top
    output = typist.tick()
    assert output.setpoint is not None
    assert output.setpoint.fields["throttle"] == pytest.approx((KEYBOARD.thrust.hover + KEYBOARD.thrust.highest) / 2.0)


def test_figures_that_docs_teleop_tells() -> None:
    assert (DEFLECTION, TAP, REPEAT) == (0.7, 0.3, 0.15)
    assert REPEATED == 0.1, "keyboards repeat every 25 to 40 ms"
    assert max(HELD_FOR.values()) < PRESS, "a key that is a button counts for longer than any must be held"
    assert (STEP, PRESS) == (0.03, 1.2)


def test_every_button_of_the_keyboard_has_its_key() -> None:
    assert set(KEYBOARD.buttons.model_dump().values()) == {"KEY_E", *BUTTONS.values()}
