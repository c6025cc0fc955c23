"""NaviCtrl: echo, slots, order, subscriptions, forwarding (docs/firmware-notes, 1, 2, 5)."""

from __future__ import annotations

import itertools

import pytest

from mkdaemon.protocol.framing import encode_frame
from tests.sim_conformance.bench import median, moments, nc_bench


def echo(number):
    return encode_frame(2, "z", (number & 0xFFFF).to_bytes(2, "little"))


def stream(letter, interval):
    return encode_frame(2, letter, bytes([interval]))


@pytest.fixture
def bench():
    return nc_bench()


def test_idle_echo_takes_4_04_ms(bench):
    times = []
    for number, at in enumerate(moments(1, 100, 0.05)):
        bench.send(echo(number), at)
        (received,) = bench.run(at + 0.02)
        assert received.frame.payload[:2] == (number & 0xFFFF).to_bytes(2, "little")
        times.append((received.last - at) * 1e3)
    assert median(times) == pytest.approx(4.04, rel=0.03)


MIXES = {
    "O100": [("o", 10)],
    "O100 D200 C50": [("o", 10), ("d", 20), ("c", 5)],
    "O": [("o", 1)],
    "O D C 30": [("o", 3), ("d", 3), ("c", 3)],
}


def run_echoes(mix, rate, seconds, *, burst=1):
    """Echoes at a rate beside streams; returns answered share and round trips [ms]."""
    bench = nc_bench()
    sent = {}
    number = 0
    at = 2.0
    renewed = 0.0
    while at < 2.0 + seconds:
        if at - renewed >= 1.5:
            for letter, interval in MIXES[mix]:
                bench.send(stream(letter, interval), at - 0.004)
            renewed = at
        for _ in range(burst):
            number += 1
            sent[number] = at
            bench.send(echo(number), at)
        # a rate of the host's own clock drifts through the phases of the streams
        at += 1.0007 / rate
    received = [item for item in bench.run(at + 0.3) if item.frame.id == "Z"]
    trips = [(item.last - sent[int.from_bytes(item.frame.payload[:2], "little")]) * 1e3 for item in received]
    return len(received) / len(sent), trips


@pytest.mark.parametrize("mix", ["O100", "O100 D200 C50"])
def test_echo_waits_for_one_frame_at_most(mix):
    answered, trips = run_echoes(mix, 10, 40)
    assert answered > 0.99
    assert max(trips) <= 24.4 + 0.2


ECHO_LOSS = [
    # streams, echo rate [Hz], share lost at least, at most; measured 0, 1.3, 8 and 0, 14, 47 %
    ("O100", 10, 0.0, 0.005),
    ("O100", 50, 0.0, 0.05),
    ("O100", 100, 0.04, 0.14),
    ("O", 10, 0.0, 0.005),
    ("O", 50, 0.05, 0.22),
    ("O", 100, 0.40, 0.60),
]


@pytest.mark.parametrize(("mix", "rate", "low", "high"), ECHO_LOSS)
def test_echo_loss(mix, rate, low, high):
    answered, _ = run_echoes(mix, rate, 20)
    assert low <= 1.0 - answered <= high


def test_replies_leave_in_a_fixed_order(bench):
    bench.send(stream("o", 200), 1.5)
    requests = b"".join(
        (
            encode_frame(2, "e"),
            encode_frame(2, "v"),
            encode_frame(2, "l", b"\x00"),
            encode_frame(2, "h", b"\xff\x00"),
            encode_frame(2, "a", b"\x00"),
            encode_frame(2, "x", b"\x01"),
            encode_frame(2, "j", bytes(4)),
            echo(1),
        )
    )
    # all are in the ring before the O frame that began at the same time is out
    bench.send(stream("o", 3), 2.0)
    bench.send(stream("o", 3), 2.023)
    bench.run(2.02)
    bench.send(requests, 2.0265)
    order = [letter for letter in bench.ids(bench.run(2.6)) if letter != "O"]
    assert sorted(order) == sorted("JZXAHLVE")
    assert order == [letter for letter in "JZWXAHLVE" if letter in order]


def test_a_saturating_stream_starves_what_is_below_it(bench):
    free = bench.send(stream("o", 1), 2.0)
    bench.send(encode_frame(2, "v"), 2.1)
    version = next(received for received in bench.run(8.0) if received.frame.id == "V")
    assert version.first - 2.1 == pytest.approx(3.9, abs=0.15)
    assert version.first - free == pytest.approx(4.0, abs=0.1)


@pytest.mark.parametrize(("letter", "interval", "floor_ms"), [("o", 1, 20.5), ("d", 1, 16.3), ("c", 1, 10.0)])
def test_fastest_stream(bench, letter, interval, floor_ms):
    bench.send(stream(letter, interval), 2.0)
    times = [received.first for received in bench.run(4.0)]
    assert median(b - a for a, b in itertools.pairwise(times)) * 1e3 == pytest.approx(floor_ms, rel=0.02)


RENEWALS = [("o", True), ("d", True), ("c", True), ("h", True), ("z", False), ("v", False), ("a", False), ("l", False)]


@pytest.mark.parametrize(("letter", "renews"), RENEWALS)
def test_what_renews_all_even_with_interval_0(letter, renews):
    payload = {"h": b"\xff\x00", "z": b"\x01\x00", "v": b""}.get(letter, b"\x00")
    bench = nc_bench()
    other = "d" if letter != "d" else "o"
    bench.send(stream(other, 20), 1.5)
    for number in range(6):
        bench.send(encode_frame(2, letter, payload), 2.0 + number)
    last = max(received.first for received in bench.run(8.5) if received.frame.id == other.upper())
    assert (last > 8.0) is renews


def test_a_request_sends_one_frame_at_once_and_restarts_the_phase(bench):
    bench.send(stream("o", 50), 2.0)
    free = bench.send(stream("o", 50), 2.2)
    times = [received.first for received in bench.run(3.0) if received.first > 2.1]
    assert times[0] - free < 1e-3
    assert times[1] - times[0] == pytest.approx(0.5, abs=2e-3)


@pytest.mark.parametrize(
    ("loop_ms", "rate", "low", "high"), [(0.1, 50, 0.0, 0.0), (1.0, 40, 0.0, 0.0), (1.0, 50, 0.42, 0.58)]
)
def test_b_is_forwarded_a_character_a_pass(loop_ms, rate, low, high):
    bench = nc_bench(loop_time=loop_ms * 1e-3)
    frame = encode_frame(1, "b", bytes([0, 0, 0, 0, 1, 1, 0]))
    taken = []
    external = bench.board.flight.external
    take = external.take
    external.take = lambda raw: (taken.append(raw), take(raw))
    for number in range(400):
        bench.send(frame, 2.0 + number / rate)
    received = bench.run(2.5 + 400 / rate)
    assert low <= 1.0 - len(taken) / 400 <= high
    assert "B" not in bench.ids(received), "no confirmation through this NaviCtrl"


def test_forwarding_is_only_for_b_and_y_to_the_flightctrl(bench):
    for number, letter in enumerate("pnqgt"):
        bench.send(encode_frame(1, letter, bytes(16)), 2.0 + 0.1 * number)
    assert bench.ids(bench.run(3.0)) == ""
    bench.send(encode_frame(1, "y", bytes(range(12))), 3.0)
    bench.run(3.2)
    assert bench.board.flight.serial_channels == list(range(12))


FEEDING = [("z", False), ("b", False), ("y", False), ("v", True), ("a", True), ("o", True), ("j", True)]


@pytest.mark.parametrize(("letter", "feeds"), FEEDING)
def test_link_flag_sets_6_s_after_the_last_frame_that_counts(bench, letter, feeds):
    bench.send(encode_frame(2, "v"), 2.0)
    address = 1 if letter in "by" else 2
    for number in range(16):
        bench.send(encode_frame(address, letter, bytes(12)), 2.5 + 0.5 * number)
    bench.run(7.4)
    assert not bench.board.navigator.flags() & 0x10
    bench.run(9.4)
    assert bool(bench.board.navigator.flags() & 0x10) is not feeds


def test_an_sd_stall_keeps_what_comes_and_answers_late(bench):
    bench.aircraft.faults.start("nc_sd_stall", duration=1.5)
    bench.send(encode_frame(2, "v"), 1.2)
    bench.send(echo(7), 1.4)
    received = bench.run(3.0)
    assert sorted(bench.ids(received)) == ["V", "Z"]
    assert min(item.first for item in received) == pytest.approx(2.5, abs=0.02)


def test_a_long_stall_overflows_the_ring(bench):
    bench.aircraft.faults.start("nc_sd_stall", duration=2.0)
    for number in range(100):
        bench.send(encode_frame(2, "j", bytes([1, number, 5, 0])), 1.1 + 0.01 * number)
    bench.run(4.0)
    assert bench.board.rx.overflowed > 0
    assert len(bench.board.parameters) == pytest.approx(512 / 14, abs=2)


@pytest.mark.parametrize(("chars", "accepted"), [(146, True), (150, True), (154, False), (400, False)])
def test_longest_frame(bench, chars, accepted):
    frame = encode_frame(2, "v", bytes((chars - 6) // 4 * 3))
    assert abs(len(frame) - chars) < 4
    assert (bench.ask(frame, 2.0) is not None) is accepted
    assert bench.ask(encode_frame(2, "v"), 3.0) is not None


@pytest.mark.parametrize("debris", [b"#", b"#cz", b"#c#cz=", b"##", b"text\r", b"\x1b\x1b"])
def test_any_hash_restarts_a_frame(bench, debris):
    received = bench.ask(debris + encode_frame(2, "v"), 2.0)
    assert received.frame.id == "V"


@pytest.mark.parametrize("address", range(28))
def test_every_address_reaches_the_common_set(bench, address):
    received = bench.ask(encode_frame(address, "v"), 2.0)
    assert received.frame.address == 2


@pytest.mark.parametrize("letter", ["z", "e", "x", "j"])
def test_other_commands_want_the_own_address(bench, letter):
    assert bench.ask(encode_frame(1, letter, b"\x01\x00\x00\x00"), 2.0) is None
    assert bench.ask(encode_frame(2, letter, b"\x01\x00\x00\x00"), 3.0) is not None


def test_r_jumps_to_the_boot_loader_and_stays_there(bench):
    bench.send(encode_frame(2, "R"), 2.0)
    bench.run(2.5)
    assert bench.ask(encode_frame(2, "v"), 30.0) is None
