"""Values of the daemon as messages: units, axes, marks of what is not known; each packed and parsed by pymavlink."""

from __future__ import annotations

import math

import pytest
from pymavlink.dialects.v20 import all as mavlink

from mkdaemon.gateways.mavlink.picture import LinkPicture
from mkdaemon.gateways.mavlink.telemetry import TABLE
from mkdaemon.telemetry.state import GpsFix
from tests.gateways.mavlink import rig

NAN = float("nan")


def sent(name, *values):
    """The message as a ground station parses it, of a picture of these values; None where none is sent."""
    picture = LinkPicture()
    for value in values or rig.EVERYTHING:
        picture.take(value, 10.0)
    made = TABLE[name].make(picture)
    if made is None:
        return None
    return mavlink.MAVLink(None).decode(bytearray(made.pack(mavlink.MAVLink(None, 1, 1))))


def same(value, wanted):
    if isinstance(wanted, (list, tuple)):
        return len(value) == len(wanted) and all(map(same, value, wanted))
    return value == pytest.approx(wanted, rel=1e-5, abs=1e-6, nan_ok=True)


RIGHT = {
    "ATTITUDE": {"time_boot_ms": 100_500, "roll": 0.1, "pitch": -0.2, "yaw": math.pi / 2 - 0.5, "yawspeed": NAN},
    "ATTITUDE_QUATERNION": {"q1": math.sqrt(0.5), "q2": 0.0, "q3": 0.0, "q4": math.sqrt(0.5), "rollspeed": NAN},
    "GLOBAL_POSITION_INT": {
        "lat": 532_301_184, "lon": 74_590_749, "alt": 12_500, "relative_alt": 3_000, "vx": 200, "vy": 100, "vz": 50,
        "hdg": 6135,
    },
    "GPS_RAW_INT": {
        "fix_type": 3, "lat": 532_301_184, "eph": 65535, "epv": 65535, "vel": 224, "cog": 6708,
        "satellites_visible": 9,
    },
    "VFR_HUD": {"airspeed": NAN, "groundspeed": 2.24, "heading": 61, "throttle": 55, "alt": 12.5, "climb": -0.5},
    "ALTITUDE": {
        "time_usec": 100_500_000, "altitude_amsl": 12.5, "altitude_local": 2.0, "altitude_relative": 3.0,
        "altitude_terrain": -10_000.0, "bottom_clearance": -1.0,
    },
    "BATTERY_STATUS": {
        "temperature": 32767, "voltages": [15_500, *[65535] * 9], "current_battery": 1250, "current_consumed": 430,
        "energy_consumed": -1, "battery_remaining": -1, "time_remaining": 0, "charge_state": 1,
        "voltages_ext": [0, 0, 0, 0],
    },
    "RC_CHANNELS": {
        "chancount": 4, "chan1_raw": 1579, "chan2_raw": 1461, "chan3_raw": 1547, "chan4_raw": 1382,
        "chan5_raw": 65535, "chan18_raw": 65535, "rssi": 90,
    },
    "HOME_POSITION": {"latitude": 532_300_000, "longitude": 74_590_000, "altitude": 9_500, "x": NAN, "q": [NAN] * 4},
    "EXTENDED_SYS_STATE": {"vtol_state": 0, "landed_state": 2},
    "LOCAL_POSITION_NED": {"x": -0.2, "y": 0.3, "z": -2.0, "vx": 0.2, "vy": 0.1, "vz": 0.3},
    "LANDING_TARGET": {
        "frame": 12, "x": -0.3, "y": -0.2, "z": 2.0, "position_valid": 1, "type": 2, "size_x": 0.0,
        "angle_x": math.atan2(0.2, 2.0), "angle_y": math.atan2(0.1, 2.0), "distance": math.sqrt(4.13),
    },
    "ODOMETRY": {
        "frame_id": 20, "child_frame_id": 12, "x": -0.2, "y": 0.3, "z": -2.0, "estimator_type": 2,
        "vx": 0.1 * math.cos(0.25) + 0.2 * math.sin(0.25), "vz": 0.3,
    },
    "SYSTEM_TIME": {"time_unix_usec": 1_700_000_000_250_000, "time_boot_ms": 100_500},
    "SYS_STATUS": {
        "voltage_battery": 15_500, "current_battery": 1250, "battery_remaining": -1, "drop_rate_comm": 150, "load": 0,
    },
}  # fmt: skip


@pytest.mark.parametrize("name", TABLE)
def test_everything_known(name):
    message = sent(name)
    wrong = {field: (getattr(message, field), wanted) for field, wanted in RIGHT[name].items()
             if not same(getattr(message, field), wanted)}  # fmt: skip
    assert wrong == {}


@pytest.fixture
def picture():
    """Of everything, at 10 s."""
    made = LinkPicture()
    for value in rig.EVERYTHING:
        made.take(value, 10.0)
    return made


@pytest.mark.parametrize(
    ("name", "value", "fields"),
    [
        ("BATTERY_STATUS", rig.BATTERY.model_copy(update={"current": None, "used_mah": None, "is_low": None}),
         {"current_battery": -1, "current_consumed": -1, "charge_state": 0}),
        ("BATTERY_STATUS", rig.BATTERY.model_copy(update={"voltage": 99.0, "current": 900.0, "is_low": True}),
         {"voltages": [65534, *[65535] * 9], "current_battery": 32767, "charge_state": 2}),
        ("SYS_STATUS", rig.GPS, {"voltage_battery": 65535, "current_battery": -1}),
        ("GPS_RAW_INT", rig.GPS.model_copy(update={"fix": GpsFix.NONE, "satellites": None}),
         {"fix_type": 1, "lat": 0, "alt": 0, "vel": 65535, "cog": 65535, "satellites_visible": 255}),
        ("RC_CHANNELS", rig.PILOT.model_copy(update={"sticks": None}), {"chancount": 0, "chan1_raw": 65535}),
        ("VFR_HUD", rig.ATTITUDE, {"groundspeed": NAN, "alt": NAN, "climb": NAN, "throttle": 0}),
        ("ALTITUDE", rig.ALTITUDE, {"altitude_amsl": NAN, "altitude_local": NAN}),
        ("ODOMETRY", rig.POSE, {"vx": NAN, "velocity_covariance": [NAN] * 21}),
    ],
)  # fmt: skip
def test_marks_of_what_is_not_known(name, value, fields):
    message = sent(name, value)
    assert {field: same(getattr(message, field), wanted) for field, wanted in fields.items()} == dict.fromkeys(
        fields, True
    )


def test_home_keeps_its_height_and_without_one_no_position_is_sent():
    later = rig.POSITION.model_copy(update={"altitude": 20.0})
    assert sent("HOME_POSITION", rig.POSITION, later).altitude == 9_500
    moved = later.model_copy(update={"home_latitude_deg": 53.24})
    assert sent("HOME_POSITION", rig.POSITION, moved).altitude == 17_000
    place = rig.POSITION.model_copy(update={"altitude": None})
    assert sent("GLOBAL_POSITION_INT", place, rig.VELOCITY) is None and sent("HOME_POSITION", place) is None
