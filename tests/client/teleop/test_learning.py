"""How a mapping is learned: what moved, what was pressed, whether all is at rest again, and the file that follows."""

from __future__ import annotations

import math
import tomllib

import pytest

from mkdaemon.client.teleop.learning import (
    BUTTONS,
    STICKS,
    is_calm,
    mapping_text,
    moved_axis,
    pressed_control,
)
from mkdaemon.config.gamepad import ButtonsSection, SticksSection

NOTHING: frozenset[str] = frozenset()


def below(value):
    """The next smaller number."""
    return math.nextafter(value, -math.inf)


@pytest.mark.parametrize(
    ("rest", "now", "axis"),
    [
        ({"A": 0.0, "B": 0.0}, {"A": 0.6, "B": -0.9}, "-B"),
        ({"A": 0.0, "B": 0.0}, {"A": 0.9, "B": -0.6}, "A"),
        ({"A": -1.0, "B": 0.9}, {"A": 1.0, "B": 0.9}, "A"),  # a trigger rests at its end
        ({"A": 1.0}, {"A": 0.4}, "-A"),
        ({"A": 0.0}, {"A": 0.5}, "A"),
        ({"A": 0.0}, {"A": below(0.5)}, None),
        ({"A": 0.0}, {"A": -0.5}, "-A"),
        ({}, {"A": 0.6}, "A"),  # nobody had asked for it yet: it rests in the middle
        ({}, {"A": -0.6}, "-A"),
        ({}, {"A": 0.7, "B": -0.6}, "A"),
        ({}, {}, None),
    ],
)
def test_axis_that_moved_most_from_where_it_rested_is_found(rest, now, axis):
    assert moved_axis(rest, now) == axis


@pytest.mark.parametrize(
    ("rest", "now", "before", "after", "found"),
    [
        ({}, {}, {"B1"}, {"B1", "B2"}, "B2"),  # one that was down already says nothing
        ({}, {}, set(), {"B9", "B2"}, "B2"),
        ({"A": 0.0}, {"A": 1.0}, set(), {"B1"}, "B1"),  # a trigger that is button and axis counts as a button
        ({"A": -1.0}, {"A": 1.0}, set(), set(), "A+"),
        ({"A": 0.0}, {"A": -1.0}, set(), set(), "A-"),
        ({"A": 0.0}, {"A": 0.1}, set(), set(), None),
        ({}, {}, {"B1"}, {"B1"}, None),
    ],
)
def test_button_or_half_of_an_axis_that_was_pressed_is_found(rest, now, before, after, found):
    assert pressed_control(rest, now, frozenset(before), frozenset(after)) == found


@pytest.mark.parametrize(
    ("rest", "now", "buttons", "calm"),
    [
        ({"A": 0.0}, {"A": below(0.15)}, NOTHING, True),
        ({"A": 0.0}, {"A": 0.15}, NOTHING, False),
        ({"A": -1.0}, {"A": -1.0 + 0.13}, NOTHING, True),
        ({"A": 0.0, "B": 0.0}, {"A": 0.0, "B": -0.2}, NOTHING, False),
        ({"A": 0.0}, {"A": 0.0}, frozenset({"B1"}), False),
        ({}, {"A": 0.1}, NOTHING, True),
        ({}, {"A": 0.2}, NOTHING, False),
        ({}, {}, NOTHING, True),
    ],
)
def test_pad_is_at_rest_when_nothing_is_pressed_and_every_axis_is_back(rest, now, buttons, calm):
    assert is_calm(rest, now, buttons) is calm


def test_every_stick_and_every_button_that_a_mapping_knows_is_asked_for():
    assert {question.key for question in STICKS} == set(SticksSection.model_fields)
    assert {question.key for question in BUTTONS} == set(ButtonsSection.model_fields)
    assert BUTTONS[0].key == "enable", "the only one that must be answered comes first"


def test_file_holds_what_was_answered_in_the_order_of_the_questions():
    answers = {"left_x": "ABS_X", "left_y": "-ABS_Y", "enable": "BTN_TL", "land": "ABS_Z+"}
    text = mapping_text("Test pad", "045e:028e", answers)
    assert tomllib.loads(text) == {
        "name": "Test pad",
        "ids": ["045e:028e"],
        "sticks": {"left_y": "-ABS_Y", "left_x": "ABS_X"},
        "buttons": {"enable": "BTN_TL", "land": "ABS_Z+"},
    }
    assert text.index("left_y") < text.index("left_x")
    assert text.splitlines()[1] == "", "an empty line between the comment, the head and each section"
    assert text.count("\n\n") == 3
    assert text.endswith("\n")


@pytest.mark.parametrize(
    ("name", "written"),
    [
        ('a "good" pad\\', "a  good  pad"),
        ("two\nlines\x07", "two lines"),
        ('"\\\n', "gamepad"),
        ("", "gamepad"),
        ("x" * 61, "x" * 60),
        ("Zoë's", "Zoë's"),
    ],
)
def test_name_of_a_pad_cannot_break_its_file(name, written):
    assert tomllib.loads(mapping_text(name, "0000:0000", {}))["name"] == written
