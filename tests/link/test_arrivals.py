"""Kinds of frames: rates, periods missed, and what is overdue."""

from __future__ import annotations

import math

import pytest

from mkdaemon.link.session.arrivals import OVERDUE, STALE_PERIODS, Arrivals, FrameKind


def stream(interval: float, *, until: float = 10.0) -> Arrivals:
    """A stream that was asked for at 0 s and came on time."""
    arrivals = Arrivals()
    arrivals.wanted("nc", {"osd": interval}, 0.0)
    for step in range(1, round(until / interval) + 1):
        arrivals.received("nc", "osd", step * interval)
    return arrivals


@pytest.mark.parametrize("interval", [0.02, 0.1, 1.0])
def test_a_stream_is_overdue_after_three_periods_and_not_before_a_fifth_of_a_second(interval: float):
    arrivals = stream(interval)
    patience = max(STALE_PERIODS * interval, OVERDUE)
    assert arrivals.overdue(10.0 + patience - 0.001) == []
    [late] = arrivals.overdue(10.0 + patience + 0.001)
    assert (late.board, late.key) == ("nc", "osd")


def test_a_stream_never_heard_is_overdue_from_when_it_was_asked_for():
    arrivals = Arrivals()
    arrivals.wanted("nc", {"osd": 0.1}, 5.0)
    assert arrivals.overdue(5.29) == []
    assert [kind.key for kind in arrivals.overdue(5.31)] == ["osd"]
    [health] = arrivals.health(5.31, 10.0)
    assert (health.frames, health.rate, health.is_stale, health.age) == (0, 0.0, True, 1e9)


def test_what_nobody_asked_for_is_never_missed():
    arrivals = Arrivals()
    arrivals.received("fc", "debug", 1.0)
    assert arrivals.overdue(100.0) == []
    assert not arrivals.are_on_time(1.0)
    assert arrivals.health(100.0, 10.0)[0].asked_rate is None


def test_streams_of_another_board_stay_wanted():
    arrivals = stream(0.1)
    arrivals.wanted("fc", {"debug": 0.5}, 10.0)
    assert {kind.key for kind in arrivals.asked} == {"osd", "debug"}
    arrivals.wanted("nc", {}, 10.0)
    assert {kind.key for kind in arrivals.asked} == {"debug"}


def test_a_stream_that_stopped_does_not_keep_its_rate():
    arrivals = stream(0.1)
    assert arrivals.health(10.0, 10.0)[0].rate == pytest.approx(10.0, rel=0.01)
    assert arrivals.health(15.0, 10.0)[0].rate < 6.0
    assert arrivals.health(21.0, 10.0)[0].rate == 0.0


def test_an_opening_forgets_everything():
    arrivals = stream(0.1)
    arrivals.clear()
    assert arrivals.health(10.0, 10.0) == ()


def test_a_kind_before_its_first_frame():
    kind = FrameKind("osd", "nc")
    assert (kind.last, kind.missed(3.0), kind.rate(3.0, 10.0)) == (-math.inf, 0.0, 0.0)
