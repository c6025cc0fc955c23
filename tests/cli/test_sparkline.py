"""Trends in one line."""

from __future__ import annotations

import pytest

from mkdaemon.cli.mkctl.health import render
from mkdaemon.cli.mkctl.log import trend
from mkdaemon.cli.mkctl.record import Rate
from mkdaemon.cli.sparkline import sparkline
from mkdaemon.record.entry import EntryKind
from mkdaemon.record.summary import Activity, KeySummary
from mkdaemon.stamp import NANOSECONDS
from mkdaemon.telemetry.link import LinkHealth
from tests.values import made


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
