"""The daemon's clock, as it is believed from stamps."""

from __future__ import annotations

import pytest

from mkdaemon.view.page.daemontime import WINDOW, DaemonTime


def test_nothing_is_believed_before_the_first_stamp():
    assert DaemonTime().now(5.0) is None


def test_the_newest_stamp_says_what_time_it_is_at_least():
    time = DaemonTime()
    time.take(100.0, 0.0)
    assert time.now(1.0) == 101.0
    time.take(101.5, 1.0)
    assert time.now(1.0) == 101.5
    time.take(101.0, 1.1)  # late on its way
    assert time.now(1.1) == pytest.approx(101.6)


def test_a_clock_that_is_slower_than_ours_is_followed():
    time = DaemonTime()
    for tick in range(101):
        time.take(100.0 + 0.09 * tick, 0.1 * tick)
    assert time.now(10.0) == pytest.approx(109.0, abs=2 * 0.1 * WINDOW)


def test_it_runs_at_the_speed_of_a_recording():
    time = DaemonTime()
    time.take(100.0, 0.0)
    time.play_at(4.0, 0.0)
    assert time.now(2.0) == 108.0
    time.play_at(0.0, 2.0)
    assert time.now(50.0) == 108.0
    time.restart()
    assert time.now(50.0) is None
