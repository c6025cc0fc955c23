"""NaviCtrl 2.14: data sets, motor status, time, external control of its own (docs/protocol.md, 8 and 8.1)."""

from __future__ import annotations

import itertools

import pytest

from mkdaemon.protocol.decoder import MessageDecoder
from mkdaemon.protocol.errorcodes import ErrorCode
from mkdaemon.protocol.framing import encode_frame
from mkdaemon.protocol.messages import OsdVolatile
from mksim.physics.attitude_loop import LEAK_FAST, LEAK_SLOW
from tests.sim_conformance.bench import nc_bench

LENGTHS = {10: 26, 11: 34, 12: 38, 13: 46, 14: 38, 15: 30, 16: 42}
"""Frame characters of each data set."""


def bench_2x():
    return nc_bench("2.14", fc="2.14")


def wanted(interval, budget):
    return encode_frame(2, "o", bytes([interval]) + budget.to_bytes(2, "little"))


@pytest.fixture
def bench():
    return bench_2x()


def test_three_bytes_ask_for_all_data_sets_and_one_byte_for_navidata_5(bench):
    bench.send(wanted(5, 0x8000), 2.0)
    sets = [received.frame for received in bench.run(3.0) if received.frame.id == "O"]
    assert {frame.payload[0]: len(frame.raw) for frame in sets} == LENGTHS
    bench.send(encode_frame(2, "o", b"\x0a"), 4.0)
    later = bench.run(4.5)
    assert {(item.frame.payload[0], len(item.frame.raw)) for item in later if item.first > 4.01} == {(5, 118)}


@pytest.mark.parametrize("budget", [200, 500, 1024])
def test_the_byte_budget_is_kept(bench, budget):
    for number in range(6):
        bench.send(wanted(1, budget), 2.0 + 2.0 * number)
    sent = sum(len(item.frame.raw) for item in bench.run(14.0) if 3.0 < item.first < 13.0)
    assert 0.6 * budget < sent / 10.0 <= 1.05 * budget


def test_the_sets_agree_with_the_aircraft(bench):
    bench.aircraft.sensors.battery_voltage = 11.1
    bench.aircraft.sensors.baro_height = 3.0
    bench.send(wanted(2, 0x8000), 2.0)
    decoder = MessageDecoder()
    messages = [decoder.decode(item.frame) for item in bench.run(3.0)]
    volatile = next(message for message in messages if isinstance(message, OsdVolatile))
    assert volatile.battery == 111
    assert {message.altimeter for message in messages} == {60}
    assert {message.longitude for message in messages} == {74591000}


def test_motor_status_comes_one_motor_a_frame(bench):
    bench.send(encode_frame(2, "k", b"\x05"), 2.0)
    frames = [item.frame for item in bench.run(7.0) if item.frame.id == "K"]
    assert {len(frame.raw) for frame in frames} == {14}
    assert {frame.payload[0] for frame in frames if frame.payload[4] & 0x80} == {0, 1, 2, 3}
    assert len(frames) == pytest.approx(80, abs=3), "4 s at 50 ms: the shared timer ends it too"


@pytest.mark.parametrize("letter", ["k", "t", "b"])
def test_the_older_board_knows_none_of_it(letter):
    assert nc_bench().ask(encode_frame(2, letter, bytes([1, 0, 0, 0, 9, 1, 0, 0, 0])), 2.0) is None


@pytest.mark.parametrize("address", [1, 2])
def test_b_is_taken_and_confirmed_by_the_navictrl_itself(bench, address):
    bench.board.flight.core.start()
    free = bench.send(encode_frame(address, "b", bytes([40, 0, 0, 0, 9, 1, 0, 0, 0])), 2.0)
    (confirmed,) = [item for item in bench.run(2.3) if item.frame.id == "B"]
    assert (confirmed.frame.address, confirmed.frame.payload[0]) == (2, 9)
    acted = next(at for at, told in bench.aircraft.sticks if told.pitch == 40)
    assert confirmed.first < acted
    assert acted - free < 0.08


@pytest.mark.parametrize(("rate", "share"), [(20, 1.0), (40, 1.0), (50, 0.9), (100, 0.45)])
def test_the_newest_b_reaches_the_flightctrl_with_every_exchange(bench, rate, share):
    taken = []
    external = bench.board.flight.external
    take = external.take
    external.take = lambda raw: (taken.append(bench.board.now), take(raw))
    for number in range(200):
        bench.send(encode_frame(2, "b", bytes([number % 100, 0, 0, 0, 1, 1, 0, 0, 0])), 2.0 + number / rate)
    bench.run(2.5 + 200 / rate)
    assert len(taken) >= share * 200
    assert max(b - a for a, b in itertools.pairwise(taken)) < 2 * max(0.0201, 1 / rate)


@pytest.mark.parametrize("fc", ["early", "2.08"])
def test_an_old_flightctrl_is_named_and_never_steered(fc):
    bench = nc_bench("2.14", fc=fc)
    before = bench.board.flight.external.held
    bench.send(encode_frame(2, "b", bytes([40, 0, 0, 0, 9, 1, 0, 0, 0])), 2.0)
    bench.run(2.5)
    assert bench.board.flight.external.held == before
    assert bench.board.navigator.error_code is ErrorCode.FC_INCOMPATIBLE
    assert bench.board.flight.companion_error == 1, "its motors do not start"


@pytest.mark.parametrize(("word", "fc", "leak"), [("0.24", "2.12a", LEAK_FAST), ("2.14", "2.14", LEAK_SLOW)])
def test_a_newer_navictrl_slows_the_leak_of_the_attitude_loop(word, fc, leak):
    assert nc_bench(word, fc=fc).aircraft.gains.ta == leak
