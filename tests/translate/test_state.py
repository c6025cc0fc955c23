"""Wire messages to SI: signs, units and sources, on frames made for the purpose."""

from __future__ import annotations

import math

import pytest

from mkdaemon.frames import euler_from_rotation, rotation_from_quaternion
from mkdaemon.protocol.errorcodes import ErrorCode
from mkdaemon.protocol.flags import FlightStatus, FlightStatus2, NaviStatus, OsdStatus2, PositionStatus
from mkdaemon.protocol.messages import (
    AttitudeDataFc210,
    AttitudeDataFcOld,
    AttitudeDataNc,
    AttitudeDataNcSticks,
    DebugDataFc,
    DebugDataNc,
    OsdData5,
)
from mkdaemon.protocol.messages.osdsets import (
    OsdDeviation,
    OsdFlags,
    OsdHome,
    OsdTarget,
    OsdTiny,
    OsdVolatile,
    OsdWaypoint,
)
from mkdaemon.stamp import Stamp
from mkdaemon.telemetry.state import AngleScale, GpsFix
from mkdaemon.translate import StateTranslator
from mkdaemon.translate.state import COARSE_AFTER, fc_is_lost, motors_running


def blank(cls, **fields):
    """A message of zeros with some fields set."""
    return cls.decode(bytes(cls.spec.size)).model_copy(update=fields)


def debug(**channels):
    """Debug data of a FlightCtrl; `a9` is its tenth analog value."""
    return blank(DebugDataFc, analog=tuple(channels.get(f"a{number}", 0) for number in range(32)))


def states(message, board="nc", t=1.0, translator=None):
    return dict((translator or StateTranslator()).states(board, message, Stamp(monotonic=t, wall=t + 1e9)))


@pytest.mark.parametrize("cls", [AttitudeDataNc, AttitudeDataFc210])
@pytest.mark.parametrize(
    ("wire", "axis", "expected"),
    [
        ({"pitch": 100}, "pitch", math.radians(10)),  # the firmware's pitch: nose down positive, like ours
        ({"roll": 100}, "roll", math.radians(-10)),  # its roll: LEFT side down positive, unlike ours
        ({"heading": 0}, "yaw", math.pi / 2),  # north
        ({"heading": 900}, "yaw", 0.0),  # east
        ({"heading": 1800}, "yaw", -math.pi / 2),
        ({"heading": 3590}, "yaw", math.radians(91)),  # one degree west of north
    ],
)
def test_attitude_has_our_signs(cls, wire, axis, expected):
    board = cls.spec.boards[0].word
    value = states(blank(cls, **wire), board)["state/attitude"]
    assert getattr(value, axis) == pytest.approx(expected)
    roll, pitch, yaw = euler_from_rotation(rotation_from_quaternion(value.quaternion))
    assert (roll, pitch, yaw) == pytest.approx((value.roll, value.pitch, value.yaw))
    assert (value.stamp.monotonic, value.stamp.wall, value.source) == (1.0, 1.0 + 1e9, f"{board}/attitude")


OSD = {
    "version": 5,
    "position_longitude": -712699574,
    "position_latitude": 424602680,
    "position_altitude": 118654,
    "position_status": 1,
    "home_longitude": -712699574,
    "home_latitude": 424602680 - 9000,
    "home_status": 1,
    "home_distance": 999,
    "altimeter": 372,
    "battery": 162,
    "current": 239,
    "used_capacity": 426,
    "satellites": 9,
    "ground_speed": 300,
    "course": 90,
    "vertical_speed": 24,
    "rc_quality": 193,
    "flying_time": 61,
}


def test_position_velocity_battery_in_si():
    found = states(blank(OsdData5, **OSD))
    position, velocity, battery = found["state/position"], found["state/velocity"], found["state/battery"]
    assert (position.latitude_deg, position.longitude_deg) == pytest.approx((42.460268, -71.2699574))
    assert (position.altitude, position.altitude_above_start) == pytest.approx((118.654, 18.6))
    east, north, up = position.position_enu
    assert east == pytest.approx(0.0, abs=1e-6)
    assert north == pytest.approx(99.96, abs=0.1)  # 0.0009 degrees of latitude
    assert up == pytest.approx(18.6)
    assert position.home_distance == pytest.approx(99.97, abs=0.1)
    assert position.board_home_distance == pytest.approx(99.9)
    assert velocity.velocity_enu == pytest.approx((3.0, 0.0, 0.24), abs=1e-9)  # course 90 is east
    assert (velocity.ground_speed, velocity.climb_rate, velocity.course) == pytest.approx((3.0, 0.24, 0.0))
    assert (battery.voltage, battery.current, battery.used_mah) == pytest.approx((16.2, 23.9, 426.0))
    assert (found["state/gps"].satellites, found["state/flight"].flying_time) == (9, 61)
    assert found["state/pilot"].rc_quality == pytest.approx(0.965)


def test_no_position_is_published_while_it_is_not_valid():
    found = states(blank(OsdData5, **OSD | {"position_status": 0}))
    assert "state/position" not in found
    assert "state/velocity" not in found
    assert found["state/gps"].fix == "none"
    without_home = states(blank(OsdData5, **OSD | {"home_status": 0}))["state/position"]
    assert (without_home.position_enu, without_home.home_latitude_deg, without_home.home_distance) == (None, None, None)


def test_a_distance_is_computed_beyond_655_m_or_is_the_boards_own_word_without_a_valid_position():
    target = {"target_latitude": 424602680 + 89035, "target_longitude": -712699574, "target_status": 1}
    flight = states(blank(OsdData5, **OSD | target | {"position_status": 0, "target_distance": 3347}))["state/flight"]
    assert flight.target_distance is None
    assert flight.board_target_distance == pytest.approx(334.7)
    away = {"home_latitude": 424602680 - 89035, "home_distance": 3347}
    target = {"target_latitude": 424602680 + 89035, "target_longitude": -712699574, "target_status": 1}
    found = states(blank(OsdData5, **OSD | away | target | {"target_distance": 3347}))
    position, flight = found["state/position"], found["state/flight"]
    assert (position.home_distance, flight.target_distance) == pytest.approx((989.0, 989.0), abs=2.0)
    assert (position.board_home_distance, flight.board_target_distance) == pytest.approx((334.7, 334.7))


FLIGHT_FLAGS = [
    ("fc_flags", FlightStatus.MOTORS_RUNNING, "motors_running"),
    ("fc_flags", FlightStatus.FLYING, "is_flying"),
    ("fc_flags", FlightStatus.CALIBRATING, "is_calibrating"),
    ("fc_flags", FlightStatus.STARTING, "is_starting"),
    ("fc_flags", FlightStatus.EMERGENCY_LANDING, "emergency_landing"),
    ("fc_flags", FlightStatus.LOW_BATTERY, "battery_low"),
    ("fc_flags_2", FlightStatus2.CARE_FREE, "care_free"),
    ("fc_flags_2", FlightStatus2.ALTITUDE_CONTROL, "altitude_control"),
    ("fc_flags_2", FlightStatus2.RC_FAILSAFE, "rc_failsafe"),
    ("fc_flags_2", FlightStatus2.WAITING_FOR_TAKEOFF, "waiting_for_takeoff"),
    ("fc_flags_2", FlightStatus2.AUTO_STARTING, "auto_starting"),
    ("fc_flags_2", FlightStatus2.AUTO_LANDING, "auto_landing"),
    ("nc_flags", NaviStatus.MANUAL_CONTROL, "manual_control"),
    ("nc_flags", NaviStatus.RANGE_LIMIT, "range_limit"),
    ("nc_flags", NaviStatus.TARGET_REACHED, "target_reached"),
    ("nc_flags", NaviStatus.NO_SERIAL_LINK, "serial_link_lost"),
]


@pytest.mark.parametrize(("field", "flag", "name"), FLIGHT_FLAGS, ids=lambda value: str(value))
def test_each_flag_is_its_own_boolean_and_no_other(field, flag, name):
    off, on = (states(blank(OsdData5, version=5, **{field: value}))["state/flight"] for value in (type(flag)(0), flag))
    changed = {key for key, value in off.model_dump().items() if on.model_dump()[key] != value}
    assert changed == {name}
    assert getattr(on, name) is True


@pytest.mark.parametrize("board", ["nc", "fc"])
@pytest.mark.parametrize(
    ("cls", "scale"),
    [
        (AttitudeDataFc210, AngleScale.FLIGHTCTRL),
        (AttitudeDataFcOld, AngleScale.FLIGHTCTRL),
        (AttitudeDataNc, AngleScale.STICKS),
        (AttitudeDataNcSticks, AngleScale.STICKS),
        (OsdData5, AngleScale.STICKS),
    ],
)
def test_who_made_the_message_decides_the_scale_of_its_angles_and_not_through_which_board_it_came(cls, scale, board):
    assert states(blank(cls), board)["state/attitude"].scale is scale


def test_coarse_attitude_stands_in_only_while_there_is_no_better():
    translator = StateTranslator()
    osd = blank(OsdData5, version=5, pitch=10, roll=10, heading=90)
    coarse = states(osd, t=0.0, translator=translator)["state/attitude"]
    assert (coarse.pitch, coarse.roll) == pytest.approx((math.radians(10), math.radians(-10)))
    states(blank(AttitudeDataNc), t=1.0, translator=translator)
    assert "state/attitude" not in states(osd, t=1.0 + COARSE_AFTER, translator=translator)
    assert "state/attitude" in states(osd, t=1.01 + COARSE_AFTER, translator=translator)


@pytest.mark.parametrize(
    ("board", "message", "running"),
    [
        ("fc", debug(), False),
        ("fc", debug(a13=17), True),
        ("mag", debug(a13=17), None),
        ("nc", blank(DebugDataNc), None),
        ("nc", blank(OsdFlags, index=11), False),
        ("nc", blank(OsdFlags, index=11, status_2=OsdStatus2.MOTORS_RUNNING), True),
    ],
)
def test_who_can_tell_whether_motors_run(board, message, running):
    assert motors_running(board, message) is running


# -- data sets of newer NaviCtrls ----------------------------------------------------------------------------------


def test_the_data_sets_together_tell_what_one_message_did():
    translator = StateTranslator()
    place = {"latitude": 424602680, "longitude": -712699574, "altimeter": 372}

    def tell(cls, **fields):
        index = next(iter(cls.spec.marker))
        return states(blank(cls, **place | {"index": index} | fields), translator=translator)

    assert "state/position" not in states(blank(OsdTiny, index=10)), "without a position"
    assert tell(OsdTiny)["state/position"].position_enu is None
    tell(OsdHome, home_latitude=424602680, home_longitude=-712699574 + 10_000)
    position = tell(OsdTiny)["state/position"]
    assert position.position_enu[0] < -80
    assert position.position_enu[2] == pytest.approx(18.6)
    assert position.altitude is None
    assert "state/attitude" not in tell(OsdDeviation, pitch=10, roll=10, satellites=8, home_distance=50)
    battery = tell(OsdVolatile, battery=162, current=239, used_capacity=426, heading=45)["state/battery"]
    assert battery.voltage == pytest.approx(16.2)
    attitude = tell(OsdDeviation, pitch=10, roll=10, satellites=8, home_distance=50)["state/attitude"]
    assert (attitude.roll, attitude.yaw) == pytest.approx((math.radians(-10), 0.0), abs=1e-9)
    tell(OsdWaypoint, waypoint_index=2, waypoint_count=4)
    found = tell(OsdFlags, status_2=OsdStatus2.MOTORS_RUNNING | OsdStatus2.FLYING, nc_flags=NaviStatus.GPS_OK)
    flight, gps = found["state/flight"], found["state/gps"]
    assert (flight.motors_running, flight.is_flying, flight.waypoint_index) == (True, True, 2)
    assert (gps.satellites, gps.is_usable, gps.is_home_set) == (8, True, True)
    position = tell(OsdTiny)["state/position"]
    assert position.board_home_distance == pytest.approx(5.0)
    assert position.home_distance == pytest.approx(82.1, abs=0.5)
    assert flight.target_distance is None
    tell(OsdTarget, target_latitude=424602680 + 90_000, target_longitude=-712699574)
    found = tell(OsdFlags, status_2=OsdStatus2.MOTORS_RUNNING | OsdStatus2.FLYING)
    assert found["state/flight"].target_distance == pytest.approx(1000.0, abs=5.0)
    assert tell(OsdTarget, rc_quality=100)["state/pilot"].has_signal is True


# -- recorded ------------------------------------------------------------------------------------------------------


def test_the_throttle_comes_with_the_voltage_that_is_in_it_and_a_navictrl_and_a_fork_tell_the_stick():
    osd = blank(OsdData5, throttle=125, battery=148, fc_flags=FlightStatus.MOTORS_RUNNING, rc_quality=190)
    told = states(osd)["state/pilot"]
    assert (told.throttle_in_use, told.compensated_at) == (-2.0, None)
    channels = {"a7": 4 * 108, "a9": 148, "a12": 100}
    told = states(debug(**channels), "fc")["state/pilot"]
    assert (told.throttle_in_use, told.compensated_at) == pytest.approx((-19.0, 14.8))
    told = states(debug(**channels, a19=125, a26=1), "fc")[
        "state/pilot"
    ]  # FlightCtrl fc.c: StickGas = ChannelGas + 127
    assert (told.throttle_in_use, told.compensated_at) == (-2.0, None)


def test_the_barometers_height_needs_no_gps_and_no_navictrl():
    indoors = blank(OsdData5, altimeter=42, position_status=PositionStatus.INVALID, error_code=ErrorCode.NO_GPS)
    found = states(indoors)
    assert "state/position" not in found
    assert found["state/altitude"].above_start == pytest.approx(2.1)
    assert states(debug(a5=21), "fc")["state/altitude"].above_start == pytest.approx(2.1)
    flags = blank(OsdFlags, index=11, altimeter=42)
    assert states(flags)["state/altitude"].above_start == pytest.approx(2.1)
    for lost in (indoors, flags):
        assert "state/altitude" not in states(lost.model_copy(update={"error_code": ErrorCode.FC_SPI}))


FROM_FLIGHTCTRL = (
    *("motors_running", "is_flying", "is_calibrating", "is_starting", "emergency_landing", "battery_low", "care_free"),
    *("altitude_control", "rc_failsafe", "waiting_for_takeoff", "auto_starting", "auto_landing", "altitude_setpoint"),
    "flying_time",
)
"""What `state/flight` knows from the FlightCtrl alone."""


@pytest.mark.parametrize("code", [ErrorCode.NO_FC, ErrorCode.FC_SPI])
def test_a_navictrl_that_does_not_hear_its_flightctrl_says_nothing_about_it(code):
    """Its flags, battery, reception and attitude are frozen at the last value then."""
    translator = StateTranslator()
    here = PositionStatus.NEW
    osd = blank(OsdData5, error_code=code, rc_quality=200, battery=160, position_status=here, home_status=here)
    told = states(osd, translator=translator)
    assert motors_running("nc", osd) is None
    assert fc_is_lost(osd) is True
    assert {getattr(told["state/flight"], name) for name in FROM_FLIGHTCTRL} == {None}
    assert told["state/flight"].error
    place = told["state/position"]
    assert (place.altitude_above_start, place.position_enu) == (None, None)
    assert place.home_distance is not None
    assert told.keys().isdisjoint({"state/battery", "state/pilot", "state/attitude"})
    assert states(blank(AttitudeDataNc), translator=translator) == {}
    assert "state/battery" in states(blank(OsdData5), translator=translator)
    assert "state/attitude" in states(blank(AttitudeDataNc), translator=translator)
    flags = blank(OsdFlags, index=11, error_code=code)
    assert motors_running("nc", flags) is None
    told = states(flags.model_copy(update={"latitude": 1}))
    assert {getattr(told["state/flight"], name) for name in FROM_FLIGHTCTRL} == {None}
    assert told["state/position"].altitude_above_start is None
    for frozen in (OsdVolatile, OsdTarget):
        translator = StateTranslator()
        states(flags, translator=translator)
        message = blank(frozen, index=next(iter(frozen.spec.marker)))
        assert states(message, translator=translator).keys().isdisjoint({"state/battery", "state/pilot"})


@pytest.mark.parametrize("code", [ErrorCode.NO_GPS, ErrorCode.GPS_LOST, ErrorCode.NO_GPS_FIX])
def test_the_last_position_of_a_dead_gps_receiver_is_no_position(code):
    place = {"position_status": PositionStatus.NEW, "position_latitude": 481234567, "position_longitude": 115000000}
    assert "state/position" in states(blank(OsdData5, **place))
    told = states(blank(OsdData5, error_code=code, nc_flags=NaviStatus.GPS_OK, **place))
    assert told.keys().isdisjoint({"state/position", "state/velocity"})
    assert (told["state/gps"].fix, told["state/gps"].is_usable) == (GpsFix.NONE, False)
    assert told["state/flight"].error
    translator = StateTranslator()
    states(blank(OsdFlags, index=11, error_code=code), translator=translator)
    home = blank(OsdHome, index=13, latitude=481234567, longitude=115000000)
    assert "state/position" not in states(home, translator=translator)


@pytest.fixture
def tell():
    """What one translator makes of the same message with one error after the other."""
    translator = StateTranslator()
    return lambda code: states(blank(OsdData5, **OSD | {"error_code": code}), translator=translator)


def test_a_receiver_that_says_nothing_sees_no_satellites(tell):
    codes = {ErrorCode.NONE: 9, ErrorCode.NO_GPS: None, ErrorCode.NO_GPS_FIX: 9, ErrorCode.GPS_LOST: None}
    assert {code: tell(code)["state/gps"].satellites for code in codes} == codes, "without a fix it counts them"


def test_an_error_that_hides_a_silent_receiver_does_not_bring_it_back(tell):
    assert "state/position" in tell(ErrorCode.NO_FC)  # a NaviCtrl goes on with its receiver without a FlightCtrl
    assert "state/position" not in tell(ErrorCode.NO_GPS)
    for code in (ErrorCode.NO_FC, ErrorCode.NO_COMPASS, ErrorCode.MOTOR_CONTROLLER_MISSING):
        found = tell(code)
        assert "state/position" not in found
        assert (found["state/gps"].satellites, found["state/gps"].fix) == (None, GpsFix.NONE)
    assert "state/position" in tell(ErrorCode.RC_LOST)  # which a NaviCtrl shows only while its receiver is heard
