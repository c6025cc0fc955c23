"""The measurement of gateways: stamps of the kernel, and what is made of them."""

from __future__ import annotations

import socket
import time

import pytest

from lab.gateways import Part, Value, figures_of
from lab.rigs.gatewaypeers import PEERS
from lab.rigs.stamped import NS, Arrivals, receive, stamp_arrivals

START = 1_700_000_000 * NS
MS = 1_000_000
TRIES = 40
"""The kernel begins to stamp a little after it is first asked to; until then it is the time of reading."""


def udp():
    ours, theirs = (socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(2))
    ours.bind(("127.0.0.1", 0))
    theirs.connect(ours.getsockname())
    return ours, theirs


def tcp():
    with socket.create_server(("127.0.0.1", 0)) as server:
        theirs = socket.create_connection(server.getsockname())
        return server.accept()[0], theirs


@pytest.mark.parametrize("pair", [udp, tcp])
def test_what_waits_for_its_reader_keeps_the_time_at_which_it_came(pair):
    ours, theirs = pair()
    with ours, theirs:
        stamp_arrivals(ours)
        for _ in range(TRIES):
            before = time.time_ns()
            theirs.sendall(b"value")
            sent = time.time_ns()
            while time.time_ns() < sent + 50 * MS:
                time.sleep(0.01)
            data, at = receive(ours)
            assert data == b"value"
            assert before <= at
            if at < sent + 50 * MS:
                return
    pytest.fail("no stamp of the kernel")


def values(count):
    """Attitudes on the bus, 40 a second."""
    ticks = [tick * 0.025 for tick in range(count)]
    return [Value(100.0 + tick, 1.7e9 + tick, START + round(tick * NS)) for tick in ticks]


def arrivals(case, seen, late_ms, keep=lambda place: True):
    found = Arrivals()
    for place, one in enumerate(seen):
        if keep(place):
            found.came(one.at + late_ms * MS, PEERS[case].number(one.monotonic, one.wall))
    return found


def figures(case, late_ms=2, keep=lambda place: True, daemon=(0.22, 0.22, 0.22), gateway=0.1):
    seen = values(400)
    parts = [
        Part(START + 3 * place * NS, START + 3 * (place + 1) * NS, gateway, share, 0.2)
        for place, share in enumerate(daemon)
    ]
    relayed = {round(one.monotonic * 1e9): one.at + MS for one in seen}
    return figures_of(case, parts, seen, relayed, arrivals(case, seen, late_ms, keep))


@pytest.mark.parametrize("case", PEERS)
def test_each_value_is_found_again_at_the_peer_and_at_the_relay(case):
    found = figures(case)
    assert (found["values"], found["lost"]) == (360, 0)
    assert found["added_p50_ms"] == found["added_p99_ms"] == pytest.approx(2.0, abs=0.01)
    assert found["floor_p50_ms"] == found["floor_p99_ms"] == pytest.approx(1.0, abs=0.01)
    assert found["messages_per_s"] == pytest.approx(40, abs=1)
    assert found["daemon_ratio"] == pytest.approx(1.1)
    assert found["holds"]


@pytest.mark.parametrize(
    "worse",
    [
        {"late_ms": 6},
        {"keep": lambda place: place % 50},
        {"daemon": (0.2, 0.23, 0.24)},
        {"gateway": 0.16},
    ],
)
def test_what_misses_a_goal_or_loses_a_value_is_not_within(worse):
    assert not figures("foxglove", **worse)["holds"]


def test_a_number_that_was_rounded_differently_is_the_same_value():
    seen = values(400)
    off = Arrivals({number + 1: at for number, at in arrivals("ros2", seen, 3).at.items()})
    found = figures_of("ros2", [Part(START, START + 9 * NS, 0.1, 0.2, 0.2)], seen, {100 * NS: START}, off)
    assert found["lost"] == 0
    assert found["added_p50_ms"] == pytest.approx(3.0, abs=0.01)
