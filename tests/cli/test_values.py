"""How values are shown as they come: columns with units, and no more of them than somebody wants."""

from __future__ import annotations

import math

from mkdaemon.cli.mkctl.values import REPEAT, Columns, Pacer, field_lines

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


def test_vectors_and_maps_have_a_column_for_each_part_and_what_is_long_its_number():
    fields = {"position": [1.0, 2.0, 3.0], "covariance": [[1.0] * 3] * 3, "six": [0] * 6, "map": {"a": 1}}
    _, heading, row = Columns(100).lines("control/estimate", fields)
    headings = ["position x m", "position y m", "position z m", "covariance", "six", "a"]
    assert [part.strip() for part in heading.split("  ") if part.strip()] == headings
    assert [part.strip() for part in row.split("  ") if part.strip()] == ["1", "2", "3", "3 values", "6 values", "1"]


def test_everything_fits_80_columns():
    fields = {f"a_field_with_a_name_{number}": "x" * (number * 9) for number in range(12)}
    columns = Columns(80)
    first, second = columns.lines("state/else", fields), columns.lines("state/else", fields)
    assert max(map(len, first)) <= 80 and first[1:] == second, "what is folded has its headings every time"
    assert columns.lines("state/else", {"text": "y" * 100})[-1] == "y" * 77 + "..."
    shown = field_lines("state/else", {"age": 2.0, "text": "word " * 40, **fields}, 80)
    assert max(map(len, shown)) <= 80 and shown[0] == "state/else  2.00 s ago"
    assert " ".join(" ".join(shown).split()).count("word") == 40, "nothing is cut"


def test_the_last_value_has_a_field_a_line_with_its_unit():
    fields = {"voltage": 16.8, "current": None, "is_low": False, "age": 0.5}
    assert field_lines("state/battery", fields, 80) == [
        "state/battery  0.50 s ago",
        "  voltage                    16.8 V",
        "  current                    - A",
        "  is_low                     no",
    ]


def test_a_heading_comes_again_after_another_key_and_after_some_lines():
    columns = Columns(80)
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
