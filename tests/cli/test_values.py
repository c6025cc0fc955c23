"""How values are shown as they come: columns with units, and no more of them than somebody wants."""

from __future__ import annotations

import math

from mkdaemon.cli.mkctl.values import REPEAT, Columns, Pacer

ATTITUDE = {
    "stamp": {"monotonic": 1.0},
    "source": "nc/osd",
    "quaternion": [1.0, 0.0, 0.0, 0.0],
    "roll": math.radians(-1.5),
    "pitch": 0.0,
    "yaw": math.radians(90.0),
    "scale": "sticks",
}


def test_angles_are_in_degrees_below_a_heading_with_units():
    key, heading, row = Columns().lines("state/attitude", ATTITUDE)
    assert key == "state/attitude"
    assert heading.split() == ["roll", "deg", "pitch", "deg", "yaw", "deg", "scale"]
    assert row.split() == ["-1.5", "0.0", "90.0", "sticks"]
    assert [len(heading), heading.index("pitch deg")] == [len(row), row.index("      0.0")]


def test_other_units_are_those_of_the_declaration():
    lines = Columns().lines("state/battery", {"voltage": 16.8, "current": None, "used_mah": 12, "is_low": False})
    assert lines[1] == "voltage V  current A  used_mah mAh     is_low"
    assert lines[2].split() == ["16.8", "-", "12", "no"]


def test_vectors_have_a_column_for_each_axis_and_what_is_long_has_none():
    fields = {"position": [1.0, 2.0, 3.0], "covariance": [[1.0] * 3] * 3, "six": [0] * 6, "map": {"a": 1}}
    _, heading, row = Columns().lines("control/estimate", fields)
    assert heading.split("  ") == ["position x m", "position y m", "position z m"]
    assert row.split() == ["1", "2", "3"]


def test_a_heading_comes_again_after_another_key_and_after_some_lines():
    columns = Columns()
    counts = [len(columns.lines("state/attitude", ATTITUDE)) for _ in range(REPEAT + 2)]
    assert counts == [3, *[1] * (REPEAT - 1), 3, 1]
    assert len(columns.lines("state/battery", {"voltage": 1.0})) == 3
    assert len(columns.lines("state/attitude", ATTITUDE)) == 3


def test_a_key_without_a_declaration_is_shown_without_units():
    assert Columns().lines("sim/else", {"roll": 1.0})[1:] == ["     roll", "        1"]


def test_each_key_passes_as_often_as_wanted():
    pacer = Pacer(2.0)
    shown = [t for t in range(100) if pacer.is_due("state/attitude", t / 50)]
    assert shown == [0, 25, 50, 75]
    assert pacer.is_due("state/battery", 0.0)
    assert not pacer.is_due("state/battery", 0.1)
    everything = Pacer(None)
    assert all(everything.is_due("x", t / 50) for t in range(10))
