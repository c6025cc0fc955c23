"""External control: gate, gas laws, dead-man, gestures, reception (docs/firmware-notes 6, docs/safety.md)."""

from __future__ import annotations

import numpy as np
import pytest

from mkdaemon.protocol.flags import FlightStatus
from mkdaemon.protocol.framing import encode_frame
from mksim.config import GasLaw
from tests.sim_conformance.bench import fc_bench

GENERATIONS = ["early", "2.08", "2.12a", "2.14"]


def control(word, *, pitch=0, roll=0, yaw=0, gas=0, frame=1, config=1):
    """A `b` frame in the layout of a generation; gas on the stick scale."""
    sticks = [value & 0xFF for value in (pitch, roll, yaw)]
    if word in ("early", "2.08"):
        return encode_frame(1, "b", bytes([0, 0, 0, *sticks, gas + 127, 0, 0, frame, config]))
    tail = [0] if word == "2.12a" else [0, 0, 0]
    return encode_frame(1, "b", bytes([*sticks, gas & 0xFF, frame, config, *tail]))


def started(word, **options):
    """Motors running, pilot at half throttle."""
    bench = fc_bench(word, **options)
    bench.board.core.start()
    bench.run(1.6)
    return bench


def sticks(bench):
    return bench.aircraft.sticks[-1][1]


def steered(word, given, *, options=None, **pilot):
    """The board and the sticks that it flies with after one `b` frame, and what the pilot does."""
    bench = started(word, **(options or {}))
    for name, value in pilot.items():
        setattr(bench.aircraft.pilot, name, value)
    bench.send(control(word, **given), 2.0)
    bench.run(2.1)
    return bench.board, sticks(bench)


@pytest.mark.parametrize("word", GENERATIONS)
@pytest.mark.parametrize(
    ("parameter", "gate", "config", "acts"),
    [
        (0, 255, 1, False),
        (128, 255, 1, False),
        (129, 0, 1, True),
        (255, 128, 1, False),
        (255, 129, 1, True),
        (255, 255, 1, True),
        (255, 255, 0, False),
        (254, 255, 1, False),
    ],
)
def test_the_gate_must_be_above_128_and_bit_0_of_config_set(word, parameter, gate, config, acts):
    given = {"pitch": 40, "config": config}
    _, flown = steered(word, given, options={"gate_parameter": parameter}, gate=gate)
    assert flown.pitch == (40 if acts else 0)


@pytest.mark.parametrize(("word", "yaw"), [("early", -30), ("2.08", -30), ("2.12a", 30), ("2.14", 30)])
def test_sticks_are_added_and_yaw_has_two_signs(word, yaw):
    _, flown = steered(word, {"pitch": 30, "roll": 30, "yaw": 30}, pitch=10, roll=-20, yaw=5)
    assert (flown.pitch, flown.roll, flown.yaw) == (40, 10, 5 + yaw)


GAS = [
    # law, generation, pilot's gas, value, config, mixed gas on the stick scale
    (GasLaw.STOCK, "2.12a", 20, -50, 0x01, -50),
    (GasLaw.STOCK, "2.12a", -60, -50, 0x01, -60),
    (GasLaw.STOCK, "2.12a", -60, 30, 0x03, -30),
    (GasLaw.STOCK, "2.12a", 60, 60, 0x03, 120),
    (GasLaw.FORK, "2.12a", -60, 50, 0x01, 50),
    (GasLaw.FORK, "2.12a", 60, -50, 0x01, -50),
    (GasLaw.STOCK, "2.08", 20, -50, 0x01, -50),
    (GasLaw.STOCK, "2.08", -60, 40, 0x01, -60),
    (GasLaw.STOCK, "early", 20, -50, 0x01, -50),
    (GasLaw.FORK, "2.08", -60, 50, 0x01, 50),
    (GasLaw.STOCK, "2.14", 20, -50, 0x01, -50),
    (GasLaw.STOCK, "2.14", -127, -20, 0x41, -20),
]


@pytest.mark.parametrize(("law", "word", "pilot", "value", "config", "mixed"), GAS)
def test_gas_laws(law, word, pilot, value, config, mixed):
    board, flown = steered(word, {"gas": value, "config": config}, options={"gas_law": law}, gas=pilot)
    assert board.core.mixed.throttle == mixed
    # Gas_Max 230 keeps a margin of 20 for the mixer
    assert flown.gas == min(mixed + 127, 210)


DEAD_MAN = [
    # generation, hold [s], letters that keep the sticks, letters that do not
    ("early", 0.5, "abcdghlvt", ""),
    ("2.08", 5.25, "abdhlpt", "cvgnuq"),
    ("2.12a", 2.05, "b", "acdhlvgnpt"),
    ("2.14", 2.05, "b", "acdhlvgnpt"),
]


@pytest.mark.parametrize(("word", "hold_time"), [row[:2] for row in DEAD_MAN])
def test_silence_ends_control_and_gas_falls_to_the_pilots_stick(word, hold_time):
    bench = started(word)
    bench.aircraft.pilot.gas = 10
    free = bench.send(control(word, pitch=25, gas=-20), 2.0)
    bench.run(2.1)
    assert (sticks(bench).pitch, sticks(bench).gas) == (25, 107)
    bench.run(9.0)
    changed = next(at for at, told in bench.aircraft.sticks if at > 2.1 and told.pitch == 0)
    assert changed - free == pytest.approx(hold_time, rel=0.05, abs=0.03)
    assert sticks(bench).gas == 137
    assert sticks(bench).motors_running
    assert not bench.board.external.is_valid


@pytest.mark.parametrize(
    ("word", "hold_time", "letter", "keeps"),
    [(word, hold_time, letter, letter in yes) for word, hold_time, yes, no in DEAD_MAN for letter in yes + no],
)
def test_what_refreshes_the_dead_man(word, hold_time, letter, keeps):
    bench = started(word)
    bench.send(control(word, pitch=25), 2.0)
    payload = {"h": b"\xff\x00", "t": bytes(16), "u": b"\x01", "q": b"\xff"}.get(letter, b"\x00")
    frame = control(word, pitch=25) if letter == "b" else encode_frame(1, letter, payload)
    for number in range(30):
        bench.send(frame, 2.1 + number * 0.4)
    bench.run(14.0)
    held = next((at for at, told in bench.aircraft.sticks if at > 2.1 and told.pitch == 0), 14.5) - 2.0
    assert held > 11.6 if keeps else held == pytest.approx(hold_time, rel=0.05, abs=0.03)


def test_control_needs_a_good_receiver_and_emergency_throttle_lasts_9_2_s():
    bench = started("2.12a")
    bench.run(4.0)
    bench.send(control("2.12a", pitch=40), 4.0)
    bench.run(4.1)
    bench.aircraft.pilot.rc_quality = 0
    for number in range(40):
        bench.send(control("2.12a", pitch=40), 4.1 + 0.05 * number)
    bench.run(4.5)
    assert bench.board.core.emergency
    began = next(at for at, told in bench.aircraft.sticks if at > 4.1 and told.gas == 65)
    assert began - 4.1 <= 0.3
    assert sticks(bench).pitch == 0
    bench.run(20.0)
    ended = next(at for at, told in bench.aircraft.sticks if at > began and not told.motors_running)
    assert ended - began == pytest.approx(9.2, rel=0.02)


def test_newer_firmware_may_fly_without_a_transmitter_when_told_to():
    bench = started("2.14")
    bench.aircraft.pilot.rc_quality = 0
    for number in range(100):
        bench.send(control("2.14", pitch=40, gas=-10, config=0xC1), 1.6 + 0.05 * number)
    bench.run(6.0)
    assert not bench.board.core.emergency
    assert sticks(bench).pitch == 40


CORNER = {"pitch": -127, "roll": 127, "gas": -127}


def hold(bench, word, begin, seconds, **values):
    at = begin
    while at < begin + seconds:
        bench.send(control(word, **values), at)
        at += 0.05
    bench.run(begin + seconds + 0.2)
    bench.send(control(word), begin + seconds + 0.2)
    return bench.run(begin + seconds + 0.5)


@pytest.mark.parametrize("word", ["2.12a", "2.14"])
def test_gestures_arm_and_stop_through_b_in_flight_too(word):
    bench = fc_bench(word)
    hold(bench, word, 2.0, 0.8, **CORNER, yaw=-127)
    assert not bench.board.core.running, "a second is needed"
    hold(bench, word, 4.0, 1.4, **CORNER, yaw=-127)
    assert bench.board.core.running
    bench.run(7.0)
    assert bench.board.core.flying
    hold(bench, word, 7.0, 1.4, **CORNER, yaw=127)
    assert not bench.board.core.running


@pytest.mark.parametrize("word", ["early", "2.08"])
def test_old_firmware_cannot_be_armed_through_b(word):
    bench = fc_bench(word)
    hold(bench, word, 2.0, 2.0, **CORNER, yaw=127)
    hold(bench, word, 5.0, 2.0, **CORNER, yaw=-127)
    assert not bench.board.core.running


@pytest.mark.parametrize(
    "spoil",
    [
        pytest.param(lambda bench: setattr(bench.board.core, "calibrated", False), id="not calibrated"),
        pytest.param(lambda bench: setattr(bench.aircraft.pilot, "rc_quality", 120), id="weak receiver"),
        pytest.param(lambda bench: setattr(bench.board, "companion_error", 5), id="NaviCtrl error"),
        pytest.param(lambda bench: setattr(bench.aircraft.pilot, "gate", 0), id="gate closed"),
    ],
)
def test_arming_is_refused(spoil):
    bench = fc_bench()
    spoil(bench)
    bench.board.core.quality = min(bench.board.core.quality, bench.aircraft.pilot.rc_quality)
    hold(bench, "2.12a", 2.0, 1.5, **CORNER, yaw=-127)
    assert not bench.board.core.running


def test_without_pulses_sticks_are_looked_at_twice_a_second():
    bench = started("2.14")
    bench.run(4.0)
    bench.aircraft.pilot.rc_quality = 0
    bench.send(control("2.14", config=0xC1), 4.2)
    bench.run(5.2)
    for number in range(60):
        bench.send(control("2.14", pitch=1 + number, config=0xC1), 5.2 + 0.1 * number)
    bench.run(11.2)
    gaps = np.diff([at for at, _ in bench.aircraft.sticks if at > 5.4])
    assert gaps.size
    assert gaps == pytest.approx(0.53, abs=0.02)


@pytest.mark.parametrize(
    ("choice", "active"),
    # sticks held while calibrating, set made active: left 1, left forward 2, forward 3, right forward 4, right 5
    [
        ({"roll": 127}, 1),
        ({"roll": 127, "pitch": 127}, 2),
        ({"pitch": 127}, 3),
        ({"roll": -127, "pitch": 127}, 4),
        ({"roll": -127}, 5),
        ({}, 3),
    ],
)
def test_calibrating_chooses_a_parameter_set(choice, active):
    bench = fc_bench(gas_law=GasLaw.FORK, calibrated=False)
    hold(bench, "2.12a", 2.0, 1.0, gas=127, yaw=127, **choice)
    assert bench.board.eeprom.active == active
    assert bench.board.live.raw == bench.board.eeprom.sets[active]


@pytest.mark.parametrize(("voltage", "low"), [(12.4, False), (9.7, False), (9.5, True)])
def test_low_battery_counts_per_cell(voltage, low):
    bench = started("2.12a")
    bench.aircraft.sensors.battery_voltage = voltage
    assert bool(bench.board.core.status(bench.board.live) & FlightStatus.LOW_BATTERY) is low
