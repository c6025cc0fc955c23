"""The replies of a FlightCtrl, each built from the project's own messages. No state, no timing."""

from __future__ import annotations

import math
from typing import Final

from mkdaemon.protocol.flags import BoardStatus, FlightFault0, FlightFault1, VersionFlags
from mkdaemon.protocol.messages import (
    AttitudeDataFc210,
    AttitudeDataFcOld,
    CompassFeedOld,
    ControlConfirm,
    DebugDataFc,
    Label,
    NaviVersionClassic,
    Receiver071,
    Receiver200,
    VersionClassic,
    VersionFc200,
    VersionFc210,
)
from mkdaemon.protocol.wire import WireMessage
from mksim.boards.external import FULL
from mksim.boards.fc_board import FcBoard
from mksim.boards.labels import FC_LABELS, label, label_checksum

PROTOCOL_MAJOR: Final = 11
_EARLY_PROTOCOL_MAJOR: Final = 10
_HARDWARE: Final = 22
_BL_FIRMWARE: Final = 208
_GRAVITY: Final = 9.81
_ACC_Z_UNIT: Final = 140.0
"""Raw accelerometer counts a g that this simulation reports."""
_SHOWN: Final = 1.13
"""Data3D over the FlightCtrl's own angle scale. Source: docs/simulator.md, attitude loop."""


def bounded(value: float, bits: int = 16) -> int:
    """Round into a signed integer of so many bits."""
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
    pitch = bounded(math.degrees(sensors.fc_angle_pitch) * 10.0 * _SHOWN)
    roll = bounded(-math.degrees(sensors.fc_angle_roll) * 10.0 * _SHOWN)
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
    analog[7] = bounded(4.0 * core.gas(board.live)) if core.running else 0
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
        analog[16:20] = [bounded(sticks.pitch), bounded(sticks.roll), bounded(sticks.yaw), bounded(sticks.throttle)]
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
