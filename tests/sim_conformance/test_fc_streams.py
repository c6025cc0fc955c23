"""FlightCtrl: subscriptions, starvation, deaf times (docs/firmware-notes, "Subscriptions", "Losses", "Timing")."""

from __future__ import annotations

import itertools

import pytest

from mkdaemon.protocol.framing import DropReason, encode_frame
from mksim.config import GasLaw
from tests.sim_conformance.bench import fc_bench, median

V2 = bytes([0, 0, 0, 0, 1, 1, 0])
KINDS = {"d": "D", "c": "C", "h": "H"}


def request(letter, interval):
    return encode_frame(1, letter, bytes([0xFF, interval]) if letter == "h" else bytes([interval]))


@pytest.mark.parametrize(("interval", "period_ms"), [(2, 24.9), (10, 107.8), (100, 1039.0)])
def test_debug_period(interval, period_ms):
    bench = fc_bench(gas_law=GasLaw.FORK)
    bench.send(request("d", interval), 1.1)
    times = [received.first for received in bench.run(1.1 + 12 * period_ms * 1e-3) if received.frame.id == "D"]
    assert median(b - a for a, b in itertools.pairwise(times)) * 1e3 == pytest.approx(period_ms, rel=0.05)


@pytest.fixture
def bench():
    return fc_bench()


@pytest.mark.parametrize("letter", ["d", "c", "h"])
def test_stream_ends_4_1_s_after_the_last_renewal(bench, letter):
    bench.send(request(letter, 10), 1.1)
    bench.send(request(letter, 10), 3.0)
    last = max(received.first for received in bench.run(12.0) if received.frame.id == KINDS[letter])
    assert last - 3.0 == pytest.approx(4.1, abs=0.15)


def test_the_fork_never_stops_debug():
    bench = fc_bench(gas_law=GasLaw.FORK)
    bench.send(request("d", 50), 1.1)
    assert max(received.first for received in bench.run(40.0)) > 39.0


RENEWALS = [("c", True), ("d", True), ("h", True), ("t", True), ("b", False), ("v", False), ("a", False), ("g", False)]


@pytest.mark.parametrize(("letter", "renews"), RENEWALS)
def test_what_renews(letter, renews):
    payloads = {"c": b"\x0a", "d": b"\x00", "h": b"\xff\x00", "t": bytes(16), "b": V2, "a": b"\x00"}
    bench = fc_bench()
    stream = "c" if letter != "c" else "d"
    bench.send(request(stream, 20), 1.1)
    for number in range(8):
        bench.send(encode_frame(1, letter, payloads.get(letter, b"")), 2.0 + number)
    last = max(received.first for received in bench.run(10.0) if received.frame.id == KINDS[stream])
    assert (last > 9.0) is renews


def test_fast_debug_starves_confirmations_attitude_and_receiver(bench):
    bench.send(request("c", 5), 1.1)
    bench.send(request("d", 1), 1.2)
    for number in range(20):
        bench.send(encode_frame(1, "b", V2), 1.5 + 0.1 * number)
        bench.send(encode_frame(1, "p"), 1.55 + 0.1 * number)
    assert set(bench.ids(received for received in bench.run(3.5) if received.first > 1.3)) == {"D"}


@pytest.mark.parametrize("interval", [2, 3, 5, 10])
def test_slower_debug_lets_the_confirmation_through_within_25_ms(bench, interval):
    bench.send(request("d", interval), 1.1)
    for number in range(25):
        at = 1.5 + 0.0613 * number
        free = bench.send(encode_frame(1, "b", V2), at)
        confirmed = [received for received in bench.run(at + 0.06) if received.frame.id == "B"]
        assert confirmed
        assert confirmed[0].last - free < 25e-3


def test_a_label_asked_for_during_a_fast_stream_collides_and_is_still_readable(bench):
    bench.send(request("d", 1), 1.1)
    for number in range(32):
        bench.send(encode_frame(1, "a", bytes([number])), 1.5 + 0.06 * number)
    bench.run(4.0)
    raw = b"".join(byte for _, byte in bench.raw)
    assert b"##bA" in raw
    assert [received.frame.payload[0] for received in bench.received if received.frame.id == "A"] == list(range(32))
    assert {drop.reason for drop in bench.dropped} == {DropReason.LENGTH}


def parameter_set(bench):
    return bench.board.eeprom.sets[3]


DEAF = [
    # what, frame payload letter, seconds until the next frame is handled, from firmware notes
    ("m", lambda bench: encode_frame(1, "m", bench.board.eeprom.mixer), 0.3),
    ("q13", lambda bench: encode_frame(1, "q", b"\x0d"), 0.5),
    ("q23", lambda bench: encode_frame(1, "q", b"\x17"), 0.5),
    ("R", lambda bench: encode_frame(1, "R"), 4.95),
]
DEAF_WITHOUT_A_BUFFER = [
    ("s", lambda bench: encode_frame(1, "s", b"\x03" + parameter_set(bench)), 1.33),
    ("f", lambda bench: encode_frame(1, "f", b"\x03"), 0.73),
    ("o", lambda bench: encode_frame(1, "o", (100).to_bytes(2, "little") + b"\x01"), 0.29),
    ("e", lambda bench: encode_frame(1, "e"), 0.85),
    ("r", lambda bench: encode_frame(1, "r", b"\x01"), 1.5),
]


@pytest.mark.parametrize(("make", "deaf_time"), [row[1:] for row in DEAF], ids=[row[0] for row in DEAF])
def test_deaf_times_keep_one_frame_and_answer_it_late(make, deaf_time):
    bench = fc_bench(gas_law=GasLaw.FORK)
    began = bench.send(make(bench), 2.0)
    # one frame is kept, the others are lost
    for number, letter in enumerate("vgg"):
        bench.send(encode_frame(1, letter), 2.0 + 0.05 + 0.3 * (letter == "v" and deaf_time > 4) + 0.03 * number)
    late = [received for received in bench.run(9.0) if received.frame.id in "VG"]
    assert late[0].frame.id == "V"
    assert late[0].first - began == pytest.approx(deaf_time, rel=0.15, abs=0.02)
    assert [received.frame.id for received in late if received.first - began < deaf_time + 0.05] == ["V"]


@pytest.mark.parametrize(
    ("make", "deaf_time"), [row[1:] for row in DEAF_WITHOUT_A_BUFFER], ids=[row[0] for row in DEAF_WITHOUT_A_BUFFER]
)
def test_deaf_times_in_which_every_frame_is_lost(make, deaf_time):
    bench = fc_bench(gas_law=GasLaw.FORK)
    began = bench.send(make(bench), 2.0)
    for number in range(60):
        bench.send(encode_frame(1, "v"), 2.05 + 0.03 * number)
    answers = [received.first - began for received in bench.run(5.0) if received.frame.id == "V"]
    assert answers[0] == pytest.approx(deaf_time, abs=0.05)


def test_j_is_deaf_until_power_off(bench):
    bench.send(encode_frame(1, "j", b"\x01"), 2.0)
    assert bench.ask(encode_frame(1, "v"), 3.0) is None
    assert bench.ask(encode_frame(1, "v"), 60.0) is None
    bench.aircraft.faults.start("fc_reboot")
    bench.run(61.0)
    assert bench.ask(encode_frame(1, "v"), 70.0) is not None


@pytest.mark.parametrize(("companion", "period"), [(False, 0.099), (True, 0.999)])
def test_early_firmware_feeds_a_compass_unasked(companion, period):
    bench = fc_bench("early")
    if companion:
        bench.board.adopt_companion((0, 24, 1))
    times = [item.first for item in bench.run(6.0) if (item.frame.address, item.frame.id) == (3, "w")][2:]
    assert all(b - a == pytest.approx(period, abs=4e-3) for a, b in itertools.pairwise(times))
    assert len(times) >= 3


@pytest.mark.parametrize("word", ["2.08", "2.12a", "2.14"])
def test_later_firmware_says_nothing_unasked(word):
    bench = fc_bench(word)
    bench.run(5.0)
    assert bench.raw == []
