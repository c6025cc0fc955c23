"""FlightCtrl: what a genuine 2.12a fork showed on a second look (docs/firmware-notes, 1, 6 and 7)."""

from __future__ import annotations

import pytest

from mkdaemon.protocol.flags import FlightStatus2
from mkdaemon.protocol.framing import encode_frame
from mksim.boards.line import HOST_CHAR
from mksim.config import GasLaw
from tests.sim_conformance.bench import fc_bench, median, moments


def control(*, pitch=0, number=0, config=1):
    return encode_frame(1, "b", bytes([pitch & 0xFF, 0, 0, 0, number, config, 0]))


def rebooting(at=2.0):
    """A fork that was reset at `at` [s]."""
    bench = fc_bench(gas_law=GasLaw.FORK)
    bench.run(at)
    bench.aircraft.faults.start("fc_reboot")
    return bench


def test_boot_text_has_628_characters():
    bench = rebooting()
    bench.run(9.0)
    text = b"".join(byte for _, byte in bench.raw)
    assert len(text) == 628
    assert bench.received == []
    assert max(at for at, _ in bench.raw) < 2.0 + 4.7


def test_the_first_stick_frame_of_a_boot_is_obeyed_afterwards_until_its_own_time_out():
    bench = rebooting()
    bench.send(control(pitch=40), 2.5)
    for number in range(10):
        bench.send(control(pitch=10), 3.0 + 0.1 * number)
    external = bench.board.external
    bench.run(2.0 + 4.6)
    assert not external.is_valid
    bench.run(2.0 + 4.8)
    assert external.is_valid
    assert external.held.pitch == 40
    assert bench.board.core.controlled
    bench.run(2.0 + 8.7)
    assert external.is_valid
    bench.run(2.0 + 8.9)
    assert not external.is_valid


def beep(length, count):
    return encode_frame(1, "o", length.to_bytes(2, "little") + bytes([count]))


@pytest.mark.parametrize(("length", "count", "deaf"), [(500, 1, 1.12), (500, 2, 2.16), (30000, 200, 600.0)])
def test_deaf_time_of_the_beep(length, count, deaf):
    bench = fc_bench(gas_law=GasLaw.FORK)
    done = bench.send(beep(length, count), 2.0)
    for number in range(200):
        bench.send(encode_frame(1, "v"), 2.1 + 0.02 * number)
    answers = [received.first - done for received in bench.run(6.2) if received.frame.id == "V"]
    if deaf > 4.0:
        assert answers == []
    else:
        assert answers[0] == pytest.approx(deaf, abs=0.03)


def test_motor_controller_settings_take_61_to_67_ms():
    bench = fc_bench(gas_law=GasLaw.FORK)
    frame = encode_frame(1, "u", b"\x01")
    times = []
    for at in moments(6, 40, 0.2):
        received = bench.ask(frame, at, 0.15)
        times.append((received.last - at - len(frame) * HOST_CHAR) * 1e3)
    assert 61.0 <= median(times) <= 67.0


@pytest.mark.parametrize(("flown", "emergency"), [(1.8, False), (2.3, True)])
def test_emergency_throttle_needs_two_seconds_of_flight(flown, emergency):
    bench = fc_bench()
    bench.run(2.0)
    bench.board.core.start()
    bench.run(2.0 + flown)
    bench.aircraft.pilot.rc_quality = 0
    bench.run(2.0 + flown + 0.5)
    assert bench.board.core.emergency is emergency
    assert bench.board.core.running is emergency


@pytest.mark.parametrize(("gate", "on"), [(0, False), (177, False), (196, False), (198, True), (255, True)])
def test_height_control_follows_the_value_of_its_channel(gate, on):
    """The factory's altitude channel is receiver channel 5: poti 1, the switch of the external-control gate."""
    bench = fc_bench()
    with_height_control(bench)
    bench.aircraft.pilot.gate = gate
    bench.run(2.0)
    assert bench.board.core.height_control is on


def test_height_control_goes_off_below_50_is_told_to_the_loop_and_shown():
    bench = fc_bench()
    with_height_control(bench)
    core = bench.board.core
    core.start()
    seen = []
    for gate in (255, 180, 175, 190, 255):
        bench.aircraft.pilot.gate = gate
        bench.run(bench.board.now + 0.2)
        seen.append(core.height_control)
        assert bench.aircraft.sticks[-1][1].height_control is seen[-1]
        assert bool(core.status_2() & FlightStatus2.ALTITUDE_CONTROL) is seen[-1]
    assert seen == [True, True, False, False, True]


def with_height_control(bench):
    live = bench.board.live
    raw = live.with_value("global_config", live["global_config"] | 1)
    bench.board.live = type(live)(raw)
    assert bench.board.live["altitude_channel"] == 5
