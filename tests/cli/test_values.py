"""How values, trends and the menu of a board are shown: columns with units, bars in one line, four lines of twenty."""

from __future__ import annotations

import math

import pytest

from mkdaemon.cli.keyreader import QUIT
from mkdaemon.cli.mkctl.display import KEYS, lines_of
from mkdaemon.cli.mkctl.health import render
from mkdaemon.cli.mkctl.log import trend
from mkdaemon.cli.mkctl.record import Rate
from mkdaemon.cli.mkctl.values import REPEAT, Columns, Pacer, field_lines
from mkdaemon.cli.sparkline import sparkline
from mkdaemon.protocol.flags import MenuKey
from mkdaemon.record.entry import EntryKind
from mkdaemon.record.summary import Activity, KeySummary
from mkdaemon.stamp import NANOSECONDS
from mkdaemon.telemetry.link import LinkHealth
from tests.values import made

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


@pytest.mark.parametrize(
    ("values", "width", "least", "expected"),
    [
        ([], 8, None, ""),
        ([None, None], 8, None, ""),
        ([5.0], 8, None, "▁"),
        ([0.0, 7.0], 8, None, "▁█"),
        ([0, 1, 2, 3, 4, 5, 6, 7], 8, None, "▁▂▃▄▅▆▇█"),
        ([7.0, None, 3.5], 8, 0.0, "█ ▅"),
        ([10.0, 20.0], 8, 0.0, "▅█"),
        ([1, 9, 1, 1, 5, 1], 3, 0.0, "█▂▅"),
        ([3.0, 3.0], 8, None, "▁▁"),
    ],
)
def test_bars_show_the_values(values, width, least, expected):
    assert sparkline(values, width, least=least) == expected


def activity(seconds, origin=5 * NANOSECONDS):
    found = Activity(origin)
    for second in seconds:
        found.take(origin + round(second * NANOSECONDS))
    return found


@pytest.mark.parametrize("length", [1.0, 3.0, 1000.0, 1e6])
def test_entries_are_counted_where_they_came_however_long_the_recording_becomes(length):
    origin = 5 * NANOSECONDS
    found = activity([length * place / 1000 for place in range(500)]).over(origin + round(length * NANOSECONDS), 10)
    assert sum(found) == 500
    assert sum(found[:5]) >= 490
    assert found[6:] == [0, 0, 0, 0]


def test_an_entry_before_the_beginning_counts_at_the_beginning():
    assert activity([-3.0, 0.0, 9.9]).over(15 * NANOSECONDS, 2) == [2, 1]


def test_few_entries_are_only_marked():
    few, many = (
        KeySummary(EntryKind.SAMPLE, "k", Activity(0), count=2),
        KeySummary(EntryKind.SAMPLE, "k", Activity(0), count=500),
    )
    for one in (few, many):
        one.activity.take(0)
        one.activity.take(12 * NANOSECONDS)
    assert trend(few, 12 * NANOSECONDS) == "▄          ▄"
    assert trend(many, 12 * NANOSECONDS) == "█          █"


def test_the_rate_of_a_recording_is_looked_at_once_a_second():
    rate = Rate()
    assert rate.shown() == ""
    for tick in range(13):
        rate.take(100 * tick if tick < 9 else 800, tick * 0.25)
    assert rate.shown() == "██▁ 0 values/s"


def test_health_shows_the_last_minute():
    def measured(p95):
        return made(LinkHealth, echo={"p95_ms": p95}).model_dump(mode="json")

    def text(*more):
        from io import StringIO

        from mkdaemon.cli.console import Console

        out = StringIO()
        Console(file=out, width=140).print(render(measured(30.0), *more))
        return out.getvalue()

    assert "last minute" not in text()
    shown = text([measured(None), measured(20.0), measured(30.0)])
    assert "p95, last minute" in shown
    assert " ▁█" in shown


def test_a_picture_is_four_lines_of_twenty() -> None:
    assert lines_of("A" * 20 + "B" * 20 + "C" * 20 + "D" * 20) == ["A" * 20, "B" * 20, "C" * 20, "D" * 20]
    assert [len(line) for line in lines_of("short")] == [20] * 4


def test_nothing_a_terminal_would_act_on_is_printed() -> None:
    assert lines_of("\x1b[2Jx\0y")[0] == " [2Jx y" + " " * 13


def test_keys_do_not_leave_and_leaving_is_no_key() -> None:
    assert not QUIT & KEYS.keys()
    assert KEYS["0"] == MenuKey.PREVIOUS_PAGE | MenuKey.NEXT_PAGE
