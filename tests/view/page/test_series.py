"""Curves: what a page does not have yet."""

from __future__ import annotations

from mkdaemon.view.page.series import PageSeries


def test_a_reader_gets_what_is_new_to_it():
    series = PageSeries()
    for at in range(3):
        series.add(float(at), at * 2.0)
    assert series.since(0) == [(0.0, 0.0), (1.0, 2.0), (2.0, 4.0)]
    assert series.since(2) == [(2.0, 4.0)]
    assert series.since(3) == []


def test_the_oldest_points_are_forgotten_and_points_too_near_left_out():
    series = PageSeries(shortest_step=0.5, kept=2)
    for at in (0.0, 0.1, 0.6, 1.2, 1.3, 2.0):
        series.add(at, None)
    assert series.since(0) == [(1.2, None), (2.0, None)]


def test_a_series_that_was_cleared_takes_earlier_points():
    series = PageSeries(shortest_step=0.5)
    series.add(100.0, 1.0)
    series.clear()
    series.add(5.0, 2.0)
    assert series.since(1) == [(5.0, 2.0)]
