"""What a NaviCtrl sends: its replies, the pages of its menu, and the data sets 10 to 16 of newer releases.

Each is built from the project's own messages; the texts of the menu are our own. The data sets come in place of
NaviData 5: one set a frame, `MaxBytesPerSecond` caps the total.

Source: docs/protocol.md, "Common commands" and section 8.1; docs/firmware-notes for what a page too high gives.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from typing import Any, Final

from mkdaemon.protocol.errorcodes import describe_error
from mkdaemon.protocol.flags import BoardStatus, FlightStatus, FlightStatus2, OsdStatus, OsdStatus2, PositionStatus
from mkdaemon.protocol.framing import encode_frame, padded_length
from mkdaemon.protocol.messages import (
    AttitudeDataNc,
    AttitudeDataNcSticks,
    ControlConfirm,
    DebugDataNc,
    Echo,
    ErrorText,
    Label,
    Menu,
    MotorStatus,
    NaviParameter,
    NaviTime,
    NaviVersion200,
    NaviVersionClassic,
    OsdData5,
    OsdDeviation,
    OsdFlags,
    OsdHome,
    OsdTarget,
    OsdTiny,
    OsdVolatile,
    OsdWaypoint,
    Waypoint024,
    Waypoint2x,
    WaypointCount,
    WaypointWritten,
)
from mkdaemon.protocol.wire import Board, WireMessage
from mksim.boards.display import compose
from mksim.boards.external import FULL
from mksim.boards.flightctrl_replies import PROTOCOL_MAJOR, bounded
from mksim.boards.labels import NC_LABELS, label
from mksim.boards.navictrl_state import NcBoard
from mksim.boards.waypoints import distance_and_bearing


def display(board: NcBoard) -> WireMessage:
    """Build H."""
    return board.menu.wrap(_text(board, board.menu.shown))


def menu(board: NcBoard, number: int) -> WireMessage:
    """Build L; a number too high gives the last page."""
    pages = board.menu
    pages.shown = min(number, pages.last)
    return Menu(page=pages.shown, last_page=pages.last, text=_text(board, pages.shown))


def _text(board: NcBoard, page: int) -> str:
    sensors, core = board.flight.aircraft.sensors, board.flight.core
    gps, sticks = board.navigator.fix, core.receiver
    major, minor, patch = board.generation.release
    error = board.navigator.error_code
    fix = f"Sat {gps.satellites:2d} {'3D fix' if gps.has_fix else 'no fix'}"
    east, north, up = gps.velocity_enu
    pages: dict[int, tuple[str, ...]] = {
        0: (
            "NaviCtrl",
            f"HW 2.0  SW {major}.{minor:02d}{chr(ord('a') + patch)}",
            f"Error {error:3d}",
        ),
        1: (
            fix,
            f"Lon {gps.longitude_1e7 / 1e7:12.7f}",
            f"Lat {gps.latitude_1e7 / 1e7:12.7f}",
            f"Alt {gps.altitude:9.2f} m",
        ),
        2: (
            fix,
            f"North {north * 100:+5.0f} cm/s",
            f"East  {east * 100:+5.0f} cm/s",
            f"Up    {up * 100:+5.0f} cm/s",
        ),
        3: ("Time", f"{board.flight.now:10.1f} s"),
        4: ("Mode", board.navigator.mode_name),
        5: ("Range", f"Radius {board.navigator.operating_radius:4d} m"),
        7: ("Home", *(f"{value / 1e7:12.7f}" for value in board.navigator.home)),
        8: (
            "Sticks",
            f"Pit{sticks.pitch:5.0f} Rol{sticks.roll:5.0f}",
            f"Thr{sticks.throttle + FULL:5.0f} Yaw{sticks.yaw:5.0f}",
        ),
        9: ("Potis 1", *(f"{core.potis[i]:5d}{core.potis[i + 1]:5d}" for i in (0, 2))),
        10: ("Potis 2", *(f"{core.potis[i]:5d}{core.potis[i + 1]:5d}" for i in (4, 6))),
        13: (
            f"RC level {core.quality:3d}",
            f"Battery {sensors.battery_voltage:5.1f} V",
            f"Compass {sensors.compass_deg:4.0f}",
        ),
        15: ("Magnetic field", "X -101", "Y -172", "Z  420"),
    }
    return compose(page, *pages.get(page, (f"Page {page}",)))


_OVERHEAD: Final = 6
_Head = dict[str, Any]
"""Fields that every data set begins with."""

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
    board.next_set = min(_SETS) if index >= max(_SETS) else index + 1
    message = _SETS[index](board, _head(board, index))
    board.spend_byte_budget(_OVERHEAD + padded_length(message.spec.size) // 3 * 4)
    return message


def _head(board: NcBoard, index: int) -> _Head:
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


def _tiny(board: NcBoard, head: _Head) -> WireMessage:
    return OsdTiny(**head, camera=0, reserved=0)


def _flags(board: NcBoard, head: _Head) -> WireMessage:
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


def _target_set(board: NcBoard, head: _Head) -> WireMessage:
    target = board.navigator.target
    return OsdTarget(
        **head,
        target_longitude=target.place[0] if target else 0,
        target_latitude=target.place[1] if target else 0,
        target_altitude=bounded(target.altitude) if target else 0,
        rc_quality=board.flight.core.quality,
    )


def _home(board: NcBoard, head: _Head) -> WireMessage:
    return OsdHome(
        **head,
        home_longitude=board.navigator.home[0],
        home_latitude=board.navigator.home[1],
        home_altitude=board.navigator.home_altitude,
        operating_radius=board.navigator.operating_radius,
        cell_count=board.flight.core.cells,
        descend_range=0,
        manual_range=0,
        reserved_1=0,
        reserved_2=0,
    )


def _deviation(board: NcBoard, head: _Head) -> WireMessage:
    navigator, (pitch, roll) = board.navigator, _angles(board)
    here, target = (navigator.fix.longitude_1e7, navigator.fix.latitude_1e7), navigator.target
    to_home = distance_and_bearing(here, navigator.home) if navigator.home != (0, 0) else (0.0, 0.0)
    to_target = distance_and_bearing(here, target.place) if target else (0.0, 0.0)
    return OsdDeviation(
        **head,
        flying_time=navigator.flying_time,
        home_distance=navigator.decimetres(to_home[0]),
        home_bearing=round(to_home[1] / 2.0) % 180,
        target_distance=navigator.decimetres(to_target[0]),
        target_bearing=round(to_target[1] / 2.0) % 180,
        pitch=bounded(math.degrees(pitch), 8),
        roll=bounded(math.degrees(roll), 8),
        satellites=navigator.fix.satellites,
    )


def _waypoint(board: NcBoard, head: _Head) -> WireMessage:
    points = board.navigator.points
    return OsdWaypoint(
        **head,
        waypoint_index=points.index,
        waypoint_count=points.waypoints,
        target_hold_time=round(points.hold_left(board.now)),
        event_channel=0,
        reserved=0,
    )


def _volatile(board: NcBoard, head: _Head) -> WireMessage:
    sensors = board.flight.aircraft.sensors
    east, north, up = board.navigator.fix.velocity_enu
    return OsdVolatile(
        **head,
        battery=max(0, round(sensors.battery_voltage * 10.0)),
        current=max(0, round(sensors.battery_current * 10.0)),
        used_capacity=max(0, min(0xFFFF, round(sensors.battery_used_mah))),
        variometer=bounded(up * 10.0, 8),
        course=round(math.degrees(math.atan2(east, north)) % 360.0 / 2.0) % 180,
        heading=round(sensors.compass_deg / 2.0) % 180,
        throttle=_throttle(board),
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


_SETS: Final[dict[int, Callable[[NcBoard, _Head], WireMessage]]] = {
    10: _tiny,
    11: _flags,
    12: _target_set,
    13: _home,
    14: _deviation,
    15: _waypoint,
    16: _volatile,
}
"""Data sets by number, in the order of their rotation."""


_OSD_VERSION: Final = 5
_START_OF_TIME: Final = datetime(2026, 6, 1, 12, tzinfo=UTC)
"""What the GPS clock shows when a simulation begins."""
_SPI_PERIOD: Final = 0.02


def build(board: NcBoard, letter: str, value: int) -> bytes | None:
    """Build the reply frame of this letter; `value` is what the request slot held. None sends nothing."""
    if letter == "E":
        return encode_frame(int(Board.NC), letter, _error_text(board))
    message = _BUILDERS[letter](board, value)
    return None if message is None else message.to_frame(Board.NC)


def _confirm(board: NcBoard, value: int) -> WireMessage:
    return ControlConfirm(frame=value)


def _echo(board: NcBoard, value: int) -> WireMessage:
    return Echo(pattern=value)


def _parameter(board: NcBoard, value: int) -> WireMessage:
    return NaviParameter.decode(bytes([value]) + (board.parameters.get(value, 0) & 0xFFFF).to_bytes(2, "little"))


def _written(board: NcBoard, value: int) -> WireMessage:
    return WaypointWritten(index=value)


def _point(board: NcBoard, value: int) -> WireMessage | None:
    raw = board.navigator.points.read(value)
    if raw is None:
        return None
    if len(raw) == 1:
        return WaypointCount.decode(raw)
    return (Waypoint2x if board.generation.data_sets else Waypoint024).decode(raw)


def _label(board: NcBoard, value: int) -> WireMessage:
    number, text = label(NC_LABELS, value)
    return Label(index=number, text=text)


def _version(board: NcBoard, value: int) -> WireMessage:
    major, minor, patch = board.generation.release
    if board.generation.data_sets:
        return NaviVersion200.decode(bytes((major, minor, PROTOCOL_MAJOR, 0, patch, 0, 0, 20, 0, 1)))
    return NaviVersionClassic.decode(bytes((major, minor, PROTOCOL_MAJOR, 0, patch, 0, 0, 0, 0, 0)))


def _error_text(board: NcBoard) -> bytes:
    """The text and, behind its end, what stood there before: no message class can say that."""
    text = describe_error(board.navigator.error_code)[: ErrorText.spec.size - 1].encode("latin-1", "replace") + b"\0"
    board.error_text[: len(text)] = text
    return bytes(board.error_text)


def _display(board: NcBoard, value: int) -> WireMessage:
    return display(board)


def _menu(board: NcBoard, value: int) -> WireMessage:
    return menu(board, value)


def _angles(board: NcBoard) -> tuple[float, float]:
    """Pitch and roll of the FlightCtrl as the board knows them, with the signs of the wire [rad]."""
    pitch, roll = board.flight.reported_angles
    return pitch, -roll


def _attitude(board: NcBoard, value: int) -> WireMessage:
    sensors = board.flight.aircraft.sensors
    pitch, roll = (bounded(math.degrees(angle) * 10.0) for angle in _angles(board))
    heading = round(sensors.heading_deg * 10.0) % 3600
    if board.generation.attitude is AttitudeDataNc:
        return AttitudeDataNc(pitch=pitch, roll=roll, heading=heading, reserved=(0,) * 8)
    sticks = board.flight.core.receiver
    return AttitudeDataNcSticks(
        pitch=pitch,
        roll=roll,
        heading=heading,
        stick_pitch=round(sticks.pitch) & 0xFF,
        stick_roll=round(sticks.roll) & 0xFF,
        stick_yaw=round(sticks.yaw) & 0xFF,
        stick_throttle=round(sticks.throttle + FULL) & 0xFF,
        reserved=(0,) * 4,
    )


def _debug(board: NcBoard, value: int) -> WireMessage:
    flight = board.flight
    sensors = flight.aircraft.sensors
    gps = board.navigator.fix
    north, east = board.navigator.deviation
    exchanges = int(board.now / _SPI_PERIOD)
    analog = [0] * 32
    analog[0], analog[1] = (bounded(math.degrees(angle) * 10.0) for angle in _angles(board))
    analog[2] = bounded(-math.degrees(math.atan2(sensors.acc_x, 9.81)) * 10.0)
    analog[3] = bounded(-math.degrees(math.atan2(sensors.acc_y, 9.81)) * 10.0)
    analog[4] = board.navigator.operating_radius
    analog[5] = int(board.navigator.flight_status())
    analog[6] = int(board.navigator.flags())
    analog[9] = gps.sequence & 0x7FFF
    analog[10] = round(sensors.compass_deg) % 360
    analog[11] = round(sensors.heading_deg * 10.0) % 3600 // 10
    analog[13] = exchanges & 0x7FFF
    analog[15] = 2 * exchanges & 0x7FFF
    analog[21] = bounded(gps.velocity_enu[1] * 100.0)
    analog[22] = bounded(gps.velocity_enu[0] * 100.0)
    analog[27] = bounded(north * 100.0)
    analog[28] = bounded(east * 100.0)
    analog[31] = gps.satellites
    green = BoardStatus.FC | BoardStatus.BL | BoardStatus.NC | BoardStatus.COMPASS
    return DebugDataNc(status_green=green, status_red=BoardStatus(0), analog=tuple(analog))


def _osd(board: NcBoard, value: int) -> WireMessage | None:
    if board.byte_budget:
        return build_set(board)
    flight = board.flight
    core, sensors = flight.core, flight.aircraft.sensors
    gps = board.navigator.fix
    here = (gps.longitude_1e7, gps.latitude_1e7)
    navigator, target = board.navigator, board.navigator.target
    there = target.place if target is not None else (0, 0)
    to_target = distance_and_bearing(here, there) if target is not None else (0.0, 0.0)
    has_home = navigator.home != (0, 0)
    to_home = distance_and_bearing(here, navigator.home) if has_home else (0.0, 0.0)
    east, north, up = gps.velocity_enu
    pitch, roll = _angles(board)
    return OsdData5(
        version=_OSD_VERSION,
        position_longitude=here[0],
        position_latitude=here[1],
        position_altitude=bounded(gps.altitude * 1000.0, 32),
        position_status=navigator.position_status,
        target_longitude=there[0],
        target_latitude=there[1],
        target_altitude=target.altitude if target is not None else 0,
        target_status=board.generation.fix_status if target is not None else PositionStatus.INVALID,
        target_distance=navigator.decimetres(to_target[0]),
        target_bearing=round(to_target[1]),
        home_longitude=navigator.home[0],
        home_latitude=navigator.home[1],
        home_altitude=navigator.home_altitude,
        home_status=board.generation.fix_status if has_home else PositionStatus.INVALID,
        home_distance=navigator.decimetres(to_home[0]),
        home_bearing=round(to_home[1]),
        waypoint_index=navigator.points.index,
        waypoint_count=navigator.points.waypoints,
        satellites=gps.satellites,
        altimeter=bounded(sensors.baro_height * 20.0),
        variometer=bounded(sensors.vertical_speed * 20.0 * _SPI_PERIOD * 10.0),
        flying_time=navigator.flying_time,
        battery=_battery_field(board),
        ground_speed=min(0xFFFF, round(math.hypot(east, north) * 100.0)),
        course=round(math.degrees(math.atan2(east, north))) % 360,
        heading=round(sensors.compass_deg) % 360,
        pitch=bounded(math.degrees(pitch), 8),
        roll=bounded(math.degrees(roll), 8),
        rc_quality=core.quality,
        fc_flags=navigator.flight_status(),
        nc_flags=navigator.flags(),
        error_code=navigator.error_code,
        operating_radius=navigator.operating_radius,
        vertical_speed=bounded(up * 100.0),
        target_hold_time=round(navigator.points.hold_left(board.now)),
        fc_flags_2=navigator.flight_status_2(),
        altitude_setpoint=bounded(sensors.baro_height * 20.0),
        throttle=_throttle(board),
        current=max(0, min(0xFFFF, round(sensors.battery_current * 10.0))),
        used_capacity=max(0, min(0xFFFF, round(sensors.battery_used_mah))),
    )


def _throttle(board: NcBoard) -> int:
    """The FlightCtrl's throttle with its compensation of the battery's voltage taken back, in whole tenths of a volt.

    Source: docs/lab/genuine-navictrl.md.
    """
    flight = board.flight
    voltage = round(flight.aircraft.sensors.battery_voltage * 10.0)
    reference = round(flight.core.low_voltage(flight.live) * 10.0)
    return voltage * flight.core.reported_gas(flight.live) // reference & 0xFF if reference else 0


def _battery_field(board: NcBoard) -> int:
    """The voltage [0.1 V]; the public fork puts the used capacity there."""
    sensors = board.flight.aircraft.sensors
    if board.flight.is_fork:
        return round(sensors.battery_used_mah) & 0xFF
    return max(0, min(255, round(sensors.battery_voltage * 10.0)))


def _motor(board: NcBoard, value: int) -> WireMessage:
    index = board.motor_order.randrange(12)
    setpoint = board.flight.aircraft.sensors.motor_setpoints[index]
    present = index < 4
    current = round(board.flight.aircraft.sensors.battery_current * 2.5) if present and setpoint else 0
    return MotorStatus(
        index=index,
        current=min(255, current),
        temperature=35 if present else 0,
        max_pwm=(255 if setpoint else 250) if present else 0,
        status=0x80 if present else 0,
    )


def _time(board: NcBoard, value: int) -> WireMessage:
    shown = _START_OF_TIME + timedelta(seconds=board.now)
    return NaviTime(
        year=shown.year,
        month=shown.month,
        day=shown.day,
        hour=shown.hour,
        minute=shown.minute,
        second=shown.second,
        millisecond=shown.microsecond // 1000,
        valid=1,
    )


_BUILDERS: Final[dict[str, Callable[[NcBoard, int], WireMessage | None]]] = {
    "B": _confirm,
    "J": _parameter,
    "Z": _echo,
    "W": _written,
    "X": _point,
    "A": _label,
    "O": _osd,
    "D": _debug,
    "C": _attitude,
    "K": _motor,
    "H": _display,
    "L": _menu,
    "V": _version,
    "T": _time,
}
