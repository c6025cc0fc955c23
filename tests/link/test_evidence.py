"""What the link counts: frames by kind, damaged bytes, and probes with their answers."""

from __future__ import annotations

import pytest

from mkdaemon.link.session.evidence import CAPACITY, WEIGHT, ReceivedBytes, RoundTrips
from mkdaemon.protocol.framing import DropReason


def test_the_share_is_of_what_is_remembered():
    """A window holds the newest 4096 frames and the newest 1024 damages, whatever came in it."""
    received = ReceivedBytes(window=10.0)
    for _ in range(5000):
        received.frame(2, 1.0)
    assert received.share(1.0) == (0, 2 * 4096)
    for _ in range(2000):
        received.damaged(DropReason.LENGTH, bytes(3), 1.0, keep_text=False)
    assert received.share(1.0) == (3 * 1024, 3 * 2000 + 2 * (4096 - 2000))


TEXT, CHECKSUM = DropReason.TEXT, DropReason.CHECKSUM


@pytest.mark.parametrize(
    ("pieces", "text"),
    [
        ([(TEXT, b"boot 2.12a ok", True)], "boot 2.12a ok"),
        ([(TEXT, b"first", True), (TEXT, b"second", False)], "first"),
        ([(TEXT, b"boot", True), (CHECKSUM, b"#b", True)], None),
        ([(TEXT, bytes(range(128, 160)), True)], None),
        ([(TEXT, b"\x85\xa0\x92", False)], None),  # at a wrong line rate: as a text it would end the search for it
        ([], None),
    ],
)
def test_only_readable_text_that_was_kept_and_nothing_else_is_text(pieces, text: str | None):
    received = ReceivedBytes(window=10.0)
    for at, (reason, raw, keep_text) in enumerate(pieces):
        received.damaged(reason, raw, 1.0 + at, keep_text=keep_text)
    assert received.text_since(0.0 if len(pieces) < 2 or text is None else 1.5) == text


def test_percentiles_mean_and_last():
    trips = RoundTrips(window=10.0, timeout=0.25)
    for number in range(100):
        trips.sent(number, number * 0.01)
        assert trips.answered(number, number * 0.01 + (number + 1) / 1000) == pytest.approx((number + 1) / 1000)
        if number == 1:
            assert trips.statistics(1.0).mean_ms == pytest.approx(1 + WEIGHT)
    stats = trips.statistics(1.0)
    assert (stats.sent, stats.lost) == (100, 0)
    found = (stats.p50_ms, stats.p95_ms, stats.p99_ms, stats.last_ms)
    assert found == pytest.approx((51, 96, 100, 100))
    assert stats.mean_ms is not None
    assert 90 < stats.mean_ms < 95


def test_what_stays_unanswered_is_counted_with_its_reason_and_blames_the_line_only_for_what_it_lost():
    trips = RoundTrips(window=10.0, timeout=0.25)
    trips.sent("replaced", 0.0)
    trips.replaced("replaced", 0.1)
    trips.sent("gone", 0.2)
    trips.interrupted(0.3)
    trips.forgive(0.3)
    trips.sent("lost", 0.4)
    assert trips.expire(9.0) == 1
    fates = trips.tally.fates()
    assert (fates.sent, fates.unanswered, fates.replaced, fates.outage, fates.lost) == (3, 3, 1, 1, 1)
    stats = trips.statistics(9.0)
    assert (stats.sent, stats.lost, stats.replaced) == (3, 3, 1)
    assert trips.losses(9.0) == (1, 1)


@pytest.mark.parametrize(
    ("answers_at", "expected"),
    [
        # (sent at 0, 0.1, 0.2; the fastest answer takes 30 ms) round trips of those that are answered
        ((0.05, 0.15, 0.25), [0.05, 0.05, 0.05]),
        ((0.15, 0.25), [0.05, 0.05]),  # the first was lost
        ((0.11, 0.15, 0.25), [0.11, 0.05, 0.05]),  # the second cannot be back after 10 ms
        ((0.14, 0.16, 0.25), [0.04, 0.16, 0.05]),  # one of two: the counts are right, whichever it was
    ],
)
def test_answers_without_a_token_belong_to_the_newest_that_can_be_back(answers_at, expected):
    trips = RoundTrips(window=10.0, timeout=0.25)
    trips.sent("first", -1.0)
    trips.answered("first", -0.97)
    found, asked = [], [0.0, 0.1, 0.2]
    for at in sorted((*answers_at, *asked)):
        if at in asked:
            trips.sent(at, at)
        else:
            found.append(trips.answered(trips.asked(at), at))
    assert found == pytest.approx(expected)
    trips.expire(1.0)
    assert trips.tally.answered == 1 + len(answers_at)
    assert trips.tally.unanswered == 3 - len(answers_at)


def test_memory_is_bounded():
    trips = RoundTrips(window=1e9, timeout=0.25)
    for number in range(CAPACITY + 50):
        trips.sent(number, float(number))
        if number % 2:
            trips.answered(number, number + 0.01)
        else:
            trips.expire(number + 0.3)
    assert trips.losses(0.0) == (CAPACITY, CAPACITY // 2)
