"""The aircraft's values as ROS messages: pure functions, one a topic.

Each takes a value and the scene and returns a message, or None where the value has none. Stamps are the measured ones.
"""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np

from mkdaemon.client.pictures import decoded
from mkdaemon.frames import quaternion_from_rotation, rotation_from_euler, rotation_from_quaternion
from mkdaemon.gateways.ros2.messages import (
    ConversionScene,
    Doubles,
    header,
    name_part,
    pose,
    pose_with_covariance,
    quaternion,
    stamped_transform,
    time,
    tree,
    vector,
)
from mkdaemon.reading import line_of
from mkdaemon.stamp import Stamp
from mkdaemon.telemetry.base import Stamped
from mkdaemon.telemetry.control import ControlEstimate, ControlOutput
from mkdaemon.telemetry.image import CameraFrame
from mkdaemon.telemetry.state import Attitude, Battery, Gps, GpsFix, Pilot, Position, Velocity
from mkdaemon.telemetry.tone import Tone
from mkdaemon.telemetry.traffic import RawFrame
from mkdaemon.telemetry.vision import CameraSetup, Tags, TagSighting, Transform, VisionPose

UNKNOWN_VARIANCE: Final = 1e6
"""Variance of what an odometry does not know [rad2, (rad/s)2]: there is no mark for it, and zero would mean certain."""
HEADING_SD: Final = 0.02
"""Least standard deviation of a heading that images give [rad]; `EstimatorTuning.yaw_floor`."""
TOGETHER: Final = 0.5
"""A position and an attitude that make one transform are no farther apart in time [s]."""
INFO: Final = 20
LEVELS: Final = {Tone.WARN: 30, Tone.BAD: 40}
"""Severities of rcl_interfaces/Log."""
FULL_STICK: Final = 127.0
"""Count of a stick at its end; axes of a Joy go from -1 to 1."""
POLYGON: Final = 3
"""Kind of an ImageMarker: a closed line."""
SHOWN_FOR: Final = 1
"""Lifetime of a marker that is not renewed [s]."""
_IDEAL: Final = ((-1.0, 1.0), (1.0, 1.0), (1.0, -1.0), (-1.0, -1.0))
"""Corners of a tag in the order of apriltag_msgs, from bottom left counter-clockwise, in the plane of the tag."""
_NOTHING: Final = (0.0, 0.0, 0.0)
MOST_CELLS: Final = 14
"""Of a battery, as in the configuration; what a stranger puts as their number takes no memory."""


def fix(value: Position, scene: ConversionScene) -> Any:
    """NavSatFix of a valid position; the boards report no covariance."""
    return _fix(value, scene, 0, (value.latitude_deg, value.longitude_deg, value.altitude))


def no_fix(value: Gps, scene: ConversionScene) -> Any | None:
    """NavSatFix that says that there is no position; None while there is one."""
    return None if value.fix is GpsFix.VALID else _fix(value, scene, -1, (math.nan, math.nan, None))


def _fix(value: Stamped, scene: ConversionScene, status: int, place: tuple[float, float, float | None]) -> Any:
    latitude, longitude, altitude = place
    return scene.types.new(
        "sensor_msgs/msg/NavSatFix",
        header=header(scene.types, value.stamp, scene.frames.body),
        status=scene.types.new("sensor_msgs/msg/NavSatStatus", status=status, service=1),
        latitude=latitude,
        longitude=longitude,
        altitude=math.nan if altitude is None else float(altitude),
    )


def imu(value: Attitude, scene: ConversionScene) -> Any:
    """Imu with the boards' orientation, ENU from FLU, and how fast it turned since the attitude before.

    The boards send no accelerations.
    """
    types = scene.types
    rates, variance = turn_rates(scene.latest.get("state/attitude"), value)
    missing = np.array([-1.0] + [0.0] * 8)
    return types.new(
        "sensor_msgs/msg/Imu",
        header=header(types, value.stamp, scene.frames.body),
        orientation=quaternion(types, value.quaternion),
        angular_velocity=vector(types, rates or _NOTHING),
        angular_velocity_covariance=missing if rates is None else np.eye(3).ravel() * variance,
        linear_acceleration_covariance=missing,
    )


def turn_rates(before: Attitude | None, now: Attitude) -> tuple[tuple[float, ...] | None, float]:
    """Turn rates from one attitude to the next, which the boards do not send [rad/s; FLU], and the variance of each.

    Returns:
        The rates, None where the attitudes are too far apart or the same; the variance that the boards' rounding, by
        0.1 degrees or by one in an OSD frame, makes of two attitudes [(rad/s)2].
    """
    if before is None or before.stamp.boot != now.stamp.boot:
        return None, 0.0
    passed = now.stamp.monotonic - before.stamp.monotonic
    if not 0.0 < passed <= TOGETHER:
        return None, 0.0
    turn = rotation_from_quaternion(before.quaternion).T @ rotation_from_quaternion(now.quaternion)
    w, *xyz = quaternion_from_rotation(turn)
    size = math.hypot(*xyz)
    angle = 2.0 * math.atan2(size, abs(w))
    scale = math.copysign(angle / size, w) / passed if size else 0.0
    step = math.radians(1.0 if now.source.endswith("osd") else 0.1)
    return tuple(part * scale for part in xyz), step * step / 6.0 / passed**2


def velocity(value: Velocity, scene: ConversionScene) -> Any:
    """TwistStamped by GPS, ENU."""
    types = scene.types
    twist = types.new("geometry_msgs/msg/Twist", linear=vector(types, value.velocity_enu))
    stamp = header(types, value.stamp, scene.frames.map)
    return types.new("geometry_msgs/msg/TwistStamped", header=stamp, twist=twist)


def battery_state(value: Battery, scene: ConversionScene) -> Any:
    """BatteryState: current is negative when discharging; what the boards do not know is NaN."""
    cells = min(max(getattr(scene.latest.get("health"), "battery_cells", None) or 0, 0), MOST_CELLS)
    unknown = ("temperature", "charge", "capacity", "design_capacity", "percentage")
    return scene.types.new(
        "sensor_msgs/msg/BatteryState",
        header=header(scene.types, value.stamp, scene.frames.body),
        voltage=value.voltage,
        current=math.nan if value.current is None else -value.current,
        **dict.fromkeys(unknown, math.nan),
        power_supply_status=2,
        power_supply_technology=3,
        present=True,
        cell_voltage=np.full(cells, np.nan, dtype=np.float32),
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


def heading_variance(value: ControlEstimate, scene: ConversionScene) -> float:
    """Variance of an estimate's heading [rad2]: that of the newest image of its target, and the floor of all images.

    It is an upper bound: the flight core averages the offset between compass and target over several images.
    """
    seen = (
        pose
        for suffix, pose in scene.latest.items()
        if suffix.startswith("vision/") and isinstance(pose, VisionPose) and pose.target == value.target
    )
    newest = max(seen, key=lambda pose: pose.stamp.monotonic, default=None)
    return HEADING_SD**2 + (0.0 if newest is None else newest.covariance[35])


def odometry(value: ControlEstimate, scene: ConversionScene) -> Any:
    """Odometry of the flight core: pose in the frame of the target, twist in the body; relative to the target.

    The boards' tilt has no known error, so the variances of roll and pitch are `UNKNOWN_VARIANCE`.
    """
    types = scene.types
    rotation = target_from_flu(value)
    if value.covariance is None:
        places, speeds = [sd * sd for sd in value.position_sd], [UNKNOWN_VARIANCE] * 3
    else:
        places, speeds = [axis[0] for axis in value.covariance], [axis[2] for axis in value.covariance]
    spread, twist_spread = np.diag([UNKNOWN_VARIANCE] * 6), np.diag([UNKNOWN_VARIANCE] * 6)
    spread[:3, :3] = np.diag(places)
    spread[5, 5] = heading_variance(value, scene)
    twist_spread[:3, :3] = rotation.T @ np.diag(speeds) @ rotation
    return types.new(
        "nav_msgs/msg/Odometry",
        header=header(types, value.stamp, scene.frames.target(value.target)),
        child_frame_id=scene.frames.body,
        pose=pose_with_covariance(
            types, pose(types, value.position, quaternion_from_rotation(rotation)), spread.ravel()
        ),
        twist=types.new(
            "geometry_msgs/msg/TwistWithCovariance",
            twist=types.new("geometry_msgs/msg/Twist", linear=vector(types, rotation.T @ np.asarray(value.velocity))),
            covariance=twist_spread.ravel(),
        ),
    )


def vision_pose(value: VisionPose, scene: ConversionScene) -> Any:
    """PoseWithCovarianceStamped of the vehicle in the frame of a target; rows and axes are ROS's already."""
    types = scene.types
    at = header(types, value.stamp, scene.frames.target(value.target))
    place = pose(types, value.position_target, value.quaternion_target_from_flu)
    spread = pose_with_covariance(types, place, value.covariance)
    return types.new("geometry_msgs/msg/PoseWithCovarianceStamped", header=at, pose=spread)


def edge(value: Transform, scene: ConversionScene) -> Any | None:
    """TFMessage of an edge that moves: a target before a camera."""
    return None if value.static else tree(scene.types, _edge(value, scene))


def mount(value: Transform, scene: ConversionScene) -> Any | None:
    """TFMessage of everything that never moves: this mount, every other one known, and odom in map."""
    if not value.static:
        return None
    mounts = {known.child: known for known in scene.latest.get("mounts", ())} | {value.child: value}
    return tree(scene.types, _fixed(value.stamp, scene), *(_edge(known, scene) for known in mounts.values()))


def origin(value: Position, scene: ConversionScene) -> Any | None:
    """TFMessage of odom in map at the first position, for a vehicle without mounts; `mount` sends it with them."""
    if scene.latest.get("mounts") or "state/position" in scene.latest:
        return None
    return tree(scene.types, _fixed(value.stamp, scene))


def _fixed(stamp: Stamp, scene: ConversionScene) -> Any:
    frames = scene.frames
    return stamped_transform(scene, stamp, frames.map, frames.odom, (0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0))


def place(value: Position, scene: ConversionScene) -> Any | None:
    """TFMessage of the body in odom; None until home is known, and without an attitude of about the same moment."""
    attitude = scene.latest.get("state/attitude")
    if value.position_enu is None or not isinstance(attitude, Attitude):
        return None
    if abs(attitude.stamp.monotonic - value.stamp.monotonic) > TOGETHER:
        return None
    frames = scene.frames
    return tree(
        scene.types,
        stamped_transform(scene, value.stamp, frames.odom, frames.body, value.position_enu, attitude.quaternion),
    )


def _edge(value: Transform, scene: ConversionScene) -> Any:
    parent, child = scene.frames.of_edge(value.parent), scene.frames.of_edge(value.child)
    return stamped_transform(scene, value.stamp, parent, child, value.translation, value.quaternion)


def sticks(value: ControlOutput, scene: ConversionScene) -> Any:
    """Joy of what is sent: pitch, roll, yaw, throttle as shares of the way, FLU; button 0: limited."""
    counts = (value.pitch, value.roll, value.yaw, value.throttle)
    return _joy(value, scene, counts, button=value.limited)


def pilot(value: Pilot, scene: ConversionScene) -> Any | None:
    """Joy of the pilot's sticks, the same order; button 0: his receiver has a signal. None where no board reports."""
    if value.sticks is None or value.throttle is None:
        return None
    return _joy(value, scene, (*value.sticks, value.throttle), button=value.has_signal)


def _joy(value: ControlOutput | Pilot, scene: ConversionScene, counts: tuple[float, ...], *, button: bool) -> Any:
    return scene.types.new(
        "sensor_msgs/msg/Joy",
        header=header(scene.types, value.stamp, scene.frames.body),
        axes=np.array(counts, dtype=np.float32) / np.float32(FULL_STICK),
        buttons=np.array([int(button)], dtype=np.int32),
    )


def raw_frame(value: RawFrame, scene: ConversionScene) -> Any:
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
        types.new("std_msgs/msg/MultiArrayDimension", label=label, size=size) for label, size in numbers.items()
    ]
    layout = types.new("std_msgs/msg/MultiArrayLayout", dim=dimensions)
    return types.new("std_msgs/msg/UInt8MultiArray", layout=layout, data=types.octets(value.raw))


def event(value: Stamped, scene: ConversionScene) -> Any:
    """Log of what happened, in words, and what to do about it."""
    line = line_of(value)
    if line is None:
        return None
    return scene.types.new(
        "rcl_interfaces/msg/Log",
        stamp=time(scene.types, value.stamp),
        level=LEVELS.get(line.tone, INFO),
        name=name_part(scene.vehicle),
        msg=f"{line.text} {line.fix}".strip(),
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


# -- what cameras see: images, calibrations, AprilTags ----------------------------------------------------------------


def image(value: CameraFrame, scene: ConversionScene) -> Any | None:
    """Image, mono8; None where the camera's coding needs OpenCV and it is not installed, and where it is damaged."""
    pixels = value.pixels if value.coding == "gray8" else decoded(value.pixels)
    if pixels is None or len(pixels) != value.width * value.height:
        return None
    return scene.types.new(
        "sensor_msgs/msg/Image",
        header=_camera_header(scene, value.stamp, value.camera),
        height=value.height,
        width=value.width,
        encoding="mono8",
        step=value.width,
        data=scene.types.octets(pixels),
    )


def compressed(value: CameraFrame, scene: ConversionScene) -> Any | None:
    """CompressedImage of a JPEG or PNG as it came; None where the camera sends plain pixels: see `image`."""
    if value.coding == "gray8":
        return None
    return scene.types.new(
        "sensor_msgs/msg/CompressedImage",
        header=_camera_header(scene, value.stamp, value.camera),
        format=value.coding,
        data=scene.types.octets(value.pixels),
    )


def info(value: CameraSetup, scene: ConversionScene) -> Any | None:
    """CameraInfo of a calibrated camera, by its file; None where it is not calibrated."""
    return _info(value, value.stamp, scene)


def info_of_image(value: CameraFrame, scene: ConversionScene) -> Any | None:
    """The same with the stamp of an image, as what works on images wants it; None before the setup is known."""
    setup = scene.latest.get(f"vision/{value.camera}/setup")
    return _info(setup, value.stamp, scene) if isinstance(setup, CameraSetup) else None


def _info(setup: CameraSetup, stamp: Stamp, scene: ConversionScene) -> Any | None:
    lens = setup.lens
    if lens is None:
        return None
    types = scene.types
    intrinsics = np.array([lens.fx, 0.0, lens.cx, 0.0, lens.fy, lens.cy, 0.0, 0.0, 1.0])
    projection = np.array([lens.fx, 0.0, lens.cx, 0.0, 0.0, lens.fy, lens.cy, 0.0, 0.0, 0.0, 1.0, 0.0])
    return types.new(
        "sensor_msgs/msg/CameraInfo",
        header=_camera_header(scene, stamp, setup.camera),
        height=lens.height,
        width=lens.width,
        distortion_model="equidistant" if lens.model == "fisheye" else "plumb_bob",
        d=np.array(lens.distortion, dtype=np.float64),
        k=intrinsics,
        r=np.eye(3).ravel(),
        p=projection,
    )


def detections(value: Tags, scene: ConversionScene) -> Any:
    """AprilTagDetectionArray as apriltag_ros publishes it: corners from bottom left counter-clockwise."""
    types = scene.types
    found = [
        types.new(
            "apriltag_msgs/msg/AprilTagDetection",
            family=tag.family,
            id=tag.id,
            hamming=tag.hamming,
            decision_margin=tag.decision_margin,
            centre=_point(scene, homography(tag)[:2, 2]),
            corners=[_point(scene, corner) for corner in reversed(tag.corners)],
            homography=homography(tag).ravel(),
        )
        for tag in value.tags
    ]
    stamp = _camera_header(scene, value.stamp, value.camera)
    return types.new("apriltag_msgs/msg/AprilTagDetectionArray", header=stamp, detections=found)


def _point(scene: ConversionScene, xy: Any) -> Any:
    return scene.types.new("apriltag_msgs/msg/Point", x=float(xy[0]), y=float(xy[1]))


def homography(tag: TagSighting) -> Doubles:
    """`(3, 3)` image from the plane of the tag, whose corners are at -1 and 1; the last number is 1.

    Source: Hartley and Zisserman, Multiple View Geometry, 4.1: two equations a corner, with h33 = 1.
    """
    rows, wanted = [], []
    for (x, y), (u, v) in zip(_IDEAL, reversed(tag.corners), strict=True):
        rows += [[x, y, 1.0, 0.0, 0.0, 0.0, -u * x, -u * y], [0.0, 0.0, 0.0, x, y, 1.0, -v * x, -v * y]]
        wanted += [u, v]
    solved, *_ = np.linalg.lstsq(np.array(rows), np.array(wanted), rcond=None)
    return np.append(solved, 1.0).reshape(3, 3)


def markers(value: Tags, scene: ConversionScene) -> list[Any]:
    """An ImageMarker a tag, its outline on the image; for machines without apriltag_msgs, and for viewers."""
    types = scene.types
    line = types.new("std_msgs/msg/ColorRGBA", r=0.0, g=1.0, b=0.0, a=1.0)
    stamp = _camera_header(scene, value.stamp, value.camera)
    return [
        types.new(
            "visualization_msgs/msg/ImageMarker",
            header=stamp,
            ns=tag.family,
            id=tag.id,
            type=POLYGON,
            scale=2.0,
            outline_color=line,
            lifetime=types.new("builtin_interfaces/msg/Duration", sec=SHOWN_FOR),
            points=[vector(types, (*corner, 0.0), "Point") for corner in tag.corners],
        )
        for tag in value.tags
    ]


def _camera_header(scene: ConversionScene, stamp: Stamp, camera: str) -> Any:
    return header(scene.types, stamp, scene.frames.camera(camera))
