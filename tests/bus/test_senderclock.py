"""The age of a setpoint counts from when it was sent, whatever the clock of its sender shows."""

from __future__ import annotations

import asyncio
import time

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lab.rigs.waiting import wait_until
from mkdaemon.bus.codec import TooLate, decode_map
from mkdaemon.bus.floods import UNSTAMPED_RATE, Silencer
from mkdaemon.bus.intake import LATEST, SetpointIntake
from mkdaemon.bus.senderclock import DRIFT, SenderClock
from mkdaemon.errors import CommandRejectedError
from mkdaemon.telemetry.signature import SIGNATURE_BYTES, Signature, stamp_of, stamped_proof


@given(
    offset=st.floats(-1e6, 1e6),
    rate=st.floats(-DRIFT / 2, DRIFT / 2),
    delays=st.lists(st.floats(0.0, 5.0), min_size=1, max_size=60),
    pauses=st.lists(st.floats(0.02, 60.0), min_size=60, max_size=60),
)
def test_an_age_is_never_too_large_and_too_small_by_the_shortest_delay_at_most(offset, rate, delays, pauses):
    clock, sent_at, shortest = SenderClock(), 0.0, float("inf")
    for delay, pause in zip(delays, pauses, strict=False):
        sent_at += pause
        arrived, shortest = sent_at + delay, min(shortest + 2 * DRIFT * (pause + 5.0), delay)
        found = clock.sent(1, offset + sent_at * (1.0 + rate), arrived)
        assert arrived >= found
        assert found >= sent_at - 1e-6
        assert found - sent_at <= shortest + 2 * DRIFT * 10.0


def test_another_lease_has_another_clock():
    clock = SenderClock()
    assert clock.sent(1, 100.0, 5.0) == 5.0
    assert clock.sent(1, 100.1, 6.0) == pytest.approx(5.1, abs=2e-3)
    assert clock.sent(2, 3.0, 6.0) == 6.0


def test_a_stamp_is_signed_with_its_payload():
    proof = stamped_proof("secret", "setpoint/stick", b"payload", 12.5)
    assert stamp_of(proof) == 12.5
    assert Signature("setpoint/stick", b"payload", proof).is_by("secret")
    forged = proof[:SIGNATURE_BYTES] + (13_000_000_000).to_bytes(8)
    assert not Signature("setpoint/stick", b"payload", forged).is_by("secret")
    moved = Signature("setpoint/stick", b"payload" + proof[SIGNATURE_BYTES:], proof[:SIGNATURE_BYTES])
    assert not moved.is_by("secret"), "the stamp is not a part of the payload"
    assert stamp_of(proof[:SIGNATURE_BYTES]) is None


async def taken_of(sends):
    """What reaches the loop of setpoints with payload and stamp, which all arrive at once."""
    taken = []
    intake = SetpointIntake(asyncio.get_running_loop(), taken.append, lambda raw, proof: 7, lambda: None)
    for payload, sent in sends:
        intake.arrived(payload, stamped_proof("", "", payload, sent))
        await asyncio.sleep(0.01)
    return taken


async def test_what_was_sent_too_long_ago_is_not_read_and_its_sender_is_told():
    now = time.monotonic() + 1000.0  # the clock of another machine
    fresh, late = await taken_of([(b"fresh", now), (b"late", now - LATEST - 0.2)])
    assert (fresh.payload, late.signed_for) == (b"fresh", 7)
    assert isinstance(late.payload, TooLate)
    with pytest.raises(CommandRejectedError, match="sent 0") as caught:
        decode_map(late.payload)
    assert caught.value.token == "setpoint_late"


async def test_the_age_of_what_waited_counts_from_when_it_was_sent():
    now = time.monotonic()
    first, second = await taken_of([(b"1", now), (b"2", now - 0.1)])
    assert second.at - second.sent == pytest.approx(0.1 + second.at - first.at, abs=0.01)


async def test_a_flood_without_stamps_is_not_flown_and_an_honest_stream_is():
    taken = []
    intake = SetpointIntake(asyncio.get_running_loop(), taken.append, lambda raw, proof: 7, lambda: None)
    for number in range(2000):
        intake.arrived(b"%d" % number, bytes(SIGNATURE_BYTES))
    await wait_until(lambda: any(isinstance(one.payload, TooLate) for one in taken))
    late = [one.payload for one in taken if isinstance(one.payload, TooLate)]
    assert late
    with pytest.raises(CommandRejectedError, match="do not say when") as caught:
        decode_map(late[-1])
    assert caught.value.token == "setpoint_late"


def test_a_stream_that_is_too_fast_is_silenced_until_it_is_not():
    now = [0.0]
    silencer = Silencer(UNSTAMPED_RATE, lambda: now[0])
    admitted = 0
    for _ in range(10_000):
        now[0] += 1e-3
        admitted += silencer.admits()
    assert admitted <= UNSTAMPED_RATE * 1.3
    now[0] += 0.6
    assert silencer.admits()
    for _ in range(500):
        now[0] += 0.02
        assert silencer.admits()
