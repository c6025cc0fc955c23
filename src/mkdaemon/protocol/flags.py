"""Flags and enumerations of the wire, in English; the firmware's word stands behind each where it differs.

Source: docs/protocol.md, "Flags"; each class names the releases it holds for.
"""

from __future__ import annotations

from enum import IntFlag

from mkdaemon.protocol.fields import WireEnum


class PositionStatus(WireEnum):
    """Validity of a position."""

    INVALID = 0
    NEW = 1  # NEWDATA
    PROCESSED = 2


class PointType(WireEnum):
    """Type of a point of a route."""

    WAYPOINT = 0  # WP
    POINT_OF_INTEREST = 1  # POI
    FAILSAFE = 2  # NaviCtrl 2.x
    LANDING = 3  # LAND, NaviCtrl 2.16 and later
    INVALID = 255


class PointEvent(IntFlag):
    """Event at a point, besides holding it."""

    NONE = 0
    CAMERA_PITCH = 0x01  # the camera follows in pitch


class FlightStatus(IntFlag):
    """FCStatusFlags of NaviData 5; CALIBRATE and START are pulses."""

    MOTORS_RUNNING = 0x01  # MOTOR_RUN
    FLYING = 0x02  # FLY
    CALIBRATING = 0x04  # CALIBRATE
    STARTING = 0x08  # START
    EMERGENCY_LANDING = 0x10
    LOW_BATTERY = 0x20  # LOWBAT
    CLIMB_TRIM = 0x40  # VARIO_TRIM_UP
    SINK_TRIM = 0x80  # VARIO_TRIM_DOWN


class FlightStatusOld(IntFlag):
    """FCStatusFlags before FC 0.82 (NaviData 3 and 4)."""

    MOTORS_RUNNING = 0x01  # MOTOR_RUN
    FLYING = 0x02  # FLY
    CALIBRATING = 0x04  # CALIBRATE
    STARTING = 0x08  # START
    EMERGENCY_LANDING = 0x10  # NOTLANDUNG
    LOW_BATTERY = 0x20  # LOWBAT
    SPI_ERROR = 0x40  # SPI_RX_ERR
    I2C_ERROR = 0x80  # I2CERR


class FlightStatus2(IntFlag):
    """FCStatusFlags2, from FC 0.88 on; the upper three bits from 2.00 on."""

    CARE_FREE = 0x01  # CAREFREE
    ALTITUDE_CONTROL = 0x02
    RC_FAILSAFE = 0x04  # RC_FAILSAVE_ACTIVE
    OUTPUT_1 = 0x08  # OUT1_ACTIVE
    OUTPUT_2 = 0x10  # OUT2_ACTIVE
    WAITING_FOR_TAKEOFF = 0x20  # WAIT_FOR_TAKEOFF
    AUTO_STARTING = 0x40
    AUTO_LANDING = 0x80


class NaviStatus(IntFlag):
    """NCFlags: GPS mode and its state."""

    FREE = 0x01
    POSITION_HOLD = 0x02  # PH
    COMING_HOME = 0x04  # CH
    RANGE_LIMIT = 0x08
    NO_SERIAL_LINK = 0x10  # NOSERIALLINK
    TARGET_REACHED = 0x20
    MANUAL_CONTROL = 0x40
    GPS_OK = 0x80


class OsdStatus(IntFlag):
    """OSDStatusFlags of the data sets 10..16: another order than FlightStatus."""

    CARE_FREE = 0x01
    ALTITUDE_CONTROL = 0x02
    CALIBRATING = 0x04
    OUTPUT_1 = 0x08
    OUTPUT_2 = 0x10
    LOW_BATTERY = 0x20
    CLIMB_TRIM = 0x40
    SINK_TRIM = 0x80


class OsdStatus2(IntFlag):
    """OSDStatusFlags2 of data set 11."""

    MOTORS_RUNNING = 0x01
    FLYING = 0x02
    RC_FAILSAFE = 0x04
    STARTING = 0x08
    EMERGENCY_LANDING = 0x10
    WAITING_FOR_TAKEOFF = 0x20
    AUTO_STARTING = 0x40
    AUTO_LANDING = 0x80


class BoardStatus(IntFlag):
    """StatusGreen (present) and StatusRed (error) of the debug stream."""

    FC = 0x01
    BL = 0x02
    NC = 0x04
    COMPASS = 0x08


class ControlConfig(IntFlag):
    """Config of external control; bits above GAS_ADD only from FC 2.14 on (2.12a declares 0x80 and ignores it)."""

    NONE = 0
    VALID = 0x01
    THROTTLE_ADD = 0x02  # GAS_ADD: RC + value in place of min(RC, value)
    USE_SWITCHES = 0x20  # USE_SWITCH
    IGNORE_RC_STICKS = 0x40  # IGNORE_RC_STICK
    IGNORE_RC_LOST = 0x80


class ControlSwitches(IntFlag):
    """Switches of external control v3; honoured only with ControlConfig.USE_SWITCHES."""

    NONE = 0
    POSITION_HOLD = 0x01  # PH
    COMING_HOME = 0x02  # CH
    CARE_FREE = 0x10  # CAREFREE
    ALTITUDE = 0x20
    AUTO_START = 0x40
    AUTO_LAND = 0x80


class MenuKey(IntFlag):
    """Keys of the board's menu; sent as their ones complement (`DisplayRequest.keys_inverted`)."""

    NONE = 0
    PREVIOUS_PAGE = 0x01  # KEY1; together with NEXT_PAGE: page 0
    NEXT_PAGE = 0x02  # KEY2
    KEY_3 = 0x04
    KEY_4 = 0x08


class VersionFlags(IntFlag):
    """Flags of VersionInfo from FC 2.00 on."""

    COMPANION_PRESENT = 0x01  # on an FC: NC_PRESENT, on an NC: MK3MAG_PRESENT


class FlightFault0(IntFlag):
    """HardwareError[0] of a FlightCtrl; 2.12a clears CARE_FREE after each transfer to the NaviCtrl."""

    GYRO_PITCH = 0x01  # GYRO_NICK
    GYRO_ROLL = 0x02
    GYRO_YAW = 0x04
    ACCELEROMETER_PITCH = 0x08  # ACC_NICK
    ACCELEROMETER_ROLL = 0x10  # ACC_ROLL
    ACCELEROMETER_Z = 0x20  # ACC_TOP
    PRESSURE = 0x40
    CARE_FREE = 0x80  # CAREFREE


class FlightFault1(IntFlag):
    """HardwareError[1] of a FlightCtrl; 2.12a keeps only MIXER after a transfer to the NaviCtrl: poll repeatedly."""

    I2C = 0x01
    MOTOR_CONTROLLER_MISSING = 0x02  # BL_MISSING
    NAVICTRL_SILENT = 0x04  # SPI_RX
    NO_RECEIVER = 0x08  # PPM
    MIXER = 0x10
    RESERVED_1 = 0x20
    ACCELEROMETER_NOT_CALIBRATED = 0x40  # RES2 before FC 2.1x
    RESERVED_3 = 0x80


class NaviFault0(IntFlag):
    """HardwareError[0] of a NaviCtrl."""

    NO_FLIGHTCTRL = 0x01  # SPI_RX
    NO_COMPASS = 0x02  # COMPASS_RX
    FLIGHTCTRL_INCOMPATIBLE = 0x04
    COMPASS_INCOMPATIBLE = 0x08
    NO_GPS = 0x10  # GPS_RX
    COMPASS_VALUE = 0x20


class RedirectPort(WireEnum):
    """Whose UART a NaviCtrl connects the host to."""

    FC = 0
    MAG = 1
    GPS = 2


class NaviParameterId(WireEnum):
    """Parameters of a NaviCtrl that may change in flight."""

    TARGET_SPEED = 0  # GPS_TARGETSPEED, 0.1 m/s, 50 at start
    HEADING_SETPOINT = 1  # NEW_COMPASS_DIRECTION_SETPOINT, deg, -1 none
    CAMERA_ELEVATION = 2  # NEW_CAMERA_ELEVATION
    ALTITUDE_RATE = 3
    ALTITUDE_SETPOINT = 4  # dm at the FlightCtrl


class MotorControllerStatus(WireEnum):
    """Result of an access to a motor controller's configuration."""

    SUCCESS = 0
    MOTORS_RUNNING = 1  # MOTOR_RUNNING
    NO_SUCH_MOTOR = 2  # MOTOR_NOT_EXIST
    HARDWARE_INCOMPATIBLE = 3  # HW_NOT_COMPATIBLE
    FIRMWARE_INCOMPATIBLE = 4  # SW_NOT_COMPATIBLE
    CHECKSUM = 5
    CANNOT_READ = 6  # READ_NOT_POSSIBLE


class MotorControllerItems(IntFlag):
    """SetMask: which items of a motor controller's configuration to apply."""

    NONE = 0
    PWM_SCALING = 0x01
    CURRENT_LIMIT = 0x02
    TEMPERATURE_LIMIT = 0x04
    CURRENT_SCALING = 0x08
    BITS = 0x10  # BITCONFIG
    RESET_CAPACITY_OR_START_PWM = 0x20  # RESET_CAPCOUNTER (FC 2.00a) or STARTPWM (2.12a): never set it blindly
    DEFAULTS = 0x40  # DEFAULT_PARAMS
    SAVE = 0x80  # SAVE_EEPROM


class MotorControllerBits(IntFlag):
    """BitConfig of a motor controller; the start bits from 2.12 on."""

    NONE = 0
    REVERSE = 0x01  # REVERSE_ROTATION
    START_1 = 0x02  # STARTGAS1
    START_2 = 0x04  # STARTGAS2
    START_3 = 0x08  # STARTGAS3


class RedundancyBits(IntFlag):
    """BitState a motor controller reports to a redundant FlightCtrl."""

    I2C_OK = 0x01
    I2C_VALUE = 0x02
    I2C_BAD = 0x04
    RECEIVER_OK = 0x08  # PPM_OK
    MOTORS_RUNNING = 0x10  # MOTOR_RUN
