"""Meaning of the bits of the FlightCtrl's parameters, with the revisions that have them.

Source: docs/protocol.md, "Settings".
"""

from __future__ import annotations

from typing import Final

from mkdaemon.protocol.settings_fields import Bit

GLOBAL_CONFIG: Final = (
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
BIT_CONFIG: Final = (
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
SERVO_INVERT: Final = (
    Bit(0x01, "pitch_inverted", "NICK_INV"),
    Bit(0x02, "roll_inverted", "ROLL_INV"),
    Bit(0x04, "relative", "RELATIVE", since=92),
    Bit(0x08, "coming_home_direction_1", "CH_DIRECTION_1", since=104),
    Bit(0x10, "coming_home_direction_2", "CH_DIRECTION_2", since=104),
)
EXTRA_CONFIG: Final = (
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
GLOBAL_CONFIG_3: Final = (
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
