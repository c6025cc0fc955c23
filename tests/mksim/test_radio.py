"""The serial link by its statistics, and the promises that hold byte by byte."""

from __future__ import annotations

import math
from itertools import groupby

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mksim.config import ChannelConfig, RadioKind
from mksim.radio import RadioChannel

BYTE = 10 / 57600
XBEE = ChannelConfig(kind=RadioKind.XBEE, loss=0.0)
FRAME = bytes(range(22))


def drain(channel: RadioChannel) -> list[tuple[float, bytes]]:
    out = []
    while math.isfinite(channel.next_time):
        out += channel.poll(channel.next_time)
    return out


def first_arrivals(config: ChannelConfig, count: int, period: float) -> list[float | None]:
    """Delay of each frame's first byte over its last byte sent [s]; None when it was lost."""
    channel = RadioChannel(config, 7)
    delays: list[float | None] = []
    for k in range(count):
        sent = k * period
        channel.push(FRAME, sent)
        got = []
        while channel.next_time < sent + period:
            got += channel.poll(channel.next_time)
        delays.append(got[0][0] - BYTE - (sent + len(FRAME) * BYTE) if got else None)
    return delays


def test_xbee_latency_is_that_of_2010() -> None:
    """Mean 23 ms, standard deviation 9 to 10, spikes to 62."""
    delays = np.array(first_arrivals(XBEE, 8000, 0.2), dtype=float)
    assert delays.mean() == pytest.approx(0.023, abs=0.0005)
    assert 0.009 <= delays.std() <= 0.010
    assert delays.min() >= 0.013 - 1e-9
    assert 0.058 < delays.max() <= 0.062 + 1e-9


def losses(config: ChannelConfig) -> list[bool]:
    """Whether each of 20,000 frames was lost."""
    return [delay is None for delay in first_arrivals(config, 20000, 0.1)]


def burst_lengths(lost: list[bool]) -> list[int]:
    """How many frames in a row were lost each time."""
    return [len(list(run)) for is_lost, run in groupby(lost) if is_lost]


@pytest.mark.parametrize("loss", [0.05, 0.15])
def test_packets_are_lost_alone_and_in_bursts_and_both_are_within_the_share(loss: float) -> None:
    lost = losses(ChannelConfig(kind=RadioKind.XBEE, loss=loss))
    lengths = burst_lengths(lost)
    assert sum(lost) / len(lost) == pytest.approx(loss, rel=0.15)
    assert 1.5 < np.mean(lengths) < 3.0
    assert sum(length == 1 for length in lengths) > 0.5 * len(lengths)
    assert sum(length >= 4 for length in lengths) > 0.1 * len(lengths)
    alone = losses(ChannelConfig(kind=RadioKind.XBEE, loss=loss, lost_alone=1.0))
    assert sum(alone) / len(alone) == pytest.approx(loss, rel=0.15)
    assert np.mean(burst_lengths(alone)) == pytest.approx(1.0 / (1.0 - loss), rel=0.05)


@given(
    sends=st.lists(st.tuples(st.floats(0.0, 0.05), st.binary(min_size=1, max_size=150)), max_size=20),
    kind=st.sampled_from(list(RadioKind)),
    timer=st.sampled_from([0.0, 0.001, 0.016]),
    steps=st.floats(0.0005, 0.03),
)
def test_bytes_arrive_once_in_order_and_never_early(
    sends: list[tuple[float, bytes]], kind: RadioKind, timer: float, steps: float
) -> None:
    channel = RadioChannel(ChannelConfig(kind=kind, loss=0.0, usb_timer=timer), 11)
    now, got, sent = 0.0, [], b""
    for pause, data in sends:
        until = now + pause
        while now + steps < until:
            now += steps
            got += channel.poll(now)
        now = until
        channel.push(data, now)
        sent += data
    got += drain(channel)
    assert b"".join(data for _, data in got) == sent
    times = [t for t, _ in got]
    assert times == sorted(times)
    assert channel.bytes_in == channel.bytes_out == len(sent)
    if times:
        assert times[-1] >= len(sent) * BYTE


@given(seed=st.integers(0, 2**32), chunk=st.floats(0.0003, 0.02))
@settings(max_examples=20, deadline=None)
def test_polling_pace_changes_nothing(seed: int, chunk: float) -> None:
    """Same seed, same bytes: arrival times do not depend on how often somebody looks."""

    def run(pace: float) -> list[tuple[float, bytes]]:
        config = ChannelConfig(kind=RadioKind.XBEE, loss=0.1, usb_timer=0.004, outages_per_minute=30.0)
        channel, got, now = RadioChannel(config, seed), [], 0.0
        for k in range(20):
            while now + pace < 0.04 * k:
                now += pace
                got += channel.poll(now)
            channel.push(FRAME, 0.04 * k)
        return got + drain(channel)

    assert run(chunk) == run(math.inf)
