"""Scripts of a flight: what is read, and what is said of one that is wrong."""

from __future__ import annotations

import re

import pytest

from lab.places import ROOT
from mkdaemon.errors import ConfigError
from mkdaemon.missions.script import GotoStep, LandStep, TakeOffStep, WaitStep, read_script

GOOD = """
[[step]]
do = "wait"
key = "state/battery"
field = "voltage"
above = 14

[[step]]
do = "take_off"
height = 2

[[step]]
do = "goto"
position = [0.5, 0, 2]
yaw_deg = 90

[[step]]
do = "land"
"""


def script(tmp_path, text):
    """A script in a file."""
    path = tmp_path / "flight.toml"
    path.write_text(text)
    return path


def test_a_script_is_its_steps_in_order(tmp_path):
    steps = read_script(script(tmp_path, GOOD))
    assert [type(step) for step in steps] == [WaitStep, TakeOffStep, GotoStep, LandStep]
    assert steps[2].position == (0.5, 0.0, 2.0)


def test_the_script_of_the_manual_is_one(tmp_path):
    page = (ROOT / "docs" / "flying.md").read_text(encoding="utf-8")
    [text] = re.findall(r"```toml\n(.*?)```", page.split("\n### From a file\n")[1].split("\n## ")[0], re.DOTALL)
    assert [type(step).__name__ for step in read_script(script(tmp_path, text))] == [
        "WaitStep",
        "TakeOffStep",
        "GotoStep",
        "HoldStep",
        "LandStep",
    ]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ('[[step]]\ndo = "tke_off"\nheight = 2', "step 1: no such step do = 'tke_off'; did you mean 'take_off'?"),
        ('[[step]]\ndo = "xxxxx"', "there is take_off, hold, goto"),
        ("[[step]]\nheight = 2", "no such step do = None"),
        ('[[step]]\ndo = "take_off"\nheigth = 2', "step 1 (take_off): height: Field required"),
        ('[[step]]\ndo = "take_off"\nheight = 50', "less than or equal to 10"),
        ('[[step]]\ndo = "hold"\nseconds = 3\nsecond = 3', "did you mean seconds?"),
        ('[[step]]\ndo = "wait"\nkey = "a"\nfield = "b"', "give one of above, below and equals"),
        ('[[step]]\ndo = "land"\n[[step]]\ndo = "hold"\nseconds = 1', "step 1: land must be the last step"),
        ('[[step]]\ndo = "hold"\nseconds = 1\n[[step]]\ndo = "take_off"\nheight = 2', "take_off must be the first"),
        ("steps = 3", "a list of [[step]], not steps"),
        ("", "a list of [[step]]"),
        ("[[step]", "not valid TOML"),
    ],
)
def test_what_is_wrong_is_said_with_its_step(tmp_path, text, words):
    with pytest.raises(ConfigError) as wrong:
        read_script(script(tmp_path, text))
    assert words in str(wrong.value)


def test_a_file_that_is_not_there_is_said(tmp_path):
    with pytest.raises(ConfigError, match="cannot be read"):
        read_script(tmp_path / "nowhere.toml")


@pytest.mark.parametrize(
    ("condition", "value", "holds"),
    [
        ({"above": 14.0}, 14.1, True),
        ({"above": 14.0}, 13.9, False),
        ({"below": 1.0}, 0.5, True),
        ({"below": 1.0}, True, False),
        ({"above": 1.0}, None, False),
        ({"equals": "up"}, "up", True),
        ({"equals": False}, True, False),
    ],
)
def test_a_condition_is_met_or_not(condition, value, holds):
    assert WaitStep(do="wait", key="a", field="b", **condition).holds(value) is holds
