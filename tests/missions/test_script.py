"""Scripts of a flight: what is read, and what is said of one that is wrong."""

from __future__ import annotations

import pytest

from mkdaemon.errors import ConfigError
from mkdaemon.missions.script import WaitStep, read_script

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


POINTS = '[[step]]\ndo = "path"\n[[step.points]]\nposition = [0, 0, 2]\n[[step.points]]\n'
"""A path whose second point is to be written."""


def script(tmp_path, text):
    """A script in a file."""
    path = tmp_path / "flight.toml"
    path.write_text(text)
    return path


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
        ('[[step]]\ndo = "path"', "step 1 (path): give points or pieces"),
        (POINTS + "position = [1, 0, 2]", "step 1 (path): point 2: give time or speed"),
        (POINTS + "position = [1, 0, 2]\nspeed = 50", "step 1 (path): points.2.speed: Input should be less than"),
        (POINTS + 'position = [1, 0, "far"]\nspeed = 1', "step 1 (path): points.2.position.3: Input should be a valid"),
        (POINTS + "position = [1, 0, 2]\nsped = 1", "step 1 (path): points.2.sped: Extra inputs are not permitted"),
        ('[[step]]\ndo = "path"\nfile = "no.csv"', "no.csv: cannot be read"),
        ('[[step]]\ndo = "path"\nfile = "no.csv"\npoints = [{position = [0, 0, 1]}]', "a file and points; keep one"),
        ('[[step]]\ndo = "path"\nslower = 0', "slower: Input should be greater than or equal to 0.1"),
        ("steps = 3", "a list of [[step]], not steps"),
        ("", "a list of [[step]]"),
        ("[[step]", "not valid TOML"),
    ],
)
def test_what_is_wrong_is_said_with_its_step(tmp_path, text, words):
    with pytest.raises(ConfigError) as wrong:
        read_script(script(tmp_path, text))
    assert words in str(wrong.value)


def test_a_path_takes_polynomials_of_the_file_beside_it_and_slows_them_down(tmp_path):
    row = [2.0, *range(8), *(0.0,) * 7, 1.0, 2.0, *(0.0,) * 7, *(0.0,) * 8]
    (tmp_path / "way.csv").write_text("duration,x^0\n" + ",".join(map(str, row)) + ",\n\n")
    (step,) = read_script(script(tmp_path, '[[step]]\ndo = "path"\nfile = "way.csv"\nslower = 2'))
    (piece,) = step.request.pieces
    assert (piece.duration, piece.yaw) == (4.0, ())
    assert piece.x == pytest.approx([k / 2**k for k in range(8)])
    assert (piece.y[7], piece.z[0]) == (pytest.approx(1.0 / 2**7), 2.0)


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
