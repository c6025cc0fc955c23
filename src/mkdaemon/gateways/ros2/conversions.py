"""The aircraft's values as ROS messages: pure functions, one a topic.

Each takes a value and the scene and returns a message, or None where the value has none. Stamps are the measured ones.
"""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np

from mkdaemon.frames import quaternion_from_rotation, rotation_from_euler, rotation_from_quaternion
from mkdaemon.gateways.ros2.messages import (
    Doubles,
    Scene,
    header,
    missing,
    name_part,
    or_nan,
    pose,
    quaternion,
    stamped_transform,
    time,
    vector,
)
from mkdaemon.telemetry.control import ControlEstimate, ControlOutput
from mkdaemon.telemetry.event import FailsafeEvent, LogEvent, ModeEvent
from mkdaemon.telemetry.state import Attitude, Battery, Gps, GpsFix, Pilot, Position, Velocity
from mkdaemon.telemetry.traffic import RawFrame
from mkdaemon.telemetry.vision import Transform, VisionPose

FULL_STICK: Final = 127.0
"""Count of a stick at its end; axes of a Joy go from -1 to 1."""
UNKNOWN_VARIANCE: Final = 1e6
"""Variance of what an odometry does not know [rad2, (rad/s)2]: there is no mark for it, and zero would mean certain."""
TOGETHER: Final = 0.5
"""A position and an attitude that make one transform are no farther apart in time [s]."""
LEVELS: Final = {"info": 20, "warning": 30, "error": 40}
"""Severities of rcl_interfaces/Log."""


def fix(value: Position, scene: Scene) -> Any:
    """NavSatFix of a valid position; its covariance is not told by the boards."""
    return _fix(value, scene, 0, value.latitude_deg, value.longitude_deg, or_nan(value.altitude))


def no_fix(value: Gps, scene: Scene) -> Any | None:
    """NavSatFix that says that there is no position; None while there is one."""
    if value.fix is GpsFix.VALID:
        return None
    return _fix(value, scene, -1, math.nan, math.nan, math.nan)


def _fix(value: Position | Gps, scene: Scene, status: int, latitude: float, longitude: float, altitude: float) -> Any:
    types = scene.types
    return types.new(
        "sensor_msgs/msg/NavSatFix",
        header=header(types, value.stamp, scene.frames.body),
        status=types.new("sensor_msgs/msg/NavSatStatus", status=status, service=1),
        latitude=latitude,
        longitude=longitude,
        altitude=altitude,
        position_covariance=np.zeros(9),
        position_covariance_type=0,
    )


def imu(value: Attitude, scene: Scene) -> Any:
    """Imu with the boards' orientation, ENU from FLU; they send neither rates nor accelerations."""
    types = scene.types
    nothing = vector(types, (0.0, 0.0, 0.0))
    return types.new(
        "sensor_msgs/msg/Imu",
        header=header(types, value.stamp, scene.frames.body),
        orientation=quaternion(types, value.quaternion),
        orientation_covariance=np.zeros(9),
        angular_velocity=nothing,
        angular_velocity_covariance=missing(9),
        linear_acceleration=nothing,
        linear_acceleration_covariance=missing(9),
    )


def velocity(value: Velocity, scene: Scene) -> Any:
    """TwistStamped by GPS, ENU."""
    types = scene.types
    twist = types.new(
        "geometry_msgs/msg/Twist", linear=vector(types, value.velocity_enu), angular=vector(types, (0.0, 0.0, 0.0))
    )
    stamp = header(types, value.stamp, scene.frames.map)
    return types.new("geometry_msgs/msg/TwistStamped", header=stamp, twist=twist)


def battery_state(value: Battery, scene: Scene) -> Any:
    """BatteryState: current is negative when discharging; what the boards do not know is NaN."""
    types = scene.types
    cells = getattr(scene.latest.get("health"), "battery_cells", None) or 0
    return types.new(
        "sensor_msgs/msg/BatteryState",
        header=header(types, value.stamp, scene.frames.body),
        voltage=value.voltage,
        temperature=math.nan,
        current=math.nan if value.current is None else -value.current,
        charge=math.nan,
        capacity=math.nan,
        design_capacity=math.nan,
        percentage=math.nan,
        power_supply_status=2,
        power_supply_health=0,
        power_supply_technology=3,
        present=True,
        cell_voltage=np.full(cells, np.nan, dtype=np.float32),
        cell_temperature=np.zeros(0, dtype=np.float32),
        location="",
        serial_number="",
    )


def target_from_flu(value: ControlEstimate) -> Doubles:
    """Rotation `(3, 3)` of an estimate: heading, then tilted so that the thrust leans as `tilt` says."""
    lean = np.array([math.tan(value.tilt[0]), math.tan(value.tilt[1]), 1.0])
    up = lean / np.linalg.norm(lean)
    # The least rotation that takes z to `up`, by Rodrigues' formula with the axis z x up.
    cross = np.array([[0.0, 0.0, up[0]], [0.0, 0.0, up[1]], [-up[0], -up[1], 0.0]])
    tilted = np.eye(3) + cross + cross @ cross / (1.0 + up[2])
    rotation: Doubles = tilted @ rotation_from_euler(0.0, 0.0, value.yaw)
    return rotation


def odometry(value: ControlEstimate, scene: Scene) -> Any:
    """Odometry of the flight core: pose in the frame of the target, twist in the body; relative to the target."""
    types = scene.types
    rotation = target_from_flu(value)
    if value.covariance is None:
        places, speeds = [sd * sd for sd in value.position_sd], [UNKNOWN_VARIANCE] * 3
    else:
        places, speeds = [axis[0] for axis in value.covariance], [axis[2] for axis in value.covariance]
    spread, twist_spread = np.diag([UNKNOWN_VARIANCE] * 6), np.diag([UNKNOWN_VARIANCE] * 6)
    spread[:3, :3] = np.diag(places)
    twist_spread[:3, :3] = rotation.T @ np.diag(speeds) @ rotation
    return types.new(
        "nav_msgs/msg/Odometry",
        header=header(types, value.stamp, scene.frames.target(value.target)),
        child_frame_id=scene.frames.body,
        pose=types.new(
            "geometry_msgs/msg/PoseWithCovariance",
            pose=pose(types, value.position, quaternion_from_rotation(rotation)),
            covariance=spread.ravel(),
        ),
        twist=types.new(
            "geometry_msgs/msg/TwistWithCovariance",
            twist=types.new(
                "geometry_msgs/msg/Twist",
                linear=vector(types, rotation.T @ np.asarray(value.velocity)),
                angular=vector(types, (0.0, 0.0, 0.0)),
            ),
            covariance=twist_spread.ravel(),
        ),
    )


def vision_pose(value: VisionPose, scene: Scene) -> Any:
    """PoseWithCovarianceStamped of the vehicle in the frame of a target; rows and axes are ROS's already."""
    types = scene.types
    spread = types.new(
        "geometry_msgs/msg/PoseWithCovariance",
        pose=pose(types, value.position_target, value.quaternion_target_from_flu),
        covariance=np.array(value.covariance, dtype=np.float64),
    )
    stamp = header(types, value.stamp, scene.frames.target(value.target))
    return types.new("geometry_msgs/msg/PoseWithCovarianceStamped", header=stamp, pose=spread)


def edge(value: Transform, scene: Scene) -> Any | None:
    """TFMessage of an edge that moves: a target before a camera."""
    return None if value.static else _tree(scene, _edge(value, scene))


def mount(value: Transform, scene: Scene) -> Any | None:
    """TFMessage of everything that never moves: this mount, every other one known, and odom in map."""
    if not value.static:
        return None
    mounts = {known.child: known for known in scene.latest.get("mounts", ())} | {value.child: value}
    frames = scene.frames
    fixed = stamped_transform(scene, value.stamp, frames.map, frames.odom, (0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0))
    return _tree(scene, fixed, *(_edge(known, scene) for known in mounts.values()))


def place(value: Position, scene: Scene) -> Any | None:
    """TFMessage of the body in odom; None until home is known, and without an attitude of about the same moment."""
    attitude = scene.latest.get("state/attitude")
    if value.position_enu is None or not isinstance(attitude, Attitude):
        return None
    if abs(attitude.stamp.monotonic - value.stamp.monotonic) > TOGETHER:
        return None
    frames = scene.frames
    return _tree(
        scene,
        stamped_transform(scene, value.stamp, frames.odom, frames.body, value.position_enu, attitude.quaternion),
    )


def _edge(value: Transform, scene: Scene) -> Any:
    parent, child = scene.frames.of_edge(value.parent), scene.frames.of_edge(value.child)
    return stamped_transform(scene, value.stamp, parent, child, value.translation, value.quaternion)


def _tree(scene: Scene, *edges: Any) -> Any:
    return scene.types.new("tf2_msgs/msg/TFMessage", transforms=list(edges))


def sticks(value: ControlOutput, scene: Scene) -> Any:
    """Joy of what is sent: pitch, roll, yaw, throttle as shares of the way, FLU; button 0: limited."""
    counts = (value.pitch, value.roll, value.yaw, value.throttle)
    return _joy(value, scene, counts, [int(value.limited)])


def pilot(value: Pilot, scene: Scene) -> Any | None:
    """Joy of the pilot's sticks, the same order; button 0: his receiver has a signal. None where no board reports."""
    if value.sticks is None or value.throttle is None:
        return None
    return _joy(value, scene, (*value.sticks, value.throttle), [int(value.has_signal)])


def _joy(value: ControlOutput | Pilot, scene: Scene, counts: tuple[float, ...], buttons: list[int]) -> Any:
    return scene.types.new(
        "sensor_msgs/msg/Joy",
        header=header(scene.types, value.stamp, scene.frames.body),
        axes=np.array(counts, dtype=np.float32) / np.float32(FULL_STICK),
        buttons=np.array(buttons, dtype=np.int32),
    )


def raw_frame(value: RawFrame, scene: Scene) -> Any:
    """UInt8MultiArray of the bytes as they crossed the line; docs/ros.md has the meaning of its dimensions."""
    types = scene.types
    stamp = time(types, value.stamp)
    numbers = {
        "bytes": len(value.raw),
        "stamp.sec": stamp.sec,
        "stamp.nanosec": stamp.nanosec,
        "sequence": value.sequence % (1 << 32),
        f"dropped={value.dropped or ''}": int(value.dropped is not None),
        f"purpose={value.purpose or ''}": int(value.purpose is not None),
    }
    dimensions = [
        types.new("std_msgs/msg/MultiArrayDimension", label=label, size=size, stride=0)
        for label, size in numbers.items()
    ]
    layout = types.new("std_msgs/msg/MultiArrayLayout", dim=dimensions, data_offset=0)
    return types.new("std_msgs/msg/UInt8MultiArray", layout=layout, data=types.octets(value.raw))


def log_event(value: LogEvent, scene: Scene) -> Any:
    """Log of a line that the daemon finds worth knowing."""
    return _log(value, scene, LEVELS.get(value.level, 20), value.text)


def failsafe_event(value: FailsafeEvent, scene: Scene) -> Any:
    """Log of what the daemon did by itself."""
    return _log(value, scene, LEVELS["error"], f"failsafe: {value.action}: {value.reason}")


def mode_event(value: ModeEvent, scene: Scene) -> Any:
    """Log of a change of authority or flight mode."""
    return _log(value, scene, LEVELS["info"], f"{value.before} -> {value.after}: {value.reason}")


def _log(value: LogEvent | FailsafeEvent | ModeEvent, scene: Scene, level: int, words: str) -> Any:
    return scene.types.new(
        "rcl_interfaces/msg/Log",
        stamp=time(scene.types, value.stamp),
        level=level,
        name=name_part(scene.vehicle),
        msg=words,
        file="",
        function="",
        line=0,
    )


def attitude_of(message: Any) -> tuple[float, float, float, float]:
    """The quaternion (w, x, y, z) of a ROS orientation."""
    return (message.w, message.x, message.y, message.z)


def yaw_of(orientation: Any) -> float | None:
    """Heading of a ROS orientation, counter-clockwise from x [rad]; None where it has no length, so says nothing."""
    wxyz = attitude_of(orientation)
    if not sum(part * part for part in wxyz) > 0.0:
        return None
    rotation = rotation_from_quaternion(wxyz)
    return math.atan2(float(rotation[1, 0]), float(rotation[0, 0]))
