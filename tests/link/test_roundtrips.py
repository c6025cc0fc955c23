"""Round trips: percentiles, weighted mean, loss over the window, late and double answers."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mkdaemon.link.session.roundtrips import CAPACITY, WEIGHT, RoundTrips, percentile


def test_percentiles_mean_and_last():
    trips = RoundTrips(window=10.0, timeout=0.25)
    for number in range(100):
        trips.sent(number, number * 0.01)
        assert trips.answered(number, number * 0.01 + (number + 1) / 1000) == pytest.approx((number + 1) / 1000)
    stats = trips.statistics(1.0)
    assert stats.sent == 100
    assert stats.lost == 0
    assert stats.p50_ms == pytest.approx(51)
    assert stats.p95_ms == pytest.approx(96)
    assert stats.p99_ms == pytest.approx(100)
    assert stats.last_ms == pytest.approx(100)
    assert stats.mean_ms is not None
    assert 90 < stats.mean_ms < 95


def test_the_weighted_mean_moves_an_eighth():
    trips = RoundTrips(window=10.0, timeout=1.0)
    for token, trip in ((1, 0.008), (2, 0.016)):
        trips.sent(token, 0.0)
        trips.answered(token, trip)
    assert trips.statistics(0.1).mean_ms == pytest.approx(8 + WEIGHT * 8)


def test_loss_counts_within_the_window_only():
    trips = RoundTrips(window=10.0, timeout=0.25)
    trips.sent("a", 0.0)
    trips.sent("b", 0.1)
    assert trips.unanswered == 2
    assert trips.expire(0.2) == 0
    assert trips.expire(0.3) == 1
    trips.answered("b", 0.2)
    stats = trips.statistics(0.3)
    assert (stats.sent, stats.lost, stats.loss_percent) == (2, 1, 50.0)
    assert trips.statistics(20.0).sent == 0
    assert trips.statistics(20.0).loss_percent == 0.0


def test_late_double_and_stray_answers_are_told_apart():
    trips = RoundTrips(window=10.0, timeout=0.25)
    trips.sent("a", 0.0)
    trips.expire(0.3)
    assert trips.answered("a", 0.4) is None
    assert trips.answered("a", 0.5) is None
    assert trips.answered("never sent", 0.5) is None
    stats = trips.statistics(0.5)
    assert (stats.late, stats.duplicate, stats.lost) == (1, 2, 1)


def test_what_is_forgotten_or_cleared_counts_neither_way():
    trips = RoundTrips(window=10.0, timeout=0.25)
    trips.sent("hidden", 0.0)
    trips.forget("hidden")
    trips.sent("gone", 0.0)
    trips.clear()
    assert trips.expire(9.0) == 0
    assert trips.statistics(9.0).sent == 0


def test_forgiving_drops_losses_and_keeps_round_trips():
    trips = RoundTrips(window=10.0, timeout=0.25)
    trips.sent("lost", 0.0)
    trips.expire(0.3)
    trips.sent("good", 0.4)
    trips.answered("good", 0.41)
    trips.sent("under way", 0.5)
    trips.forget_losses()
    assert trips.fates(0.6) == (1, 0)
    assert (trips.statistics(0.6).sent_total, trips.statistics(0.6).lost_total) == (2, 1)
    trips.answered("under way", 0.7)
    assert trips.statistics(0.7).late == 1


def test_times_of_what_waits():
    trips = RoundTrips(window=10.0, timeout=0.25)
    trips.sent("a", 1.0)
    trips.sent("b", 2.0)
    assert trips.began("a") == 1.0
    assert trips.began("c") is None
    assert trips.before(2.0) == [("a", 1.0)]


def test_memory_is_bounded():
    trips = RoundTrips(window=1e9, timeout=0.25)
    for number in range(CAPACITY + 50):
        trips.sent(number, float(number))
        if number % 2:
            trips.answered(number, number + 0.01)
        else:
            trips.expire(number + 0.3)
    assert trips.fates(0.0) == (CAPACITY, CAPACITY // 2)


def test_percentile_of_nothing():
    assert percentile([], 0.5) is None


@given(st.lists(st.floats(0, 1), min_size=1), st.floats(0, 1))
def test_percentile_is_one_of_the_values(values, share):
    values.sort()
    found = percentile(values, share)
    assert found in values
    assert sum(value < found for value in values) <= share * len(values)
