"""NaviData (3, 4, 5): one message, the whole aircraft."""

from __future__ import annotations

import math

from mkdaemon.frames import yaw_enu_from_heading
from mkdaemon.protocol.errorcodes import ErrorCode, describe_error, is_fc_lost
from mkdaemon.protocol.flags import FlightStatus, FlightStatus2, NaviStatus, PositionStatus
from mkdaemon.protocol.messages import OsdData4, OsdData5
from mkdaemon.telemetry.state import Altitude, Battery, Flight, Gps, GpsFix, GpsMode, Pilot, Position, Velocity
from mkdaemon.translate.geometry import Home, east_north, position
from mkdaemon.translate.origin import Origin, State
from mkdaemon.translate.receiver import ReceiverWatch

RC_FULL = 200.0
"""Receiver quality that counts as full; docs/protocol.md, "Debug channels of the FlightCtrl", channel 10."""
RC_ENOUGH = 100.0
"""Below this the FlightCtrl goes into emergency; docs/protocol.md, "When it acts"."""
STICK_CENTRE = 127.0
"""Throttle of a centred stick as the boards report it; docs/protocol.md, "ExternalControl"."""

_MODES = {
    NaviStatus.FREE: GpsMode.FREE,
    NaviStatus.POSITION_HOLD: GpsMode.HOLD,
    NaviStatus.COMING_HOME: GpsMode.COME_HOME,
}


def gps_mode(flags: NaviStatus) -> GpsMode:
    """What the GPS switch says."""
    return next((mode for flag, mode in _MODES.items() if flags & flag), GpsMode.UNKNOWN)


def error_text(code: ErrorCode) -> str:
    """An error in words; empty for none."""
    return describe_error(code) if code else ""


def pilot(
    origin: Origin,
    quality: float,
    *,
    sticks: tuple[float, float, float] | None,
    throttle: float | None,
    gas: float | None = None,
    compensated_at: float | None = None,
    is_gate_open: bool | None = None,
) -> Pilot:
    """What reaches the aircraft from the pilot.

    Args:
        origin: when and from where.
        quality: of reception, the board's 0..200.
        sticks: pitch, roll, yaw, where they are reported [stick; FLU].
        throttle: where it is reported [stick].
        gas: what the FlightCtrl flies with, 0..254; zero and None say nothing.
        compensated_at: battery voltage that is in it [V]; None where it is the stick itself.
        is_gate_open: where it is reported.
    """
    return Pilot(
        **origin._asdict(),
        rc_quality=min(quality / RC_FULL, 1.0),
        has_signal=quality >= RC_ENOUGH,
        throttle=throttle,
        sticks=sticks,
        throttle_in_use=gas - STICK_CENTRE if gas else None,
        compensated_at=compensated_at if gas else None,
        is_gate_open=is_gate_open,
    )


def from_osd(osd: OsdData4 | OsdData5, origin: Origin, receiver: ReceiverWatch) -> list[State]:
    """Everything an OSD frame says, attitude aside (that one has a degree's resolution here).

    Args:
        osd: the frame.
        origin: when and from where.
        receiver: has seen the error code of this frame.
    """
    is_valid = osd.position_status != PositionStatus.INVALID and receiver.has_position
    gps = _gps(osd, origin, receiver, is_valid=is_valid)
    states: list[State] = [("state/gps", gps), ("state/flight", _flight(osd, origin, is_valid=is_valid))]
    if not is_fc_lost(osd.error_code):
        states.append(("state/battery", _battery(osd, origin)))
        gas = float(osd.throttle) if osd.fc_flags & FlightStatus.MOTORS_RUNNING else None
        # The NaviCtrl takes the compensation of the battery's voltage back: this is the stick (docs/firmware-notes).
        reported = pilot(origin, float(osd.rc_quality), sticks=None, throttle=None, gas=gas)
        states.append(("state/pilot", reported))
        states.append(("state/altitude", Altitude(**origin._asdict(), above_start=osd.si("altimeter"))))
    if is_valid:
        states.append(("state/position", _position(osd, origin)))
        states.append(("state/velocity", _velocity(osd, origin)))
    return states


def _home(osd: OsdData4 | OsdData5) -> Home | None:
    if osd.home_status == PositionStatus.INVALID:
        return None
    return Home(osd.si("home_latitude"), osd.si("home_longitude"))


def _position(osd: OsdData4 | OsdData5, origin: Origin) -> Position:
    home = _home(osd)
    return position(
        origin,
        latitude=osd.si("position_latitude"),
        longitude=osd.si("position_longitude"),
        altitude=osd.si("position_altitude"),
        above_start=None if is_fc_lost(osd.error_code) else osd.si("altimeter"),
        home=home,
        board_home_distance=None if home is None else osd.si("home_distance"),
    )


def _target_distance(osd: OsdData4 | OsdData5) -> float:
    """How far the target is [m]."""
    target = Home(osd.si("target_latitude"), osd.si("target_longitude"))
    return math.hypot(*east_north(osd.si("position_latitude"), osd.si("position_longitude"), target))


def _velocity(osd: OsdData4 | OsdData5, origin: Origin) -> Velocity:
    speed, climb = osd.si("ground_speed"), osd.si("vertical_speed")
    course = yaw_enu_from_heading(osd.si("course"))
    return Velocity(
        **origin._asdict(),
        velocity_enu=(speed * math.cos(course), speed * math.sin(course), climb),
        ground_speed=speed,
        course=course,
        climb_rate=climb,
    )


def _battery(osd: OsdData4 | OsdData5, origin: Origin) -> Battery:
    return Battery(
        **origin._asdict(),
        voltage=osd.si("battery"),
        current=osd.si("current"),
        used_mah=float(osd.used_capacity),
        is_low=bool(osd.fc_flags & FlightStatus.LOW_BATTERY),
    )


def _gps(osd: OsdData4 | OsdData5, origin: Origin, receiver: ReceiverWatch, *, is_valid: bool) -> Gps:
    return Gps(
        **origin._asdict(),
        satellites=receiver.satellites(osd.satellites),
        fix=GpsFix.VALID if is_valid else GpsFix.NONE,
        is_usable=bool(osd.nc_flags & NaviStatus.GPS_OK) and is_valid,
        is_home_set=osd.home_status != PositionStatus.INVALID,
    )


def _flight(osd: OsdData4 | OsdData5, origin: Origin, *, is_valid: bool) -> Flight:
    # Without the FlightCtrl its flags, and what else comes from it, stay as they were.
    first = None if is_fc_lost(osd.error_code) else osd.fc_flags
    second = osd.fc_flags_2 if isinstance(osd, OsdData5) and first is not None else None
    navi = osd.nc_flags

    def main(flag: FlightStatus) -> bool | None:
        return None if first is None else bool(first & flag)

    def extra(flag: FlightStatus2) -> bool | None:
        return None if second is None else bool(second & flag)

    has_target = osd.target_status != PositionStatus.INVALID
    return Flight(
        **origin._asdict(),
        # The first six bits mean the same in both generations of the flags.
        motors_running=main(FlightStatus.MOTORS_RUNNING),
        is_flying=main(FlightStatus.FLYING),
        is_calibrating=main(FlightStatus.CALIBRATING),
        is_starting=main(FlightStatus.STARTING),
        emergency_landing=main(FlightStatus.EMERGENCY_LANDING),
        battery_low=main(FlightStatus.LOW_BATTERY),
        care_free=extra(FlightStatus2.CARE_FREE),
        altitude_control=extra(FlightStatus2.ALTITUDE_CONTROL),
        rc_failsafe=extra(FlightStatus2.RC_FAILSAFE),
        waiting_for_takeoff=extra(FlightStatus2.WAITING_FOR_TAKEOFF),
        auto_starting=extra(FlightStatus2.AUTO_STARTING),
        auto_landing=extra(FlightStatus2.AUTO_LANDING),
        gps_mode=gps_mode(navi),
        manual_control=bool(navi & NaviStatus.MANUAL_CONTROL),
        range_limit=bool(navi & NaviStatus.RANGE_LIMIT),
        target_reached=bool(navi & NaviStatus.TARGET_REACHED),
        serial_link_lost=bool(navi & NaviStatus.NO_SERIAL_LINK),
        error_code=int(osd.error_code),
        error=error_text(osd.error_code),
        # It counts by the flag of the FlightCtrl, so it goes on, or stands, with that.
        flying_time=None if first is None else osd.si("flying_time"),
        waypoint_index=osd.waypoint_index,
        waypoint_count=osd.waypoint_count,
        target_distance=_target_distance(osd) if has_target and is_valid else None,
        target_latitude_deg=osd.si("target_latitude") if has_target else None,
        target_longitude_deg=osd.si("target_longitude") if has_target else None,
        board_target_distance=osd.si("target_distance") if has_target else None,
        altitude_setpoint=None if first is None else osd.si("altitude_setpoint"),
    )
