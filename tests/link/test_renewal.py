"""How often streams are renewed: against the losses as they would happen, and at the limits."""

from __future__ import annotations

import random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mkdaemon.link.session.renewal import (
    ONCE_IN,
    PRIOR_FIRST,
    SHORTEST,
    TIME_TO_LIVE,
    HeardShare,
    renewal_interval,
    time_between_ends,
)

FATES = st.lists(st.booleans(), max_size=400)


def share_of(fates) -> HeardShare:
    share = HeardShare()
    for is_answered in fates:
        share.note(is_answered=is_answered)
    return share


def fates_in_bursts(first: float, after_a_loss: float, count: int) -> list[bool]:
    """Whether each of some requests is heard, where a loss makes the next one more likely."""
    rng, fates, is_lost = random.Random(1), [], False
    for _ in range(count):
        is_lost = rng.random() < (after_a_loss if is_lost else first)
        fates.append(not is_lost)
    return fates


@given(fates=FATES, longest=st.floats(0.5, 2.0))
def test_streams_run_out_less_than_once_in_a_hundred_hours_or_renewals_come_as_often_as_they_may(fates, longest):
    share = share_of(fates)
    interval = renewal_interval(share, longest)
    assert SHORTEST <= interval <= longest
    assert time_between_ends(interval, share) >= ONCE_IN or interval == SHORTEST
    if interval < longest:  # no more often than needed
        fewer = int(TIME_TO_LIVE / interval + 1e-9) - 1
        rarer = min(TIME_TO_LIVE / fewer, longest)
        assert rarer == interval or time_between_ends(rarer, share) < ONCE_IN or interval == SHORTEST


@pytest.mark.parametrize(("first", "after", "interval"), [(0.3, 0.5, 0.5), (0.2, 0.6, 0.8), (0.5, 0.5, 1.0)])
def test_the_time_until_streams_run_out_is_that_of_losses_played_out(first, after, interval):
    share = HeardShare()
    share._first, share._next = [1e9 * first, 1e9 * (1 - first)], [1e9 * after, 1e9 * (1 - after)]
    in_a_row, ends, run = int(TIME_TO_LIVE / interval + 1e-9), 0, 0
    fates = fates_in_bursts(first, after, 400_000)
    for is_heard in fates:
        run = 0 if is_heard else run + 1
        ends += run == in_a_row
    assert time_between_ends(interval, share) == pytest.approx(len(fates) * interval / ends, rel=0.15)


def test_losses_in_bursts_ask_for_more_renewals_than_as_many_single_ones():
    apart, in_bursts = share_of(([True] * 9 + [False]) * 20), share_of(([True] * 36 + [False] * 4) * 5)
    assert in_bursts.next_lost > apart.next_lost
    assert renewal_interval(in_bursts, 1.5) < renewal_interval(apart, 1.5)


@pytest.mark.parametrize(("answered", "slowest", "fastest"), [(1.0, 0.6, 0.4), (0.9, 0.8, 0.3), (0.4, 0.21, SHORTEST)])
def test_a_worse_line_is_renewed_more_often(answered, slowest, fastest):
    rng = random.Random(2)
    share = share_of(rng.random() < answered for _ in range(400))
    assert fastest <= renewal_interval(share, 1.5) <= slowest


def test_before_the_first_link_test_the_prior_holds_and_what_was_long_ago_is_forgotten():
    share = HeardShare()
    assert share.first_lost == pytest.approx(PRIOR_FIRST[0] / sum(PRIOR_FIRST))
    bad = share_of([False, True] * 100)
    for _ in range(1500):
        bad.note(is_answered=True)
    assert bad.first_lost < 0.01
