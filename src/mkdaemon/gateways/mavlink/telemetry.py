"""Every message that is sent by itself: from which key, how often unless asked otherwise, and how it is made.

Times are the daemon's monotonic clock, "since boot" for a ground station. What is not known has the mark that the
dialect gives its field; a field without a mark is NaN where it is a float, and the message is left out where a number
that means nothing would be read as a measurement.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, Final, NamedTuple

import numpy as np

from mkdaemon.frames import rotation_from_quaternion
from mkdaemon.gateways.mavlink.dialect import (
    INT16_UNKNOWN,
    NAN,
    UINT8_UNKNOWN,
    UINT16_UNKNOWN,
    Message,
    mavlink,
)
from mkdaemon.gateways.mavlink.frames import (
    compass_from_yaw,
    degrees_e7,
    frd_from_flu,
    frd_from_local,
    heading_cdeg,
    ned_from_enu,
    ned_from_frd,
)
from mkdaemon.gateways.mavlink.picture import LinkPicture
from mkdaemon.reading.facts import battery_alarm
from mkdaemon.stamp import Stamp
from mkdaemon.telemetry.control import ControlEstimate, ControlStatus
from mkdaemon.telemetry.link import LinkHealth
from mkdaemon.telemetry.state import Altitude, Attitude, Battery, Flight, Gps, GpsFix, Pilot, Position, Velocity
from mkdaemon.telemetry.tone import Tone
from mkdaemon.telemetry.vehicle import VehicleHealth
from mkdaemon.telemetry.vision import CameraSetup, VisionPose

STICK_US: Final = 500.0 / 127.0
"""A full stick of 127 counts is 500 us beside the middle of a channel [us]."""
_MIDDLE_US: Final = 1500.0


class MessageRow(NamedTuple):
    """A message that is sent by itself.

    Attributes:
        message: makes it of the newest value of its kind; None while it cannot be said.
        of: kind of that value; None for a message that is always sent.
        rate: unless a ground station asks for another one [Hz]; 0 for none. None is faster than its source.
        is_by_clock: it is sent by the clock, not with its value.
    """

    message: Callable[[Any, LinkPicture], Message | None]
    of: type[Any] | None
    rate: float
    is_by_clock: bool = False

    def make(self, picture: LinkPicture) -> Message | None:
        """The message; None while it cannot be said."""
        now = None if self.of is None else picture.get(self.of)
        return None if now is None and self.of is not None else self.message(now, picture)


def boot_ms(stamp: Stamp) -> int:
    """A moment as `time_boot_ms`, which begins again after 49 days."""
    return int(stamp.monotonic * 1000) & 0xFFFF_FFFF


def boot_us(stamp: Stamp) -> int:
    """A moment as `time_usec`, counted since the boot."""
    return int(stamp.monotonic * 1e6)


def attitude(now: Attitude, picture: LinkPicture) -> Message | None:
    """ATTITUDE; rates are not reported."""
    yaw = compass_from_yaw(now.yaw)
    return mavlink.MAVLink_attitude_message(boot_ms(now.stamp), now.roll, -now.pitch, yaw, NAN, NAN, NAN)


def attitude_quaternion(now: Attitude, picture: LinkPicture) -> Message | None:
    """ATTITUDE_QUATERNION; rates are not reported."""
    turned = ned_from_frd(now.quaternion)
    return mavlink.MAVLink_attitude_quaternion_message(boot_ms(now.stamp), *turned, NAN, NAN, NAN)


def global_position(now: Position, picture: LinkPicture) -> Message | None:
    """GLOBAL_POSITION_INT: only while the GPS position is valid and its altitude known."""
    speed, above_sea = picture.get(Velocity), picture.above_sea
    if speed is None or above_sea is None or now.altitude_above_start is None:
        return None
    turn = picture.get(Attitude)
    north, east, down = (_clipped(100 * part, -32767, 32767) for part in ned_from_enu(speed.velocity_enu))
    return mavlink.MAVLink_global_position_int_message(
        boot_ms(now.stamp),
        degrees_e7(now.latitude_deg),
        degrees_e7(now.longitude_deg),
        round(1000 * above_sea),
        round(1000 * now.altitude_above_start),
        north,
        east,
        down,
        UINT16_UNKNOWN if turn is None else heading_cdeg(turn.yaw),
    )


def gps_raw(now: Gps, picture: LinkPicture) -> Message | None:
    """GPS_RAW_INT: fix 3D where the board calls its position valid; a MikroKopter tells no precision."""
    place, speed = picture.get(Position), picture.get(Velocity)
    is_valid = now.fix is GpsFix.VALID and place is not None
    latitude = longitude = altitude = 0
    if is_valid and place is not None:
        latitude, longitude = degrees_e7(place.latitude_deg), degrees_e7(place.longitude_deg)
        altitude = 0 if place.altitude is None else round(1000 * place.altitude)
    return mavlink.MAVLink_gps_raw_int_message(
        boot_us(now.stamp),
        mavlink.GPS_FIX_TYPE_3D_FIX if is_valid else mavlink.GPS_FIX_TYPE_NO_FIX,
        latitude,
        longitude,
        altitude,
        UINT16_UNKNOWN,
        UINT16_UNKNOWN,
        UINT16_UNKNOWN if speed is None else _clipped(100 * speed.ground_speed, 0, UINT16_UNKNOWN - 1),
        UINT16_UNKNOWN if speed is None or speed.ground_speed < 0.5 else heading_cdeg(speed.course),
        UINT8_UNKNOWN if now.satellites is None else min(now.satellites, UINT8_UNKNOWN - 1),
    )


def vfr_hud(turn: Attitude, picture: LinkPicture) -> Message | None:
    """VFR_HUD: no air speed is measured; the throttle is that of the FlightCtrl where it is reported."""
    speed, above_sea, pilot = picture.get(Velocity), picture.above_sea, picture.get(Pilot)
    throttle = None if pilot is None else _first(pilot.throttle_in_use, pilot.throttle)
    return mavlink.MAVLink_vfr_hud_message(
        NAN,
        NAN if speed is None else speed.ground_speed,
        heading_cdeg(turn.yaw) // 100,
        0 if throttle is None else _clipped((throttle + 127) / 2.54, 0, 100),
        NAN if above_sea is None else above_sea,
        NAN if speed is None else speed.climb_rate,
    )


def altitude(now: Altitude, picture: LinkPicture) -> Message | None:
    """ALTITUDE: above the start by barometer; local is above the target."""
    above_sea, estimate = picture.above_sea, picture.get(ControlEstimate)
    pose = picture.get(VisionPose)
    local = NAN if pose is None else pose.position_target[2]
    return mavlink.MAVLink_altitude_message(
        boot_us(now.stamp),
        now.above_start,
        NAN if above_sea is None else above_sea,
        local if estimate is None else estimate.position[2],
        now.above_start,
        -10_000.0,
        -1.0,
    )


def battery_status(now: Battery, picture: LinkPicture) -> Message | None:
    """BATTERY_STATUS: the whole voltage in cell 0; no remaining charge is estimated."""
    state = mavlink.MAV_BATTERY_CHARGE_STATE_UNDEFINED
    if now.is_low is not None:
        state = mavlink.MAV_BATTERY_CHARGE_STATE_LOW if now.is_low else mavlink.MAV_BATTERY_CHARGE_STATE_OK
    return mavlink.MAVLink_battery_status_message(
        0,
        mavlink.MAV_BATTERY_FUNCTION_ALL,
        mavlink.MAV_BATTERY_TYPE_LIPO,
        INT16_UNKNOWN,
        [_clipped(1000 * now.voltage, 0, UINT16_UNKNOWN - 1), *[UINT16_UNKNOWN] * 9],
        -1 if now.current is None else _clipped(100 * now.current, 0, 32767),
        -1 if now.used_mah is None else round(now.used_mah),
        -1,
        -1,
        0,
        state,
    )


def rc_channels(now: Pilot, picture: LinkPicture) -> Message | None:
    """RC_CHANNELS in the order roll, pitch, throttle, yaw; where the board reports no sticks only the quality."""
    channels = [UINT16_UNKNOWN] * 18
    count = 0
    if now.sticks is not None and now.throttle is not None:
        pitch, roll, yaw = now.sticks
        # Forward and left are below the middle there; nose down and nose left are positive here.
        sticks = (roll, -pitch, now.throttle, -yaw)
        channels[:4] = [_clipped(_MIDDLE_US + STICK_US * stick, 900, 2100) for stick in sticks]
        count = 4
    quality = _clipped(100 * now.rc_quality, 0, 100)  # per cent, as PX4 sends it and MAVSDK and QGroundControl show it
    return mavlink.MAVLink_rc_channels_message(boot_ms(now.stamp), count, *channels, quality)


def home_position(now: Position, picture: LinkPicture) -> Message | None:
    """HOME_POSITION, where home and its altitude are known; the local frame is another one, so its parts are NaN."""
    if now.home_latitude_deg is None or now.home_longitude_deg is None or picture.ground is None:
        return None
    return mavlink.MAVLink_home_position_message(
        degrees_e7(now.home_latitude_deg),
        degrees_e7(now.home_longitude_deg),
        round(1000 * picture.ground),
        *(NAN, NAN, NAN),
        [NAN] * 4,
        *(NAN, NAN, NAN),
        boot_us(now.stamp),
    )


def extended_state(_: None, picture: LinkPicture) -> Message | None:
    """EXTENDED_SYS_STATE: where the aircraft is between ground and air."""
    return mavlink.MAVLink_extended_sys_state_message(mavlink.MAV_VTOL_STATE_UNDEFINED, landed_state(picture))


def landed_state(picture: LinkPicture) -> int:
    """`MAV_LANDED_STATE`; undefined while the boards do not say whether it flies."""
    flight, status = picture.get(Flight), picture.get(ControlStatus)
    if flight is None or flight.is_flying is None:
        return int(mavlink.MAV_LANDED_STATE_UNDEFINED)
    manoeuvre = None if status is None else status.manoeuvre
    if not flight.motors_running:
        return int(mavlink.MAV_LANDED_STATE_ON_GROUND)
    if manoeuvre == "takeoff" and status is not None and not status.is_done:
        return int(mavlink.MAV_LANDED_STATE_TAKEOFF)
    if flight.emergency_landing or manoeuvre == "land":
        return int(mavlink.MAV_LANDED_STATE_LANDING)
    return int(mavlink.MAV_LANDED_STATE_IN_AIR if flight.is_flying else mavlink.MAV_LANDED_STATE_ON_GROUND)


def local_position(now: ControlEstimate, picture: LinkPicture) -> Message | None:
    """LOCAL_POSITION_NED in the frame of the target, while it is flown: before that no velocity is estimated."""
    place, speed = ned_from_enu(now.position), ned_from_enu(now.velocity)
    return mavlink.MAVLink_local_position_ned_message(boot_ms(now.stamp), *place, *speed)


def odometry(now: VisionPose, picture: LinkPicture) -> Message | None:
    """ODOMETRY of the tag in sight: pose by the camera; velocity by the estimate while it is flown, else NaN."""
    turned = ned_from_frd(now.quaternion_target_from_flu)
    estimate = picture.get(ControlEstimate)
    speed = (NAN, NAN, NAN)
    if estimate is not None:
        speed = _body_speed(estimate)
    return mavlink.MAVLink_odometry_message(
        boot_us(now.stamp),
        mavlink.MAV_FRAME_LOCAL_FRD,
        mavlink.MAV_FRAME_BODY_FRD,
        *ned_from_enu(now.position_target),
        turned,
        *speed,
        *(NAN, NAN, NAN),
        pose_covariance(now),
        [NAN] * 21,
        0,
        mavlink.MAV_ESTIMATOR_TYPE_VISION,
    )


def _body_speed(estimate: ControlEstimate) -> tuple[float, float, float]:
    """Velocity forward, right, down, the body turned level [m/s]."""
    east, north, up = estimate.velocity
    along, across = math.cos(estimate.yaw), math.sin(estimate.yaw)
    return frd_from_flu((along * east + across * north, along * north - across * east, up))


_NED = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
_UPPER = np.triu_indices(6)


def pose_covariance(pose: VisionPose) -> list[float]:
    """The covariance of a pose as ODOMETRY has it: local axes for the place, roll, pitch and yaw for the attitude.

    Args:
        pose: of the camera.

    Returns:
        The upper triangle by rows, 21 numbers [m2, m rad, rad2].
    """
    turn = rotation_from_quaternion(ned_from_frd(pose.quaternion_target_from_flu))
    # C' = J C J^T with J = diag(N, F N), N: NED from ENU, F: FRD from NED.
    both = np.zeros((6, 6))
    both[:3, :3], both[3:, 3:] = _NED, turn.T @ _NED  # small rotations about the body's axes are roll, pitch and yaw
    found = both @ np.array(pose.covariance).reshape(6, 6) @ both.T
    return [float(value) for value in found[_UPPER]]


def landing_target(now: VisionPose, picture: LinkPicture) -> Message | None:
    """LANDING_TARGET of the tag in sight, in the body's frame; angles as the camera measured them."""
    right, down, ahead = now.position_cam
    distance = math.sqrt(sum(part * part for part in now.position_flu))
    return mavlink.MAVLink_landing_target_message(
        boot_us(now.stamp),
        0,
        mavlink.MAV_FRAME_BODY_FRD,
        math.atan2(right, ahead),
        math.atan2(down, ahead),
        distance,
        *_size(picture.get(CameraSetup), now.target, distance),
        *frd_from_flu(now.position_flu),
        frd_from_local(now.quaternion_flu_from_target),
        mavlink.LANDING_TARGET_TYPE_VISION_FIDUCIAL,
        1,
    )


def _size(setup: CameraSetup | None, name: str, distance: float) -> tuple[float, float]:
    """Width and height of the largest tag of a target as angles [rad]; 0 where they are not known."""
    targets = () if setup is None else setup.targets
    for target in targets:
        if target.name == name and target.tags and distance > 0.0:
            corners = target.tags[0].corners
            width = math.dist(corners[0], corners[1])
            height = math.dist(corners[1], corners[2])
            return 2 * math.atan2(width / 2, distance), 2 * math.atan2(height / 2, distance)
    return 0.0, 0.0


def system_time(now: ControlStatus, picture: LinkPicture) -> Message | None:
    """SYSTEM_TIME: both clocks of the daemon, by its newest value."""
    return mavlink.MAVLink_system_time_message(int(now.stamp.wall * 1e6), boot_ms(now.stamp))


_GYRO = mavlink.MAV_SYS_STATUS_SENSOR_3D_GYRO | mavlink.MAV_SYS_STATUS_SENSOR_3D_ACCEL
_COMPASS = mavlink.MAV_SYS_STATUS_SENSOR_3D_MAG
_CONTROL = (
    mavlink.MAV_SYS_STATUS_SENSOR_ANGULAR_RATE_CONTROL
    | mavlink.MAV_SYS_STATUS_SENSOR_ATTITUDE_STABILIZATION
    | mavlink.MAV_SYS_STATUS_SENSOR_MOTOR_OUTPUTS
)


def system_status(_: None, picture: LinkPicture) -> Message | None:
    """SYS_STATUS: a sensor is present once its value came, and healthy while the value is fresh and good.

    errors_comm counts what was sent to the boards and not answered; errors_count1 to 3 are its link tests, requests and
    stick frames, errors_count4 the answers that came late.
    """
    battery = picture.get(Battery)
    present, health = _sensors(picture)
    line = picture.get(LinkHealth)
    lost = 0.0 if line is None else line.echo.loss_percent
    kinds = () if line is None else (line.link_tests, line.requests, line.stick_frames)
    unanswered = [kind.unanswered for kind in kinds] or [0, 0, 0]
    return mavlink.MAVLink_sys_status_message(
        present,
        present,
        health,
        0,
        UINT16_UNKNOWN if battery is None else _clipped(1000 * battery.voltage, 0, UINT16_UNKNOWN - 1),
        -1 if battery is None or battery.current is None else _clipped(100 * battery.current, 0, 32767),
        -1,
        _clipped(100 * lost, 0, 10_000),
        *(min(count, UINT16_UNKNOWN) for count in (sum(unanswered), *unanswered, sum(kind.late for kind in kinds))),
    )


def _sensors(picture: LinkPicture) -> tuple[int, int]:
    """Bits of the sensors that are present, and of those that work."""
    health = picture.get(VehicleHealth)
    gps, pilot, battery = picture.get(Gps), picture.get(Pilot), picture.get(Battery)
    has_boards, has_navi = picture.get(Attitude) is not None, health is not None and "nc" in health.boards
    has_fix = gps is not None and gps.fix is GpsFix.VALID
    has_charge = battery is not None and battery_alarm(battery, picture.known) is None
    link = picture.link
    is_well = health is not None and health.read_only is None and picture.known.tone is not Tone.BAD
    is_ready = is_well and link is not None and link.condition.is_usable
    seen: tuple[tuple[int, type[Any], bool], ...] = (
        (_GYRO | _CONTROL, Attitude, has_boards),
        (mavlink.MAV_SYS_STATUS_SENSOR_ABSOLUTE_PRESSURE, Altitude, picture.get(Altitude) is not None),
        (mavlink.MAV_SYS_STATUS_SENSOR_GPS, Gps, has_fix and picture.get(Position) is not None),
        (mavlink.MAV_SYS_STATUS_SENSOR_RC_RECEIVER, Pilot, pilot is not None and pilot.has_signal),
        (mavlink.MAV_SYS_STATUS_SENSOR_VISION_POSITION, CameraSetup, picture.get(VisionPose) is not None),
        (mavlink.MAV_SYS_STATUS_SENSOR_BATTERY, Battery, has_charge),
    )
    table = [(bits, picture.get(kind, is_old=True) is not None, works) for bits, kind, works in seen]
    table += [(_COMPASS, has_navi, has_boards), (mavlink.MAV_SYS_STATUS_PREARM_CHECK, True, is_ready)]
    present = sum(bits for bits, is_there, _ in table if is_there)
    healthy = sum(bits for bits, is_there, works in table if is_there and works)
    # There is no fence; MAVProxy calls it breached unless it is healthy.
    return present, healthy | mavlink.MAV_SYS_STATUS_GEOFENCE


def _clipped(value: float, low: int, high: int) -> int:
    return round(min(max(value, low), high))


def _first(*values: float | None) -> float | None:
    return next((value for value in values if value is not None), None)


TABLE: Final[dict[str, MessageRow]] = {
    "SYS_STATUS": MessageRow(system_status, None, 1.0, is_by_clock=True),
    "SYSTEM_TIME": MessageRow(system_time, ControlStatus, 1.0, is_by_clock=True),
    "ATTITUDE": MessageRow(attitude, Attitude, 25.0),
    "ATTITUDE_QUATERNION": MessageRow(attitude_quaternion, Attitude, 10.0),
    "LOCAL_POSITION_NED": MessageRow(local_position, ControlEstimate, 25.0),
    "GLOBAL_POSITION_INT": MessageRow(global_position, Position, 5.0),
    "GPS_RAW_INT": MessageRow(gps_raw, Gps, 5.0),
    "VFR_HUD": MessageRow(vfr_hud, Attitude, 4.0, is_by_clock=True),
    "ALTITUDE": MessageRow(altitude, Altitude, 5.0),
    "BATTERY_STATUS": MessageRow(battery_status, Battery, 1.0),
    "RC_CHANNELS": MessageRow(rc_channels, Pilot, 5.0),
    "HOME_POSITION": MessageRow(home_position, Position, 0.5, is_by_clock=True),
    "EXTENDED_SYS_STATE": MessageRow(extended_state, None, 2.0, is_by_clock=True),
    "LANDING_TARGET": MessageRow(landing_target, VisionPose, 15.0),
    "ODOMETRY": MessageRow(odometry, VisionPose, 30.0),
}
"""Every message that is sent by itself, but HEARTBEAT and what belongs to a protocol."""
BY_CLOCK: Final = tuple(name for name, row in TABLE.items() if row.is_by_clock)
"""Names of those that the clock sends."""
BY_VALUE: Final = {
    kind: tuple(name for name, row in TABLE.items() if row.of is kind and not row.is_by_clock)
    for kind in {row.of for row in TABLE.values()}
}
"""Names of those that are sent with a value of a kind."""
IDS: Final = {int(getattr(mavlink, f"MAVLINK_MSG_ID_{name}")): name for name in TABLE}
"""Names of those messages by their number."""
GROUPS: Final[dict[int, tuple[str, ...]]] = {
    mavlink.MAV_DATA_STREAM_RAW_SENSORS: ("GPS_RAW_INT",),
    mavlink.MAV_DATA_STREAM_EXTENDED_STATUS: ("SYS_STATUS", "BATTERY_STATUS", "EXTENDED_SYS_STATE"),
    mavlink.MAV_DATA_STREAM_RC_CHANNELS: ("RC_CHANNELS",),
    mavlink.MAV_DATA_STREAM_POSITION: ("GLOBAL_POSITION_INT", "LOCAL_POSITION_NED", "ODOMETRY"),
    mavlink.MAV_DATA_STREAM_EXTRA1: ("ATTITUDE", "ATTITUDE_QUATERNION"),
    mavlink.MAV_DATA_STREAM_EXTRA2: ("VFR_HUD", "ALTITUDE"),
    mavlink.MAV_DATA_STREAM_EXTRA3: ("SYSTEM_TIME", "HOME_POSITION", "LANDING_TARGET"),
}
"""The messages of a REQUEST_DATA_STREAM, as ArduPilot groups them."""
