"""The parameter sets of the FlightCtrl: fields in wire order with the revisions that have them, in one table.

Everything is a byte. Names are English; the firmware's word follows. Revisions the firmware changed without changing
the layout share one: 75 is 74, 86 and 87 are 85, and so on (`SAME_LAYOUT`). 99 never existed, 111 was a step to 112.
Source: docs/protocol.md, "Settings"; FlightCtrl releases 0.71 to 2.22 and the tools that knew them.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import Final


class Kind(Enum):
    """How a parameter is read."""

    NUMBER = "number"
    POTI = "number or poti"
    """248..255 stand for poti 8..1."""
    BITS = "bits"
    TEXT = "text"
    LIST = "list"
    SPARE = "spare"


@dataclass(frozen=True, slots=True)
class Bit:
    """One bit of a parameter, in the revisions where it means this."""

    mask: int
    name: str
    mk: str
    since: int = 0
    until: int = 255


@dataclass(frozen=True, slots=True)
class Parameter:
    """One parameter, in the revisions that have it.

    Attributes:
        name: English name; stays the same where the firmware renamed a field without changing its use.
        mk: the firmware's word.
        meaning: what it does.
        kind: how to read it.
        since: first revision that has it.
        until: last revision that has it.
        unit: unit of one count, in words.
        high: largest useful value, where known.
        lengths: (revision from which on, bytes), ascending; empty for one byte.
        bits: meaning of the bits.
    """

    name: str
    mk: str
    meaning: str
    kind: Kind
    since: int
    until: int
    unit: str
    high: int
    lengths: tuple[tuple[int, int], ...]
    bits: tuple[Bit, ...]

    def length(self, revision: int) -> int:
        """Bytes it has in a revision; 0 where the revision does not have it."""
        if not self.since <= revision <= self.until:
            return 0
        return next((count for first, count in reversed(self.lengths) if first <= revision), 1)


def _p(
    name: str,
    mk: str,
    meaning: str,
    *,
    since: int = 73,
    until: int = 255,
    unit: str = "",
    high: int = 255,
    poti: bool = False,
    kind: Kind = Kind.NUMBER,
    lengths: tuple[tuple[int, int], ...] = (),
    bits: tuple[Bit, ...] = (),
) -> Parameter:
    kind = Kind.POTI if poti else Kind.BITS if bits else kind
    return Parameter(name, mk, meaning, kind, since, until, unit, high, lengths, bits)


REVISIONS: Final[dict[int, str]] = {
    73: "FC 0.71/0.72",
    74: "FC 0.72e+",
    76: "FC 0.75b",
    77: "FC 0.75c+",
    78: "FC 0.75i+",
    79: "FC 0.75/0.76",
    80: "FC 0.75N .. 0.76",
    81: "FC 0.77a",
    82: "FC 0.77/0.78",
    84: "FC 0.80",
    85: "FC 0.82..0.84",
    88: "FC 0.86",
    90: "FC 0.88e..0.88n",
    92: "FC 0.90d..0.90j",
    94: "FC 0.91a beta",
    95: "FC 0.91L, 2.00a..2.00e",
    97: "FC 2.02b",
    98: "FC 2.03d/2.04",
    100: "FC 2.05e beta",
    101: "FC 2.05f beta",
    102: "FC 2.05g..2.06",
    103: "FC 2.07f/2.08",
    104: "FC 2.09d beta",
    105: "FC 2.09j/2.10",
    106: "FC 2.11a, 2.12a",
    107: "FC 2.13a beta",
    108: "FC 2.14a",
    109: "FC 2.16",
    110: "FC 2.18",
    112: "FC 2.19",
    113: "FC 2.20",
    114: "FC 2.21c",
}
"""Revisions with a layout of their own, and the FlightCtrl releases that use it."""

SAME_LAYOUT: Final = {75: 74, 86: 85, 87: 85, 89: 88, 91: 90, 93: 92, 96: 95}
"""Revisions that share an earlier layout."""

_RECEIVERS: Final = "0 PPM, 1..3 Spektrum, 4 Jeti, 5 ACT, 6 HoTT, 7 S.Bus, 8 M-Link (user before 2.11), 9 user"

_GLOBAL_CONFIG: Final = (
    Bit(0x01, "altitude_control", "HOEHENREGELUNG"),
    Bit(0x02, "altitude_switch", "HOEHEN_SCHALTER"),
    Bit(0x04, "heading_hold", "HEADING_HOLD"),
    Bit(0x08, "compass", "KOMPASS_AKTIV"),
    Bit(0x10, "compass_fix", "KOMPASS_FIX"),
    Bit(0x20, "gps", "GPS_AKTIV"),
    Bit(0x40, "axis_coupling", "ACHSENKOPPLUNG_AKTIV", until=109),
    Bit(0x40, "land_outside_fly_zone", "LAND_OUTSIDE_FLYZONE", since=110),
    Bit(0x80, "rate_limiter", "DREHRATEN_BEGRENZER"),
)
_BIT_CONFIG: Final = (
    Bit(0x01, "loop_up", "LOOP_OBEN"),
    Bit(0x02, "loop_down", "LOOP_UNTEN"),
    Bit(0x04, "loop_left", "LOOP_LINKS"),
    Bit(0x08, "loop_right", "LOOP_RECHTS"),
    Bit(0x10, "three_way_altitude_switch", "3-way altitude switch (DUBwise)", until=80),
    Bit(0x10, "led_1_blinks_with_motors", "MOTOR_BLINK1", since=85, until=113),
    Bit(0x10, "led_1_with_motors", "LED1_MOTOR_RUN", since=114),
    Bit(0x20, "led_1_motors_off", "MOTOR_OFF_LED1", since=85),
    Bit(0x40, "led_2_motors_off", "MOTOR_OFF_LED2", since=85),
    Bit(0x80, "led_2_blinks_with_motors", "MOTOR_BLINK2", since=85, until=113),
    Bit(0x80, "led_2_with_motors", "LED2_MOTOR_RUN", since=114),
)
_SERVO_INVERT: Final = (
    Bit(0x01, "pitch_inverted", "NICK_INV"),
    Bit(0x02, "roll_inverted", "ROLL_INV"),
    Bit(0x04, "relative", "RELATIVE", since=92),
    Bit(0x08, "coming_home_direction_1", "CH_DIRECTION_1", since=104),
    Bit(0x10, "coming_home_direction_2", "CH_DIRECTION_2", since=104),
)
_EXTRA_CONFIG: Final = (
    Bit(0x01, "height_limit", "HEIGHT_LIMIT"),
    Bit(0x02, "vario_beep", "VARIO_BEEP"),
    Bit(0x04, "sensitive_rc", "SENSITIVE_RC", until=103),
    Bit(0x04, "fly_zone_required", "FLYZONE_REQUIRED", since=110),
    Bit(0x08, "reference_3v3", "3_3V_REFERENCE"),
    Bit(0x10, "no_rc_off_beeping", "NO_RCOFF_BEEPING"),
    Bit(0x20, "gps_aid", "GPS_AID"),
    Bit(0x40, "learnable_care_free", "LEARNABLE_CAREFREE"),
    Bit(0x80, "ignore_magnet_error_at_start", "IGNORE_MAG_ERR_AT_STARTUP"),
)
_GLOBAL_CONFIG_3: Final = (
    Bit(0x01, "no_sd_card_no_start", "NO_SDCARD_NO_START"),
    Bit(0x02, "dynamic_hold_max_radius", "DPH_MAX_RADIUS", until=100),
    Bit(0x02, "rise_to_first_waypoint", "RISE_FIRST_WAYPOINT", since=109),
    Bit(0x04, "vario_failsafe", "VARIO_FAILSAFE"),
    Bit(0x08, "motor_switch_mode", "MOTOR_SWITCH_MODE", since=91),
    Bit(0x10, "no_gps_fix_no_start", "NO_GPSFIX_NO_START", since=91),
    Bit(0x20, "navi_drives_output_1", "USE_NC_FOR_OUT1", since=92),
    Bit(0x40, "speak_all", "SPEAK_ALL", since=92, until=110),
    Bit(0x80, "servo_pitch_compensation_off", "SERVO_NICK_COMP_OFF", since=96),
)

PARAMETERS: Final = (
    _p("revision", "Revision", "layout of this set"),
    _p(
        "channels",
        "Kanalbelegung",
        "channel of pitch, roll, throttle, yaw, potis",
        lengths=((73, 8), (81, 12)),
        kind=Kind.LIST,
    ),
    _p("global_config", "GlobalConfig", "feature bits", bits=_GLOBAL_CONFIG),
    _p("altitude_min_throttle", "Hoehe_MinGas", "lowest throttle of the altitude controller"),
    _p("pressure_d", "Luftdruck_D", "D gain, pressure", poti=True),
    _p("altitude_control", "MaxHoehe", "altitude set point, or source of the altitude switch", until=94, poti=True),
    _p("altitude_channel", "HoeheChannel", "channel of the altitude switch", since=95, high=32),
    _p("altitude_p", "Hoehe_P", "P gain, altitude", poti=True),
    _p("altitude_gain", "Hoehe_Verstaerkung", "set point step, climb rate gain"),
    _p("altitude_acceleration", "Hoehe_ACC_Wirkung", "weight of vertical acceleration", poti=True),
    _p("altitude_hover_band", "Hoehe_HoverBand", "allowed variation around hover throttle", since=78),
    _p("altitude_gps_z", "Hoehe_GPS_Z", "weight of GPS vertical speed", since=78, until=102, poti=True),
    _p("altitude_tilt_compensation", "Hoehe_TiltCompensation", "throttle boost when tilted", since=103, poti=True),
    _p("altitude_stick_neutral", "Hoehe_StickNeutralPoint", "throttle stick middle for vario; 0 automatic", since=80),
    _p("stick_p", "Stick_P", "pitch and roll stick gain"),
    _p("stick_d", "Stick_D", "pitch and roll stick rate gain"),
    _p("stick_yaw_p", "Gier_P", "yaw stick gain", until=87),
    _p("stick_yaw_p", "StickGier_P", "yaw stick gain", since=88),
    _p("throttle_min", "Gas_Min", "lowest throttle"),
    _p("throttle_max", "Gas_Max", "highest throttle"),
    _p("gyro_accelerometer_factor", "GyroAccFaktor", "gyro-to-acc angle scale"),
    _p("compass_influence", "KompassWirkung", "compass influence", poti=True),
    _p("gyro_p", "Gyro_P", "rate gain", poti=True),
    _p("gyro_i", "Gyro_I", "angle gain", poti=True),
    _p("gyro_d", "Gyro_D", "rate derivative gain", since=74, poti=True),
    _p("gyro_yaw_p", "Gyro_Gier_P", "yaw rate gain", since=80, poti=True),
    _p("gyro_yaw_i", "Gyro_Gier_I", "yaw angle gain", since=80, poti=True),
    _p("gyro_stability", "Gyro_Stability", "limit of stabilising action", since=84, poti=True),
    _p("low_voltage_warning", "UnterspannungsWarnung", "low battery; per cell when small", unit="0.1 V"),
    _p("emergency_throttle", "NotGas", "emergency throttle; percent of hover with vario_failsafe"),
    _p("emergency_throttle_time", "NotGasZeit", "duration of emergency throttle"),
    _p("frame_orientation", "UfoAusrichtung", "frame orientation (plus or X) in old firmware", until=81),
    _p("receiver", "Receiver", _RECEIVERS, since=82, high=9),
    _p("integral_factor", "I_Faktor", "main integral gain", poti=True),
    _p("user_1", "UserParam1", "free parameter 1", poti=True),
    _p("user_2", "UserParam2", "free parameter 2", poti=True),
    _p("user_3", "UserParam3", "free parameter 3", poti=True),
    _p("user_4", "UserParam4", "free parameter 4", poti=True),
    _p("servo_pitch_control", "ServoNickControl", "camera pitch", poti=True),
    _p("servo_pitch_compensation", "ServoNickComp", "camera pitch compensation"),
    _p("servo_pitch_min", "ServoNickMin", "lower servo stop"),
    _p("servo_pitch_max", "ServoNickMax", "upper servo stop"),
    _p("servo_roll_control", "ServoRollControl", "camera roll", since=76, poti=True),
    _p("servo_roll_compensation", "ServoRollComp", "camera roll compensation", since=76),
    _p("servo_roll_min", "ServoRollMin", "lower servo stop", since=76),
    _p("servo_roll_max", "ServoRollMax", "upper servo stop", since=76),
    _p("servo_refresh", "ServoNickRefresh", "servo update divider"),
    _p("servo_manual_speed", "ServoManualControlSpeed", "manual slew speed", since=85),
    _p("camera_orientation", "CamOrientation", "camera mount angle", since=85),
    _p("servo_3", "Servo3", "servo 3; 246 output 2, 247 output 1", since=82, poti=True),
    _p("servo_4", "Servo4", "servo 4", since=82, poti=True),
    _p("servo_5", "Servo5", "servo 5", since=82, poti=True),
    _p("loop_throttle_limit", "LoopGasLimit", "throttle limit while looping", poti=True),
    _p("loop_threshold", "LoopThreshold", "stick threshold to loop"),
    _p("loop_hysteresis", "LoopHysterese", "loop hysteresis"),
    _p("axis_coupling_1", "AchsKopplung1", "yaw to pitch and roll coupling", poti=True),
    _p("axis_counter_coupling_1", "AchsGegenKopplung1", "negative coupling", until=73, poti=True),
    _p("axis_coupling_2", "AchsKopplung2", "pitch to roll cross coupling", since=74, poti=True),
    _p("coupling_yaw_correction", "CouplingYawCorrection", "yaw correction of coupling", since=74, poti=True),
    _p("turn_over_pitch", "WinkelUmschlagNick", "angle of the 180 degree switch-over in pitch"),
    _p("turn_over_roll", "WinkelUmschlagRoll", "angle of the 180 degree switch-over in roll"),
    _p("gyro_accelerometer_fusion", "GyroAccAbgleich", "gyro/acc fusion divider"),
    _p("drift_compensation", "Driftkomp", "gyro drift compensation"),
    _p("dynamic_stability", "DynamicStability", "dynamic stability", poti=True),
    _p("user_5", "UserParam5", "free parameter 5", poti=True),
    _p("user_6", "UserParam6", "free parameter 6", poti=True),
    _p("user_7", "UserParam7", "free parameter 7", poti=True),
    _p("user_8", "UserParam8", "free parameter 8", poti=True),
    _p("output_1_pattern", "J16Bitmask", "output 1 blink pattern"),
    _p("output_1_timing", "J16Timing", "output 1 step time", poti=True),
    _p("output_2_pattern", "J17Bitmask", "output 2 blink pattern"),
    _p("output_2_timing", "J17Timing", "output 2 step time", poti=True),
    _p("output_1_warning_pattern", "WARN_J16_Bitmask", "output 1 low-battery pattern", since=77),
    _p("output_2_warning_pattern", "WARN_J17_Bitmask", "output 2 low-battery pattern", since=77),
    _p("navi_output_1", "NaviOut1Parameter", "output 1 distance parameter", since=92, until=98, poti=True),
    _p("photo_distance", "AutoPhotoDistance", "automatic trigger distance", since=100),
    _p("gps_mode_control", "NaviGpsModeControl", "GPS mode", until=94, poti=True),
    _p("gps_mode_channel", "NaviGpsModeChannel", "GPS mode channel", since=95),
    _p("gps_gain", "NaviGpsGain", "overall GPS gain", poti=True),
    _p("gps_p", "NaviGpsP", "GPS P", poti=True),
    _p("gps_i", "NaviGpsI", "GPS I", poti=True),
    _p("gps_d", "NaviGpsD", "GPS D", poti=True),
    _p("gps_p_limit", "NaviGpsPLimit", "P limit", since=74, poti=True),
    _p("gps_i_limit", "NaviGpsILimit", "I limit", since=74, poti=True),
    _p("gps_d_limit", "NaviGpsDLimit", "D limit", since=74, poti=True),
    _p("gps_acceleration", "NaviGpsACC", "acceleration gain", until=94, poti=True),
    _p("gps_acceleration", "NaviGpsA", "acceleration gain", since=95, poti=True),
    _p("gps_min_satellites", "NaviGpsMinSat", "satellites required"),
    _p("gps_stick_threshold", "NaviStickThreshold", "stick deflection that suspends GPS", poti=True),
    _p("gps_wind_correction", "NaviWindCorrection", "wind correction", poti=True),
    _p("gps_speed_compensation", "NaviSpeedCompensation", "speed compensation", until=87, poti=True),
    _p("gps_acceleration_compensation", "NaviAccCompensation", "acceleration compensation", since=88, poti=True),
    _p("gps_operating_radius", "NaviOperatingRadius", "allowed radius", until=101, poti=True),
    _p("gps_max_range", "NaviMaxFlyingRange", "maximum range", since=102, unit="10 m"),
    _p("gps_angle_limit", "NaviAngleLimitation", "tilt limit for GPS", poti=True),
    _p("gps_hold_delay", "NaviPH_LoginTime", "calm before position hold engages", since=74, unit="s"),
    _p("gps_descend_range", "NaviDescendRange", "range beyond which it descends", since=102, unit="10 m"),
    _p("external_control", "ExternalControl", "external control acts while this is above 128", poti=True),
    _p("orientation_angle", "OrientationAngle", "front direction", since=84, unit="15 deg", high=23),
    _p("care_free_control", "OrientationModeControl", "care-free", since=84, until=87, poti=True),
    _p("care_free_control", "CareFreeModeControl", "care-free", since=88, until=94, poti=True),
    _p("care_free_channel", "CareFreeChannel", "care-free channel", since=95),
    _p("motor_safety_switch", "MotorSafetySwitch", "channel that locks motor start/stop", since=85),
    _p("motor_smoothing", "MotorSmooth", "motor smoothing", since=88),
    _p("coming_home_altitude", "ComingHomeAltitude", "altitude for coming home", since=88, poti=True),
    _p("failsafe_time", "FailSafeTime", "coming-home time after RC loss", since=88),
    _p("max_altitude", "MaxAltitude", "altitude limit", since=88, poti=True),
    _p("failsafe_channel", "FailsafeChannel", "channel above 100 reports RC lost", since=90),
    _p("servo_filter_pitch", "ServoFilterNick", "servo filter", since=90),
    _p("servo_filter_roll", "ServoFilterRoll", "servo filter", since=90),
    _p("servo_3_on", "Servo3OnValue", "servo 3 when output on", since=101),
    _p("servo_3_off", "Servo3OffValue", "servo 3 when output off", since=101),
    _p("servo_4_on", "Servo4OnValue", "servo 4 when output on", since=101),
    _p("servo_4_off", "Servo4OffValue", "servo 4 when output off", since=101),
    _p(
        "servo_failsafe_positions",
        "ServoFS_Pos",
        "fail-safe positions of pitch, roll, 3, 4, 5",
        since=105,
        kind=Kind.LIST,
        lengths=((105, 5),),
    ),
    _p("start_land_channel", "StartLandChannel", "auto start/land channel", since=94),
    _p("landing_speed", "LandingSpeed", "auto landing speed", since=94),
    _p("compass_offset", "CompassOffset", "mounting offset; bits 6 and 7 switch declination", since=97),
    _p("auto_landing_voltage", "AutoLandingVoltage", "lands below; 0 off", since=97, unit="0.1 V"),
    _p("coming_home_voltage", "ComingHomeVoltage", "comes home below; 0 off", since=98, unit="0.1 V"),
    _p("photo_altitudes", "AutoPhotoAtitudes", "trigger every n altitude steps", since=100),
    _p("single_waypoint_speed", "SingleWpSpeed", "single waypoint speed", since=100),
    _p("landing_pulse", "LandingPulse", "acceleration peak that means touchdown", since=104),
    _p("single_waypoint_channel", "SingleWpControlChannel", "store/recall channel", since=106),
    _p("menu_key_channel", "MenuKeyChannel", "telemetry menu key channel", since=106),
    _p("camera_mode_channel", "CamCtrlModeChannel", "camera control mode channel", since=107),
    _p("camera_zoom_channel", "CamCtrlZoomChannel", "camera zoom channel", since=107),
    _p("failsafe_altitude", "FailsafeAltitude", "fail-safe altitude", since=112),
    _p("gimbal_yaw_channel", "GimbalYawChannel", "gimbal yaw channel", since=112),
    _p("gimbal_output_1_channel", "GimbalOut1Channel", "gimbal output 1 channel", since=113),
    _p("gimbal_output_2_channel", "GimbalOut2Channel", "gimbal output 2 channel", since=113),
    _p("external_gps_channel", "ExternalGpsChannel", "external GPS channel", since=114),
    _p(
        "reserved",
        "reserved",
        "spare",
        since=108,
        lengths=(
            (108, 32),
            (112, 30),
            (113, 28),
            (114, 27),
        ),
        kind=Kind.SPARE,
    ),
    _p("bit_config", "BitConfig", "loop and LED bits", bits=_BIT_CONFIG),
    _p("servo_invert", "ServoCompInvert", "servo inversion and coming-home direction bits", bits=_SERVO_INVERT),
    _p("extra_config", "ExtraConfig", "feature bits", since=79, bits=_EXTRA_CONFIG),
    _p(
        "reserved_end",
        "Reserved",
        "spare",
        until=79,
        lengths=(
            (73, 4),
            (79, 3),
        ),
        kind=Kind.SPARE,
    ),
    _p("global_config_3", "GlobalConfig3", "feature bits", since=90, bits=_GLOBAL_CONFIG_3),
    _p("name", "Name", "profile name", lengths=((73, 12),), kind=Kind.TEXT),
)
