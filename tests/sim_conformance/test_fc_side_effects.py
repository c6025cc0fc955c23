"""FlightCtrl: settings, mixer, motor test, motor controllers, reset (docs/firmware-notes 7; docs/protocol.md 7, 12)."""

from __future__ import annotations

import json
import struct

import pytest

from mkdaemon.errors import ConfigError
from mkdaemon.protocol.framing import encode_frame
from mksim.boards.eeprom import Eeprom, bl_checksum
from mksim.physics.attitude_loop import AGILE, EASY, AttitudeGains
from tests.sim_conformance.bench import fc_bench

GENERATIONS = ["early", "2.08", "2.12a", "2.14"]


def ask(bench, letter, payload=b"", patience=1.0):
    return bench.ask(encode_frame(1, letter, payload), bench.board.now + 0.01, patience)


@pytest.mark.parametrize("word", GENERATIONS)
def test_reading_another_set_loads_it_into_ram_and_255_brings_the_active_one_back(word):
    bench = fc_bench(word)
    active, fast = bench.board.eeprom.sets[3], bench.board.eeprom.sets[1]
    gains = bench.aircraft.gains
    received = ask(bench, "q", b"\x01")
    assert received.frame.payload[0] == 1
    assert bench.board.live.raw == fast
    assert bench.aircraft.gains != gains, "it is flown with"
    assert bench.board.eeprom.active == 3
    received = ask(bench, "q", b"\xff")
    assert received.frame.payload[0] == 3
    assert bench.board.live.raw == active
    assert bench.aircraft.gains == gains


@pytest.mark.parametrize(
    ("word", "shipped", "filtered"),
    [
        ("early", AGILE | {"stick_yaw_p": 6}, False),  # its set 3 is Beginner: what is Agile later
        ("2.08", EASY | {"stick_yaw_p": 4}, False),
        ("2.12a", EASY | {"stick_yaw_p": 4}, True),
        ("2.14", EASY | {"stick_yaw_p": 4}, True),
    ],
)
def test_gains_come_from_the_set_in_ram(word, shipped, filtered):
    bench = fc_bench(word)
    assert bench.aircraft.gains == AttitudeGains.from_parameters(**shipped, stick_filter=filtered)


@pytest.fixture
def bench():
    return fc_bench()


@pytest.mark.parametrize(
    ("asked", "number", "keeps"),
    [(10, 1, True), (11, 1, True), (14, 4, True), (19, 5, True), (20, 1, False), (22, 2, False), (29, 5, False)],
)
def test_resetting_a_set(bench, asked, number, keeps):
    eeprom = bench.board.eeprom
    factory = eeprom.sets[number]
    changed = bytearray(factory)
    changed[1], changed[23] = 9, 99
    eeprom.sets[number] = bytes(changed)
    received = ask(bench, "q", bytes([asked]))
    assert received.frame.payload[0] == number
    assert eeprom.active == number
    assert eeprom.sets[number][23] == factory[23]
    assert eeprom.sets[number][1] == (9 if keeps else factory[1])


@pytest.mark.parametrize("word", GENERATIONS)
def test_writing_a_set_activates_it(word):
    bench = fc_bench(word)
    eeprom = bench.board.eeprom
    changed = bytearray(eeprom.sets[2])
    place = bench.board.live.place("stick_p")
    changed[place] = 12
    received = ask(bench, "s", b"\x02" + bytes(changed), 1.5)
    assert (received.frame.id, received.frame.payload[0]) == ("S", 2)
    assert eeprom.active == 2
    assert eeprom.sets[2][place] == bench.board.live.raw[place] == 12


def test_values_out_of_range_are_pulled_in_on_writing(bench):
    raw = bytearray(bench.board.eeprom.sets[2])
    raw[27] = 255
    ask(bench, "s", b"\x02" + bytes(raw), 1.5)
    received = ask(bench, "q", b"\x02")
    assert received.frame.payload[1 + 27] == 247
    assert [i for i in range(144) if received.frame.payload[1 + i] != raw[i]] == [27]


def spoil_revision(raw):
    return bytes([raw[0] + 1]) + raw[1:]


@pytest.mark.parametrize(
    ("index", "spoil", "running"),
    [(0, bytes, False), (6, bytes, False), (255, bytes, False), (2, spoil_revision, False), (2, bytes, True)],
)
def test_writing_is_refused_with_s_0(bench, index, spoil, running):
    if running:
        bench.board.core.start()
    before = dict(bench.board.eeprom.sets)
    received = ask(bench, "s", bytes([index]) + spoil(before[2]))
    assert (received.frame.id, received.frame.payload[0]) == ("S", 0)
    assert (bench.board.eeprom.sets, bench.board.eeprom.active) == (before, 3)


@pytest.mark.parametrize(
    ("word", "letter", "payload", "answer"),
    [  # 2.12a answers the set in use
        ("2.12a", "q", b"\x01", "Q"),
        ("2.08", "q", b"\x01", None),
        ("2.12a", "q", b"\x0b", "Q"),
        ("2.12a", "f", b"\x01", None),
        ("2.12a", "j", b"\x01", None),
        ("2.12a", "n", b"", "N"),
    ],
)
def test_while_motors_run_settings_do_not_change(word, letter, payload, answer):
    bench = fc_bench(word)
    bench.board.core.start()
    live, stored = bench.board.live.raw, dict(bench.board.eeprom.sets)
    received = ask(bench, letter, payload)
    assert (received.frame.id if received else None) == answer
    assert (bench.board.live.raw, bench.board.eeprom.sets) == (live, stored)
    assert ask(bench, "v") is not None


@pytest.mark.parametrize("running", [False, True])
def test_the_mixer_is_written_in_flight_too(bench, running):
    if running:
        bench.board.core.start()
    table = bytearray(bench.board.eeprom.mixer)
    table[13] = 60
    received = ask(bench, "m", bytes(table))
    assert (received.frame.id, received.frame.payload[0]) == ("M", 1)
    assert bench.board.eeprom.mixer == bytes(table)
    table[0] = 2
    received = ask(bench, "m", bytes(table))
    assert received.frame.payload[0] == 0


def test_motor_test_lasts_half_a_second(bench):
    bench.send(encode_frame(1, "t", bytes([30] * 16)), 2.0)
    bench.run(2.4)
    assert bench.board.motors.setpoints(2.4) == [30] * 16
    bench.run(2.6)
    assert bench.board.motors.setpoints(2.6) is None


@pytest.mark.parametrize(
    ("motor", "running", "done", "status"), [(1, False, 1, 0), (0, False, 0, 6), (9, False, 0, 2), (1, True, 0, 1)]
)
def test_reading_motor_controllers(bench, motor, running, done, status):
    if running:
        bench.board.core.start()
    received = ask(bench, "u", bytes([motor]))
    assert received.frame.payload[:11] == bytes([done, status, motor]) + bytes.fromhex("0200ff1e6340006c")


def configuration(*, current=40, revision=2, spoil=0):
    raw = bytes([revision, 0x82, 255, current, 99, 64, 0])
    return raw + bytes([(bl_checksum(raw) + spoil) & 0xFF])


@pytest.mark.parametrize(
    ("motor", "raw", "done", "status", "changed"),
    [
        (1, configuration(), 1, 0, 1),
        (0, configuration(), 1, 0, 4),
        (9, configuration(), 0, 2, 0),
        (1, configuration(spoil=1), 0, 5, 0),
        (1, configuration(revision=1), 0, 4, 0),
    ],
)
def test_writing_motor_controllers(bench, motor, raw, done, status, changed):
    received = ask(bench, "w", bytes([motor]) + raw)
    assert received.frame.payload[:2] == bytes([done, status])
    assert sum(stored == raw for stored in bench.board.eeprom.motor_configs) == changed
    assert ask(bench, "w", b"\x01\x02\x03") is None, "a short one has no answer"


@pytest.mark.parametrize(
    ("word", "running", "resets"),
    [
        ("early", True, True),
        ("2.08", True, False),
        ("2.12a", True, False),
        ("2.12a", False, True),
        ("early", False, True),
    ],
)
def test_reset_in_flight(word, running, resets):
    bench = fc_bench(word)
    if running:
        bench.board.core.start()
    bench.send(encode_frame(7, "R"), 2.0)
    bench.run(3.0)
    assert bench.board.core.calibrated is not resets
    assert bench.board.core.running is (running and not resets)


def test_p_shows_serial_channels_and_sticks_and_the_gate_where_the_set_maps_them(bench):
    ask(bench, "y", bytes([10, 20, 30, 40, 50, 60, 70, 80, 90, 100, 110, 0x81]))
    pilot = bench.aircraft.pilot
    pilot.pitch, pilot.roll, pilot.gas, pilot.yaw, pilot.gate = 11, 22, 33, 44, 200
    bench.run(bench.board.now + 0.2)
    channels = struct.unpack_from("<35h", ask(bench, "p").frame.payload)
    assert channels[1:6] == (33, 22, 11, 44, 73)
    assert channels[17:29] == (10, 20, 30, 40, 50, 60, 70, 80, 90, 100, 110, -127)


@pytest.mark.parametrize(
    ("spoil", "says"),
    [
        ("{", "not a simulator EEPROM"),
        ("[]", "not a simulator EEPROM"),
        ('{"revision": 105}', "not a simulator EEPROM"),
        (lambda good: {**good, "revision": 105}, "revision 105"),
        (lambda good: {**good, "active": 9}, "incomplete"),
        (lambda good: {**good, "mixer": "00"}, "incomplete"),
        (lambda good: {**good, "sets": {"1": good["sets"]["1"]}}, "incomplete"),
    ],
)
def test_a_damaged_eeprom_file_is_named(tmp_path, spoil, says):
    path = tmp_path / "fc.json"
    Eeprom(106, path).save()
    path.write_text(spoil if isinstance(spoil, str) else json.dumps(spoil(json.loads(path.read_text()))))
    with pytest.raises(ConfigError, match=says) as caught:
        Eeprom(106, path)
    assert str(path) in str(caught.value)
