"""The NaviCtrl's data sets 10 to 16, which newer releases send in place of NaviData 5.

Source: docs/protocol.md, section 8.1: one set a frame, `MaxBytesPerSecond` caps the total, and a set whose content did
not change is sent less often.
"""

from __future__ import annotations

import math
from typing import Any, Final

from mkdaemon.protocol.flags import FlightStatus, FlightStatus2, OsdStatus, OsdStatus2
from mkdaemon.protocol.framing import padded_length
from mkdaemon.protocol.messages import (
    OsdDeviation,
    OsdFlags,
    OsdHome,
    OsdTarget,
    OsdTiny,
    OsdVolatile,
    OsdWaypoint,
)
from mkdaemon.protocol.wire import WireMessage
from mksim.boards.fc_replies import bounded
from mksim.boards.nc_board import NcBoard
from mksim.boards.waypoints import distance_and_bearing

FIRST: Final = 10
LAST: Final = 16
_OVERHEAD: Final = 6

_STATUS: Final = (
    (FlightStatus.CALIBRATING, OsdStatus.CALIBRATING),
    (FlightStatus.LOW_BATTERY, OsdStatus.LOW_BATTERY),
    (FlightStatus.CLIMB_TRIM, OsdStatus.CLIMB_TRIM),
    (FlightStatus.SINK_TRIM, OsdStatus.SINK_TRIM),
)
_STATUS_2: Final = (
    (FlightStatus.MOTORS_RUNNING, OsdStatus2.MOTORS_RUNNING),
    (FlightStatus.FLYING, OsdStatus2.FLYING),
    (FlightStatus.STARTING, OsdStatus2.STARTING),
    (FlightStatus.EMERGENCY_LANDING, OsdStatus2.EMERGENCY_LANDING),
)


def build_set(board: NcBoard) -> WireMessage | None:
    """Build the next set of the rotation, or None while the byte budget is used up."""
    if not board.may_send_set(board.now):
        return None
    index = board.next_set
    board.next_set = FIRST if index >= LAST else index + 1
    message = _build(board, index)
    board.spend_byte_budget(_OVERHEAD + padded_length(message.spec.size) // 3 * 4)
    return message


def _head(board: NcBoard, index: int) -> dict[str, Any]:
    sensors = board.flight.aircraft.sensors
    gps = board.navigator.fix
    fc, fc_2 = board.navigator.flight_status(), board.navigator.flight_status_2()
    status = OsdStatus(0)
    for ours, shown in _STATUS:
        if fc & ours:
            status |= shown
    if fc_2 & FlightStatus2.ALTITUDE_CONTROL:
        status |= OsdStatus.ALTITUDE_CONTROL
    speed = math.hypot(gps.velocity_enu[0], gps.velocity_enu[1])
    return {
        "index": index,
        "longitude": gps.longitude_1e7,
        "latitude": gps.latitude_1e7,
        "altimeter": bounded(sensors.baro_height * 20.0),
        "ground_speed": min(255, round(speed * 10.0)),
        "status": status,
    }


def _build(board: NcBoard, index: int) -> WireMessage:
    head = _head(board, index)
    flight = board.flight
    core, sensors = flight.core, flight.aircraft.sensors
    gps, points = board.navigator.fix, board.navigator.points
    here = (gps.longitude_1e7, gps.latitude_1e7)
    target = board.navigator.target
    if index == 10:
        return OsdTiny(**head, camera=0, reserved=0)
    if index == 11:
        return OsdFlags(
            **head,
            status_2=_status_2(board),
            nc_flags=board.navigator.flags(),
            reserved_flags=0,
            error_code=board.navigator.error_code,
            spoken=0,
            vario_character=" ",
            gps_mode_character="-",
            lowest_max_pwm=255,
        )
    if index == 12:
        return OsdTarget(
            **head,
            target_longitude=target.place[0] if target else 0,
            target_latitude=target.place[1] if target else 0,
            target_altitude=bounded(target.altitude) if target else 0,
            rc_quality=core.quality,
        )
    if index == 13:
        return OsdHome(
            **head,
            home_longitude=board.navigator.home[0],
            home_latitude=board.navigator.home[1],
            home_altitude=0,
            operating_radius=board.navigator.operating_radius,
            cell_count=core.cells,
            descend_range=0,
            manual_range=0,
            reserved_1=0,
            reserved_2=0,
        )
    if index == 14:
        to_home = distance_and_bearing(here, board.navigator.home) if board.navigator.home != (0, 0) else (0.0, 0.0)
        to_target = distance_and_bearing(here, target.place) if target else (0.0, 0.0)
        return OsdDeviation(
            **head,
            flying_time=board.navigator.flying_time,
            home_distance=board.navigator.decimetres(to_home[0]),
            home_bearing=round(to_home[1] / 2.0) % 180,
            target_distance=board.navigator.decimetres(to_target[0]),
            target_bearing=round(to_target[1] / 2.0) % 180,
            pitch=bounded(math.degrees(sensors.fc_angle_pitch), 8),
            roll=bounded(-math.degrees(sensors.fc_angle_roll), 8),
            satellites=gps.satellites,
        )
    if index == 15:
        return OsdWaypoint(
            **head,
            waypoint_index=points.index,
            waypoint_count=points.waypoints,
            target_hold_time=round(points.hold_left(board.now)),
            event_channel=0,
            reserved=0,
        )
    east, north, up = gps.velocity_enu
    return OsdVolatile(
        **head,
        battery=max(0, round(sensors.battery_voltage * 10.0)),
        current=max(0, round(sensors.battery_current * 10.0)),
        used_capacity=max(0, min(0xFFFF, round(sensors.battery_used_mah))),
        variometer=bounded(up * 10.0, 8),
        course=round(math.degrees(math.atan2(east, north)) % 360.0 / 2.0) % 180,
        heading=round(sensors.compass_deg / 2.0) % 180,
        throttle=round(core.gas(flight.live)) if core.running else 0,
        shutter_count=0,
        altitude_setpoint=head["altimeter"],
    )


def _status_2(board: NcBoard) -> OsdStatus2:
    flags = OsdStatus2(0)
    fc = board.navigator.flight_status()
    for ours, shown in _STATUS_2:
        if fc & ours:
            flags |= shown
    return flags
