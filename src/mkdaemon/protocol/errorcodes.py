"""Error codes of the NaviCtrl (NaviData, data set 11): compare codes, texts vary by release.

The aircraft does not start its motors while the code is not NONE (FC 0.84 and later).
Source: docs/protocol.md, "Error codes".
"""

from __future__ import annotations

from typing import Final

from mkdaemon.protocol.fields import WireEnum


class ErrorCode(WireEnum):
    """Error codes of the NaviCtrl."""

    NONE = 0
    FC_INCOMPATIBLE = 1
    COMPASS_INCOMPATIBLE = 2
    NO_FC = 3
    NO_COMPASS = 4
    NO_GPS = 5
    COMPASS_VALUE = 6
    RC_LOST = 7
    FC_SPI = 8
    NO_NC = 9
    GYRO_PITCH = 10
    GYRO_ROLL = 11
    GYRO_YAW = 12
    ACCELEROMETER_PITCH = 13
    ACCELEROMETER_ROLL = 14
    ACCELEROMETER_Z = 15
    PRESSURE = 16
    FC_I2C = 17
    MOTOR_CONTROLLER_MISSING = 18
    MIXER = 19
    CARE_FREE = 20
    GPS_LOST = 21
    MAGNET = 22
    MOTOR_RESTART = 23
    MOTOR_CONTROLLER_LIMIT = 24
    GPS_RANGE = 25
    NO_SD_CARD = 26
    SD_LOGGING = 27
    FLYING_RANGE = 28
    MAX_ALTITUDE = 29
    NO_GPS_FIX = 30
    COMPASS_NOT_CALIBRATED = 31
    MOTOR_CONTROLLER_SELF_TEST = 32
    NO_EXTERNAL_COMPASS = 33
    COMPASS_SENSOR = 34
    FAILSAFE_POSITION = 35
    NO_REDUNDANCY = 36
    REDUNDANCY_TEST = 37
    GPS_UPDATE_RATE = 38
    CAN_BUS = 39
    RC_SUPPLY = 40
    POWER_SUPPLY = 41
    ACCELEROMETER_NOT_CALIBRATED = 42
    PARACHUTE = 43
    OUTSIDE_FLY_ZONE = 44
    NO_FLY_ZONE = 45
    CALIBRATION = 46
    EXTERNAL_GPS_LOST = 47


_TEXTS: Final = {
    ErrorCode.NONE: ("no error", ""),
    ErrorCode.FC_INCOMPATIBLE: ("FlightCtrl firmware not compatible", "0.80"),
    ErrorCode.COMPASS_INCOMPATIBLE: ("MK3Mag firmware not compatible", ""),
    ErrorCode.NO_FC: ("no communication with the FlightCtrl", ""),
    ErrorCode.NO_COMPASS: ("no communication with the compass", ""),
    ErrorCode.NO_GPS: ("no communication with the GPS receiver", ""),
    ErrorCode.COMPASS_VALUE: ("bad compass value", ""),
    ErrorCode.RC_LOST: ("receiver signal lost", ""),
    ErrorCode.FC_SPI: ("FlightCtrl SPI reception", ""),
    ErrorCode.NO_NC: ("no communication with the NaviCtrl", "0.86"),
    ErrorCode.GYRO_PITCH: ("FlightCtrl pitch gyro", ""),
    ErrorCode.GYRO_ROLL: ("FlightCtrl roll gyro", ""),
    ErrorCode.GYRO_YAW: ("FlightCtrl yaw gyro", ""),
    ErrorCode.ACCELEROMETER_PITCH: ("FlightCtrl pitch accelerometer", ""),
    ErrorCode.ACCELEROMETER_ROLL: ("FlightCtrl roll accelerometer", ""),
    ErrorCode.ACCELEROMETER_Z: ("FlightCtrl vertical accelerometer", ""),
    ErrorCode.PRESSURE: ("pressure sensor", ""),
    ErrorCode.FC_I2C: ("I2C between FlightCtrl and motor controllers", ""),
    ErrorCode.MOTOR_CONTROLLER_MISSING: ("a motor controller is missing", ""),
    ErrorCode.MIXER: ("more motor controllers found than the mixer has", ""),
    ErrorCode.CARE_FREE: ("care-free", ""),
    ErrorCode.GPS_LOST: ("GPS fix lost", "0.86"),
    ErrorCode.MAGNET: ("magnetic field", "0.86"),
    ErrorCode.MOTOR_RESTART: ("a motor restarted", "0.86"),
    ErrorCode.MOTOR_CONTROLLER_LIMIT: ("a motor controller limits", "0.86"),
    ErrorCode.GPS_RANGE: ("waypoint or GPS range", "0.86"),
    ErrorCode.NO_SD_CARD: ("no SD card", "0.88"),
    ErrorCode.SD_LOGGING: ("logging to the SD card", "0.88"),
    ErrorCode.FLYING_RANGE: ("flying range", "0.88"),
    ErrorCode.MAX_ALTITUDE: ("maximum altitude", "0.88"),
    ErrorCode.NO_GPS_FIX: ("no GPS fix at the start", "0.88m"),
    ErrorCode.COMPASS_NOT_CALIBRATED: ("compass not calibrated", "0.88"),
    ErrorCode.MOTOR_CONTROLLER_SELF_TEST: ("self-test of a motor controller", "2.02a"),
    ErrorCode.NO_EXTERNAL_COMPASS: ("no external compass", "2.0x"),
    ErrorCode.COMPASS_SENSOR: ("compass sensor", "2.0x"),
    ErrorCode.FAILSAFE_POSITION: ("fail-safe position active", "2.0x"),
    ErrorCode.NO_REDUNDANCY: ("no redundancy", "2.10a"),
    ErrorCode.REDUNDANCY_TEST: ("redundancy test", "2.10a"),
    ErrorCode.GPS_UPDATE_RATE: ("GPS update rate too low", "2.10e"),
    ErrorCode.CAN_BUS: ("CAN bus", "2.1x"),
    ErrorCode.RC_SUPPLY: ("5 V supply of the receiver", "2.1x"),
    ErrorCode.POWER_SUPPLY: ("power supply", "2.1x"),
    ErrorCode.ACCELEROMETER_NOT_CALIBRATED: ("accelerometer not calibrated", "2.1x"),
    ErrorCode.PARACHUTE: ("parachute", "2.1x"),
    ErrorCode.OUTSIDE_FLY_ZONE: ("outside the fly zone", "2.18"),
    ErrorCode.NO_FLY_ZONE: ("inside a no-fly zone", "2.18"),
    ErrorCode.CALIBRATION: ("calibration", "2.19"),
    ErrorCode.EXTERNAL_GPS_LOST: ("external GPS fix lost", "2.19"),
}


_FC_LOST: Final = frozenset({ErrorCode.NO_FC, ErrorCode.FC_SPI})
"""The NaviCtrl does not hear the FlightCtrl: flags, battery and reception stay at their last values."""


def is_fc_lost(code: ErrorCode) -> bool:
    """Whether a NaviCtrl that complains so shows old values of the FlightCtrl; docs/protocol.md, "Error codes"."""
    return code in _FC_LOST


def describe_error(code: int) -> str:
    """Return what an error code means, in words."""
    known = _TEXTS.get(ErrorCode(code))
    return known[0] if known else f"unknown error {int(code)}"


def error_since(code: int) -> str:
    """Return the first release that knows an error code; empty where it is not known."""
    known = _TEXTS.get(ErrorCode(code))
    return known[1] if known else ""
