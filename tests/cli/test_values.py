"""How values and trends are shown: columns with units, bars in one line."""

from __future__ import annotations

import math

import pytest

from mkdaemon.cli.mkctl.health import render
from mkdaemon.cli.mkctl.record import Rate
from mkdaemon.cli.mkctl.values import Columns, Pacer, field_lines
from mkdaemon.cli.sparkline import sparkline
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
