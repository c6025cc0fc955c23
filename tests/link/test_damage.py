"""Received bytes: what was a frame, what was damage, what was text."""

from __future__ import annotations

import pytest

from mkdaemon.link.session.damage import ReceivedBytes
from mkdaemon.protocol.framing import DropReason


def test_rates_and_share_are_over_the_window():
    received = ReceivedBytes(window=10.0)
    received.frame(90, 1.0)
    received.damaged(DropReason.CHECKSUM, bytes(10), 1.0, keep_text=True)
    received.damaged(DropReason.LENGTH, bytes(20), 2.0, keep_text=True)
    assert received.share(2.0) == (30, 120)
    assert received.rates(2.0) == (pytest.approx(3.0), pytest.approx(0.1))
    assert received.share(11.5) == (20, 20)
    assert received.rates(12.5) == (0.0, 0.0)


def test_what_arrived_is_counted_whether_it_is_a_frame_or_not():
    received = ReceivedBytes(window=10.0)
    received.arrived(5, 1.0)
    received.arrived(7, 2.0)
    assert (received.arrived_since(1.0), received.arrived_since(0.0)) == (7, 12)
    received.clear()
    assert received.arrived_since(0.0) == 0


@pytest.mark.parametrize(
    ("pieces", "text"),
    [
        ([(DropReason.TEXT, b"boot 2.12a ok")], "boot 2.12a ok"),
        ([(DropReason.TEXT, b"boot"), (DropReason.CHECKSUM, b"#b")], None),
        ([(DropReason.TEXT, bytes(range(128, 160)))], None),
        ([], None),
    ],
)
def test_only_readable_text_and_nothing_else_is_text(pieces: list[tuple[DropReason, bytes]], text: str | None):
    received = ReceivedBytes(window=10.0)
    for reason, raw in pieces:
        received.damaged(reason, raw, 1.0, keep_text=True)
    assert received.text_since(0.0) == text


def test_text_that_is_kept_is_not_replaced():
    received = ReceivedBytes(window=10.0)
    received.damaged(DropReason.TEXT, b"first", 1.0, keep_text=True)
    received.damaged(DropReason.TEXT, b"second", 2.0, keep_text=False)
    assert received.text_since(1.5) == "first"


def test_damage_of_an_outage_can_be_forgotten():
    received = ReceivedBytes(window=10.0)
    received.damaged(DropReason.LENGTH, bytes(20), 1.0, keep_text=True)
    received.forget_damage()
    assert received.damaged_since(0.0) == 0
    assert received.share(1.0) == (0, 20)


def test_a_text_that_was_not_kept_is_no_text():
    """Garbage at a wrong line rate: one that passed for text would end the search for the right rate."""
    received = ReceivedBytes(window=10.0)
    received.damaged(DropReason.TEXT, b"\x85\xa0\x92", 1.0, keep_text=False)
    assert received.text_since(0.0) is None
