"""What a FlightCtrl sends: its replies, the pages of its menu, and which frame leaves next.

Replies are built from the project's own messages; the texts of the menu are our own. At most one frame starts in a
pass of the main loop, and only on an idle transmitter.

Source: docs/protocol.md, "Common commands"; docs/firmware-notes, "Losses" and "Subscriptions", and for what a page too
high gives.
"""

from __future__ import annotations

import math
from typing import Final

from mkdaemon.protocol.flags import BoardStatus, FlightFault0, FlightFault1, MenuKey, VersionFlags
from mkdaemon.protocol.messages import (
    AttitudeDataFc210,
    AttitudeDataFcOld,
    CompassFeedOld,
    ControlConfirm,
    DebugDataFc,
    Label,
    Menu,
    NaviVersionClassic,
    Receiver071,
    Receiver200,
    VersionClassic,
    VersionFc200,
    VersionFc210,
)
from mkdaemon.protocol.wire import Board, WireMessage
from mksim.boards.display import compose
from mksim.boards.external import FULL
from mksim.boards.flightctrl_state import FcBoard
from mksim.boards.labels import FC_LABELS, label, label_checksum

PROTOCOL_MAJOR: Final = 11
_EARLY_PROTOCOL_MAJOR: Final = 10
_HARDWARE: Final = 22
_BL_FIRMWARE: Final = 208
_GRAVITY: Final = 9.81
_ACC_Z_UNIT: Final = 140.0
"""Raw accelerometer counts a g that this simulation reports."""
_SHOWN: Final = 1.13
"""Data3D over the FlightCtrl's own angle scale. Source: docs/lab/simulator.md, attitude loop."""


def bounded(value: float, bits: int = 16) -> int:
    """Round and clip to a signed integer of `bits` bits."""
    top = (1 << (bits - 1)) - 1
    return max(-top, min(top, round(value)))


def version(board: FcBoard) -> WireMessage:
    """Build V."""
    generation = board.generation
    major, minor, patch = generation.release
    fault_0, fault_1 = FlightFault0(0), FlightFault1(0)
    if board.core.quality == 0:
        fault_1 |= FlightFault1.NO_RECEIVER
    flags = VersionFlags.COMPANION_PRESENT if board.has_companion else VersionFlags(0)
    if generation.version is VersionClassic:
        return VersionClassic(
            major=major,
            minor=minor,
            protocol_major=_EARLY_PROTOCOL_MAJOR,
            protocol_minor=0,
            patch=patch,
            fault_0=fault_0,
            fault_1=fault_1,
            fault_rest=(0, 0, 0),
        )
    if generation.version is VersionFc200:
        return VersionFc200(
            major=major,
            minor=minor,
            protocol_major=PROTOCOL_MAJOR,
            reserved_1=0,
            patch=patch,
            fault_0=fault_0,
            fault_1=fault_1,
            hardware=_HARDWARE,
            motor_controller=0,
            flags=flags,
        )
    return VersionFc210(
        major=major,
        minor=minor,
        protocol_major=PROTOCOL_MAJOR,
        label_checksum=label_checksum(FC_LABELS),
        patch=patch,
        fault_0=fault_0,
        fault_1=fault_1,
        hardware=_HARDWARE,
        motor_controller=_BL_FIRMWARE,
        flags=flags,
    )


def companion_version(board: FcBoard) -> WireMessage:
    """Build V as asked with payload 2: the NaviCtrl's release as learnt over SPI; zeros and faults without one."""
    major, minor, patch = board.companion_release
    fault = 0 if board.has_companion else 0xFF
    return NaviVersionClassic(
        major=major,
        minor=minor,
        protocol_major=PROTOCOL_MAJOR,
        protocol_minor=label_checksum(FC_LABELS),
        patch=patch,
        fault_0=fault,
        fault_rest=(fault, 0, _BL_FIRMWARE, 0),
    )


def control_state(board: FcBoard) -> WireMessage:
    """Build G."""
    return board.external.held


def name(index: int) -> WireMessage:
    """Build A."""
    number, text = label(FC_LABELS, index)
    return Label(index=number, text=text)


def attitude(board: FcBoard) -> WireMessage:
    """Build C."""
    sensors = board.aircraft.sensors
    pitch, roll = (bounded(math.degrees(angle) * 10.0 * _SHOWN) for angle in (board.collected[0], -board.collected[1]))
    heading = round(sensors.heading_deg * 10.0) % 3600
    if board.generation.attitude is AttitudeDataFcOld:
        return AttitudeDataFcOld(pitch=pitch, roll=roll, heading=heading, centroid=(0, 0, 0), reserved=(0,) * 5)
    return AttitudeDataFc210(
        pitch=pitch,
        roll=roll,
        heading=heading,
        centroid=(0, 0, 0),
        accelerometer_z=max(0, bounded(sensors.acc_z / _GRAVITY * _ACC_Z_UNIT)),
        reserved=(0,) * 3,
    )


def debug(board: FcBoard) -> WireMessage:
    """Build D; the channel meanings are the labels'."""
    sensors, core = board.aircraft.sensors, board.core
    motors = board.motors.setpoints(board.now) or sensors.motor_setpoints
    analog = [0] * 32
    analog[0] = bounded(math.degrees(sensors.fc_angle_pitch) * 10.0)
    analog[1] = bounded(-math.degrees(sensors.fc_angle_roll) * 10.0)
    analog[2] = bounded(-math.degrees(math.atan2(sensors.acc_x, _GRAVITY)) * 10.0)
    analog[3] = bounded(-math.degrees(math.atan2(sensors.acc_y, _GRAVITY)) * 10.0)
    analog[4] = bounded(math.degrees(sensors.gyro_z))
    analog[5] = bounded(sensors.baro_height * 10.0)
    analog[6] = bounded(sensors.acc_z / _GRAVITY * _ACC_Z_UNIT)
    analog[7] = 4 * core.reported_gas(board.live)
    analog[8] = round(sensors.compass_deg) % 360 if board.forced_heading is None else board.forced_heading
    analog[9] = bounded(sensors.battery_voltage * 10.0)
    analog[10] = core.quality
    analog[11] = round(sensors.heading_deg) % 360
    analog[12:16] = motors[:4]
    analog[21] = round(4.0 * 125.0)
    analog[22] = bounded(sensors.battery_current * 10.0)
    analog[23] = bounded(sensors.battery_used_mah)
    analog[24] = analog[5]
    if board.is_fork:
        sticks = core.mixed
        analog[16:20] = [
            bounded(sticks.pitch),
            bounded(sticks.roll),
            bounded(sticks.yaw),
            bounded(sticks.throttle + FULL),
        ]
        analog[25], analog[26] = int(core.controlled), int(core.calibrated)
    analog[29] = 255
    green = BoardStatus.FC | BoardStatus.BL
    if board.has_companion:
        green |= BoardStatus.NC
    return DebugDataFc(status_green=green, status_red=BoardStatus(0), analog=tuple(analog))


def receiver(board: FcBoard) -> WireMessage:
    """Build P: 0 level, 1..16 receiver, 17..28 serial channels, 29 waypoint event, 30..32 fixed, 33 and 34 spare."""
    count = board.generation.channels
    channels = [0] * 35
    channels[1:29] = [-FULL] * 28
    for channel, value in board.core.channels(board.live).items():
        channels[channel] = bounded(max(-FULL, min(FULL, value)))
    channels[17:29] = board.serial_channels
    channels[29:35] = [-FULL, -FULL, FULL, 0, -FULL, -FULL]
    if count == 11:
        return Receiver071(channels=tuple(channels[:11]))
    return Receiver200(channels=tuple(channels))


def confirm(frame: int) -> WireMessage:
    """Build B."""
    return ControlConfirm(frame=frame)


def compass_feed(board: FcBoard) -> WireMessage:
    """Build the attitude for an MK3Mag."""
    sensors = board.aircraft.sensors
    return CompassFeedOld(
        pitch=bounded(math.degrees(sensors.fc_angle_pitch) * 10.0),
        roll=bounded(-math.degrees(sensors.fc_angle_roll) * 10.0),
        user_parameter_1=board.live["user_1"],
        user_parameter_2=board.live["user_2"],
        calibration_step=0,
        orientation=0,
    )


PRINT: Final = 1.2e-3
"""Time to print a page before it is sent."""
_TRIM_PAGE: Final = 5
"""The accelerometer's page: keys 3 and 4 trim it."""


def press_keys(board: FcBoard, keys_inverted: int) -> None:
    """Take the keys of an `h` frame."""
    keys = board.menu.turn(keys_inverted)
    if board.menu.shown == _TRIM_PAGE and not board.core.running:
        board.trim += bool(keys & MenuKey.KEY_3) - bool(keys & MenuKey.KEY_4)


def display(board: FcBoard) -> WireMessage:
    """Build H."""
    return board.menu.wrap(_text(board, board.menu.shown))


def menu(board: FcBoard, number: int) -> WireMessage:
    """Build L; a number too high gives an empty page and falls back to page 0."""
    pages = board.menu
    if number > pages.last:
        pages.shown = 0
        return Menu(page=0, last_page=pages.last, text=compose(number))
    pages.shown = number
    return Menu(page=number, last_page=pages.last, text=_text(board, number))


def _text(board: FcBoard, page: int) -> str:
    sensors, core, live = board.aircraft.sensors, board.core, board.live
    sticks, potis = core.receiver, core.potis
    motors = sensors.motor_setpoints
    pages: dict[int, tuple[str, ...]] = {
        0: (
            "FlightCtrl",
            f"HW 2.2  SW {board.generation.label}",
            f"Set {board.eeprom.active}  Mixer {board.eeprom.mixer[1:13].split(bytes(1))[0].decode('latin-1')}",
            "Motors running" if core.running else "",
        ),
        1: ("Height", f"Height {sensors.baro_height * 20:8.0f}", f"Climb {sensors.vertical_speed:9.1f}"),
        2: (
            "Attitude",
            f"Pitch  {math.degrees(sensors.fc_angle_pitch):8.1f}",
            f"Roll   {-math.degrees(sensors.fc_angle_roll):8.1f}",
            f"Compass{sensors.compass_deg:8.0f}",
        ),
        3: (
            "Receiver",
            f"Thr{sticks.throttle:6.0f} Pit{sticks.pitch:6.0f}",
            f"Rol{sticks.roll:6.0f} Yaw{sticks.yaw:6.0f}",
            f"Level{core.quality:6d}",
        ),
        4: (
            "Settings",
            f"StickP {live['stick_p']:3d} GyroP {live['gyro_p']:3d}",
            f"GyroI {live['gyro_i']:4d} IF {live['integral_factor']:4d}",
        ),
        5: ("Accelerometer", f"Pitch {sensors.acc_x:9.2f}", f"Roll {sensors.acc_y:10.2f}", f"Trim {board.trim:10d}"),
        6: ("Battery", f"{sensors.battery_voltage:6.1f} V", f"{sensors.battery_current:6.1f} A"),
        7: (
            "External control",
            f"Gate {'open' if core.gate_open else 'closed'}",
            f"Held {'valid' if board.external.is_valid else 'none'}",
            f"Poti1 {potis[0]:4d}",
        ),
        8: ("Motors", f"{motors[0]:5d}{motors[1]:5d}{motors[2]:5d}{motors[3]:5d}"),
        10: ("Potis", *(f"{potis[i]:5d}{potis[i + 1]:5d}" for i in (0, 2, 4))),
        19: ("Motor controllers", "2.08 2.08 2.08 2.08"),
    }
    return compose(page, *pages.get(page, (f"Page {page}",)))


_COMPASS: Final = 0.099
_COMPASS_SLOW: Final = 0.999
"""Period of the compass feed without and with a NaviCtrl. Source: docs/protocol.md, section 9."""


def start_next_frame(board: FcBoard, now: float) -> None:
    """Start at most one frame; a label asked for while a debug frame starts collides with it."""
    requests = board.requests
    requests.end_expired(now, debug_is_endless=board.is_fork)
    if _start_first(board, now) or _start_compass_feed(board, now):
        return
    started = False
    if requests.debug or requests.debug_stream.is_due(now):
        requests.debug = False
        requests.debug_stream.restart(now)
        board.send(debug(board), now)
        started = True
    if requests.label is not None:
        index, requests.label = requests.label, None
        board.cut(now)
        board.send(name(index), now)
        return
    if not started:
        _start_last(board, now)


def _start_first(board: FcBoard, now: float) -> bool:
    """Version and external control go before everything."""
    requests = board.requests
    if requests.version is not None:
        reply = companion_version if requests.version == 2 else version
        requests.version = None
        board.send(reply(board), now)
        return True
    if requests.control:
        requests.control = False
        board.send(control_state(board), now)
        return True
    return False


def _start_compass_feed(board: FcBoard, now: float) -> bool:
    """Early firmware sends an MK3Mag its attitude, whether there is one or not."""
    if not board.generation.feeds_compass or now < board.requests.compass_at:
        return False
    board.requests.compass_at = now + (_COMPASS_SLOW if board.has_companion else _COMPASS)
    board.send(compass_feed(board), now, Board.MAG)
    return True


def _start_last(board: FcBoard, now: float) -> None:
    """Send what a fast debug stream starves."""
    requests = board.requests
    if board.external.confirm:
        board.send(confirm(board.external.confirm), now)
        board.external.confirm = 0
    elif requests.attitude_stream.is_due(now):
        requests.attitude_stream.restart(now)
        board.send(attitude(board), now)
    elif requests.display or requests.display_stream.is_due(now):
        requests.display = False
        requests.display_stream.restart(now)
        board.send(display(board), now + PRINT)
    elif requests.menu is not None:
        page, requests.menu = requests.menu, None
        board.send(menu(board, page), now + PRINT)
    elif requests.receiver:
        requests.receiver = False
        board.send(receiver(board), now)
