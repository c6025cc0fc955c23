"""NaviCtrl 0.24: what the genuine one showed on a second look (docs/firmware-notes, 8)."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from mkdaemon.protocol.errorcodes import ErrorCode
from mkdaemon.protocol.flags import FlightStatus, NaviStatus, PointType, PositionStatus
from mkdaemon.protocol.framing import encode_frame
from mkdaemon.protocol.messages import AttitudeDataNc, DebugDataNc, OsdData5, Waypoint024, WriteWaypoint024
from mksim.boards.flightctrl import FlightCtrl
from mksim.boards.generations import FC_GENERATIONS, NC_GENERATIONS
from mksim.boards.navictrl import NaviCtrl
from mksim.boards.navictrl_state import ESCAPE
from mksim.config import GasLaw
from tests.sim_conformance.bench import FIX, Bench, StillAircraft, fc_bench, median, nc_bench

HOME = (74591000, 532301000)
CLEAR = (0, PositionStatus.INVALID, PointType.INVALID)


def osd(bench):
    """Ask for one OSD frame."""
    received = bench.ask(encode_frame(2, "o", b"\x64"), bench.board.now + 0.01, 0.05)
    return OsdData5.decode(received.frame.payload)


def write(bench, index, status=PositionStatus.NEW, what=PointType.WAYPOINT, *, north=0, hold=0):
    point = WriteWaypoint024(
        longitude=HOME[0],
        latitude=HOME[1] + north,
        altitude=50,
        status=status,
        tolerance_radius=3,
        hold_time=hold,
        index=index,
        type=what,
    )
    received = bench.ask(point.to_frame(), bench.board.now + 0.01, 0.05)
    assert received.frame.id == "W"


def place(bench, *, north):
    bench.aircraft.sensors.gps = replace(FIX, latitude_1e7=FIX.latitude_1e7 + north)


def start(bench):
    bench.board.flight.core.start()
    bench.run(bench.board.now + 1.0)
    assert bench.board.flight.core.flying


def switch_to(bench, value):
    bench.aircraft.pilot.switches[2] = value
    bench.run(bench.board.now + 0.3)


COMING_HOME, FREE = 255, 0


@pytest.fixture
def bench():
    return nc_bench()


@pytest.mark.parametrize(("address", "letter"), [(2, "z"), (1, "b")])
def test_the_serial_link_flag_is_checked_once_a_second(bench, address, letter):
    for number in range(45):
        bench.send(encode_frame(address, letter, bytes(7)), 1.5 + 0.2 * number)
    bench.run(10.6)
    assert int(osd(bench).nc_flags) == 0x11, "this very request clears it at the next check only"
    bench.run(bench.board.now + 1.1)
    assert int(osd(bench).nc_flags) == 0x01


@pytest.mark.parametrize(
    ("letter", "interval", "frames"), [("o", 10, 40), ("d", 10, 40), ("c", 10, 40), ("h", 10, 40), ("o", 5, 80)]
)
def test_a_stream_ends_before_the_frame_that_is_due_with_the_time_out(bench, letter, interval, frames):
    bench.send(encode_frame(2, letter, b"\xff" * (letter == "h") + bytes([interval])), 2.0)
    times = [received.last for received in bench.run(9.0)]
    assert len(times) == frames
    assert times[-1] - 2.0 == pytest.approx(4.0 - 0.01 * interval + 0.02, abs=0.02)


TEXTS = [(0, [b"UART2 init", b"Timer2 deinit"]), (1, []), (2, [b"Timer2 deinit"])]


@pytest.mark.parametrize(("target", "texts"), TEXTS)
def test_text_of_a_redirection(bench, target, texts):
    bench.send(encode_frame(2, "u", bytes([target])), 2.0)
    bench.run(2.1)
    text = b"".join(byte for _, byte in bench.raw)
    assert [word for word in (b"UART2 init", b"Timer2 deinit") if word in text] == texts
    assert bool(text) is bool(texts)


SERVOS = [
    # redirections, each ended by the escape; the camera servos run afterwards
    ((0,), False),
    ((1,), True),
    ((2,), True),
    ((0, 1), True),
    ((2, 0), False),
]


@pytest.mark.parametrize(("targets", "run"), SERVOS)
def test_the_escape_restores_the_camera_servos_only_after_the_others(bench, targets, run):
    for number, target in enumerate(targets):
        bench.send(encode_frame(2, "u", bytes([target])), 2.0 + number)
        bench.run(2.3 + number)
        bench.send(ESCAPE, 2.5 + number)
        bench.run(2.7 + number)
    assert bench.board.navigator.camera_servos_on is run


@pytest.mark.parametrize(
    ("fault", "length", "run"),
    [("nc_reboot", None, True), ("spi_lost", 0.2, True), ("spi_lost", 0.05, False)],
)
def test_what_brings_the_camera_servos_back(bench, fault, length, run):
    bench.send(encode_frame(2, "u", b"\x00"), 2.0)
    bench.send(ESCAPE, 2.2)
    bench.run(2.5)
    bench.aircraft.faults.start(fault, duration=length)
    bench.run(6.0)
    assert bench.board.navigator.camera_servos_on is run


def test_a_silent_spi_bus_stops_the_camera_servos_for_50_exchanges_and_both_are_printed_amid_a_frame(bench):
    bench.send(encode_frame(2, "d", b"\x02"), 2.0)
    bench.run(2.5)
    bench.aircraft.faults.start("spi_lost", duration=0.2)
    bench.run(2.65)
    assert not bench.board.navigator.camera_servos_on
    bench.send(encode_frame(2, "d", b"\x00"), 3.9)
    bench.run(4.0)
    assert bench.board.navigator.camera_servos_on
    assert osd(bench).error_code is ErrorCode.NONE
    text = b"".join(byte for _, byte in bench.raw)
    stopped, started = text.index(b"Timer2 deinit...ok"), text.index(b"Timer2 init...ok")
    assert b"\r#" not in text[stopped : text.index(b"\r", stopped) + 1]
    assert bench.raw[started][0] - bench.raw[stopped][0] == pytest.approx(1.0 + 0.2 - 0.08, abs=0.05)


def test_a_point_written_in_flight_activates_the_list_and_does_not_fly_it(bench):
    start(bench)
    switch_to(bench, COMING_HOME)
    write(bench, *CLEAR)
    write(bench, 1, north=2000)
    write(bench, 2, north=4000)
    bench.run(bench.board.now + 3.0)
    shown = osd(bench)
    assert (shown.waypoint_index, shown.waypoint_count) == (1, 2)
    assert shown.target_latitude == HOME[1], "on to home until the switch is toggled"
    switch_to(bench, FREE)
    switch_to(bench, COMING_HOME)
    assert osd(bench).target_latitude == HOME[1] + 2000


def test_a_list_received_on_the_ground_is_not_flown(bench):
    write(bench, 1, north=2000)
    write(bench, 2, north=4000)
    start(bench)
    switch_to(bench, COMING_HOME)
    shown = osd(bench)
    assert (shown.waypoint_index, shown.waypoint_count) == (0, 2)
    assert (shown.target_longitude, shown.target_latitude) == HOME
    assert shown.nc_flags & NaviStatus.COMING_HOME


def test_after_the_last_point_it_flies_home(bench):
    start(bench)
    write(bench, 1, north=2000, hold=1)
    switch_to(bench, COMING_HOME)
    place(bench, north=2000)
    bench.run(bench.board.now + 0.5)
    assert osd(bench).target_latitude == HOME[1] + 2000
    bench.run(bench.board.now + 2.0)
    assert osd(bench).target_latitude == HOME[1]


def test_the_target_stays_when_the_list_is_cleared(bench):
    start(bench)
    write(bench, 1, north=2000)
    switch_to(bench, COMING_HOME)
    switch_to(bench, FREE)
    write(bench, *CLEAR)
    shown = osd(bench)
    assert (shown.waypoint_index, shown.waypoint_count) == (0, 0)
    assert shown.target_latitude == HOME[1] + 2000
    assert shown.target_status is PositionStatus.NEW


def test_a_silent_gps_receiver_shows_in_the_error_code_alone(bench):
    before = osd(bench)
    assert before.position_status is PositionStatus.NEW
    bench.aircraft.sensors.gps = replace(FIX, latitude_1e7=0, longitude_1e7=0, has_fix=False, satellites=0)
    bench.run(bench.board.now + 2.0)
    after = osd(bench)
    assert after.error_code is ErrorCode.NO_GPS
    assert after.position_status is PositionStatus.NEW
    assert (after.position_latitude, after.satellites) == (before.position_latitude, before.satellites)


def test_gps_ok_is_never_set(bench):
    bench.run(3.0)
    assert not osd(bench).nc_flags & NaviStatus.GPS_OK


def test_a_dead_spi_bus_freezes_the_flags_of_the_flightctrl(bench):
    start(bench)
    before = osd(bench).fc_flags
    assert FlightStatus.MOTORS_RUNNING in before
    bench.aircraft.faults.start("spi_lost")
    bench.run(bench.board.now + 0.5)
    bench.board.flight.core.stop()
    bench.run(bench.board.now + 1.0)
    frozen = osd(bench)
    assert frozen.error_code is ErrorCode.NO_FC
    assert frozen.fc_flags == before
    bench.aircraft.faults.stop("spi_lost")
    bench.run(bench.board.now + 0.5)
    assert FlightStatus.MOTORS_RUNNING not in osd(bench).fc_flags


def test_distances_wrap_at_655_m(bench):
    start(bench)
    place(bench, north=89035)
    bench.run(bench.board.now + 0.5)
    assert osd(bench).home_distance == pytest.approx(3347, abs=10), "990 m"


def test_the_fork_shows_used_capacity_in_the_place_of_the_voltage():
    aircraft = StillAircraft()
    aircraft.sensors.battery_used_mah = 300.0
    flight = FlightCtrl(FC_GENERATIONS["2.12a"], aircraft, seed=1, gas_law=GasLaw.FORK)
    bench = Bench(NaviCtrl(NC_GENERATIONS["0.24"], flight, seed=1), aircraft)
    bench.run(1.0)
    assert osd(bench).battery == 300 & 0xFF


def test_a_restarted_navictrl_has_lost_its_list(bench):
    write(bench, 1, north=2000)
    bench.aircraft.faults.start("nc_reboot")
    bench.run(4.0)
    assert b"Navi-Ctrl" in b"".join(byte for _, byte in bench.raw)
    assert osd(bench).waypoint_count == 0


def test_home_is_where_the_first_fix_was_and_then_where_the_motors_were_started(bench):
    shown = osd(bench)
    assert (shown.home_longitude, shown.home_latitude, shown.home_altitude) == (*HOME, 12_000)
    assert shown.home_status is PositionStatus.NEW
    place(bench, north=500)
    assert osd(bench).home_distance > 0, "standing still on the ground"
    start(bench)
    assert osd(bench).home_latitude == HOME[1] + 500
    assert osd(nc_bench("2.14")).home_status is PositionStatus.INVALID


def test_the_throttle_is_the_stick_with_the_compensation_of_the_voltage_taken_back(bench):
    start(bench)
    bench.aircraft.sensors.battery_voltage = 16.4
    bench.run(bench.board.now + 0.5)
    core = bench.board.flight.core
    assert core.reported_gas(bench.board.flight.live) == 74, "what the FlightCtrl hands over, at three cells"
    assert osd(bench).throttle == pytest.approx(core.mixed.throttle + 127, abs=2)


def test_a_point_withdrawn_is_not_counted_and_still_read_and_an_empty_place_has_no_heading(bench):
    for index in (1, 3):
        write(bench, index, north=index)
    write(bench, 1, what=PointType.INVALID, north=1)
    assert bench.board.navigator.points.count == 1
    withdrawn = bench.ask(encode_frame(2, "x", b"\x01"), bench.board.now + 0.01, 0.05)
    point = Waypoint024.decode(withdrawn.frame.payload)
    assert (point.count, point.type, point.latitude) == (1, PointType.INVALID, HOME[1] + 1)
    write(bench, 5)
    empty = bench.ask(encode_frame(2, "x", b"\x02"), bench.board.now + 0.01, 0.05)
    point = Waypoint024.decode(empty.frame.payload)
    assert (point.heading, point.type, point.status) == (361, PointType.INVALID, PositionStatus.INVALID)


def test_the_operating_radius_is_that_of_the_flightctrls_set():
    assert osd(nc_bench(fc="early")).operating_radius == 245
    assert osd(nc_bench()).operating_radius == 100, "a set without one"


def test_a_line_passed_through_hands_characters_over_by_the_fifo_both_ways():
    bench = nc_bench(fc="early")
    bench.send(encode_frame(2, "u", b"\x00"), 2.0)
    bench.run(2.3)
    asked = bench.send(encode_frame(1, "v", b""), 2.3)
    (answer,) = [heard for heard in bench.run(2.5) if heard.frame.id == "V"]
    board, direct = fc_bench("early"), []
    for k in range(20):
        at = board.send(encode_frame(1, "v", b""), 2.0 + 0.1 * k)
        direct += [heard.last - at for heard in board.run(2.1 + 0.1 * k) if heard.frame.id == "V"]
    assert 1.5e-3 < answer.last - asked - median(direct) < 5e-3, "time-outs of the last characters, both ways"


def test_debug_data_count_gps_reports_and_compass_transfers_and_tell_the_deviation_in_centimetres(bench):
    start(bench)
    switch_to(bench, 127)
    place(bench, north=100)
    bench.run(bench.board.now + 0.2)
    answer = bench.ask(encode_frame(2, "d", b"\x64"), bench.board.now + 0.01, 0.05)
    analog = DebugDataNc.decode(answer.frame.payload).analog
    assert analog[9] == FIX.sequence
    assert analog[15] == 2 * analog[13]
    assert (analog[27], analog[28]) == (pytest.approx(111, abs=2), 0)


RATE_DEG = 20.0


class Turning(StillAircraft):
    """It pitches at 20 degrees a second."""

    def step(self, sticks):
        super().step(sticks)
        self.sensors.fc_angle_pitch = math.radians(RATE_DEG * self.now)


@pytest.mark.parametrize(("fc", "age", "distinct"), [("early", 0.080, 16), ("2.08", 0.080, 16), ("2.12a", 0.036, 50)])
def test_attitudes_of_an_old_flightctrl_come_by_packets_of_the_bus(fc, age, distinct):
    """Genuine 0.84a behind 0.24b: 80 ms old, 16 new ones a second.

    The sources of no NaviCtrl for later ones are public: it has what genuine 2.12a collects for the bus, 30 ms old.
    """
    aircraft = Turning()
    flight = FlightCtrl(FC_GENERATIONS[fc], aircraft, seed=1, gate_parameter=255, calibrated=True)
    bench = Bench(NaviCtrl(NC_GENERATIONS["0.24"], flight, seed=1), aircraft)
    bench.send(encode_frame(2, "c", bytes([2])), 2.0)
    came = [each for each in bench.run(5.0) if each.frame.id == "C" and each.last > 3.0]
    told = [AttitudeDataNc.decode(each.frame.payload).pitch / 10.0 for each in came]
    ages = [each.last - pitch / RATE_DEG for each, pitch in zip(came, told, strict=True)]
    assert sum(ages) / len(ages) == pytest.approx(age, abs=0.006)
    assert len(set(told)) == pytest.approx(2.0 * distinct, abs=3)
