"""The aircraft's values as ROS messages: frames, signs, units, covariances, stamps."""

from __future__ import annotations

import math
from operator import attrgetter

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mkdaemon.frames import quaternion_from_rotation, rotation_from_euler, rotation_from_quaternion
from mkdaemon.gateways.ros2 import conversions
from mkdaemon.gateways.ros2.messages import Frames
from mkdaemon.vision.camera.imagecodec import encode_jpeg
from tests import samples
from tests.gateways.ros2.bagtypes import scene, through_cdr

SECONDS = (1_700_000_100, 500_000_000)
"""Stamp of a sample, and nanoseconds of it."""
SQUARE = ((10.0, 10.0), (30.0, 10.0), (30.0, 30.0), (10.0, 30.0))
"""Top-left, top-right, bottom-right, bottom-left of a tag [px]."""
SURE = {
    "velocity": (0.25, 0.5, -0.125),
    "position_sd": (0.1, 0.2, 0.3),
    "covariance": ((0.01, 0.0, 0.02), (0.04, 0.0, 0.05), (0.09, 0.0, 0.08)),
}
angles = st.floats(-3.1, 3.1)
tilts = st.floats(-0.5, 0.5)


def rotation_of(orientation):
    return rotation_from_quaternion(conversions.attitude_of(orientation))


def fields_of(message, names):
    """Fields of a message by their paths; lists and arrays as lists."""
    found = {name: attrgetter(name)(message) for name in names}
    return {name: list(value) if hasattr(value, "__len__") and not isinstance(value, str) else value
            for name, value in found.items()}  # fmt: skip


POSED = tuple(map(float, range(36)))
RIGHT = [
    (
        conversions.fix, samples.position(), "sensor_msgs/msg/NavSatFix",
        {"header.stamp.sec": SECONDS[0], "header.stamp.nanosec": SECONDS[1], "latitude": 53.2301184,
         "longitude": 7.4590749, "altitude": 12.5, "status.status": 0, "position_covariance_type": 0},
    ),
    (
        conversions.velocity, samples.velocity(), "geometry_msgs/msg/TwistStamped",
        {"header.frame_id": "map", "twist.linear.x": 1.0, "twist.linear.y": 2.0, "twist.linear.z": -0.5},
    ),
    (
        conversions.vision_pose, samples.pose(position_target=(0.5, -0.25, 2.0), covariance=POSED),
        "geometry_msgs/msg/PoseWithCovarianceStamped",
        {"header.frame_id": "target/pad", "pose.covariance": list(POSED), "pose.pose.position.x": 0.5,
         "pose.pose.position.y": -0.25, "pose.pose.position.z": 2.0},
    ),
    (
        conversions.sticks, samples.output(pitch=127, roll=-127, throttle=64), "sensor_msgs/msg/Joy",
        {"axes": pytest.approx([1.0, -1.0, 0.0, 64 / 127]), "buttons": [1]},
    ),
    (
        conversions.pilot, samples.pilot(sticks=(0.0, 127.0, -63.5), throttle=0.0), "sensor_msgs/msg/Joy",
        {"axes": [0.0, 1.0, -0.5, 0.0]},
    ),
    (
        conversions.image, samples.image(), "sensor_msgs/msg/Image",
        {"width": 4, "height": 3, "step": 4, "encoding": "mono8", "data": list(range(12)),
         "header.frame_id": "down_optical_frame"},
    ),
]  # fmt: skip


@pytest.mark.parametrize(("convert", "value", "kind", "wanted"), RIGHT, ids=lambda part: getattr(part, "__name__", ""))
def test_a_value_has_its_frame_its_signs_and_its_units(convert, value, kind, wanted):
    assert fields_of(through_cdr(convert(value, scene()), kind), wanted) == wanted


@pytest.mark.parametrize(
    ("convert", "value"),
    [
        (conversions.pilot, samples.pilot(sticks=None)),
        (conversions.compressed, samples.image()),
        (conversions.info, samples.setup(lens=None)),
        (conversions.info_of_image, samples.image()),
        (conversions.event, samples.attitude()),
        (conversions.edge, samples.edge()),
        (conversions.mount, samples.edge(parent="camera/down", child="pad", static=False)),
        (conversions.no_fix, samples.gps()),
        (conversions.image, samples.image(width=5)),
        (conversions.image, samples.image(coding="jpeg", pixels=b"\xff\xd8\xffnone")),
        (conversions.image, samples.image(coding="png", pixels=b"none")),
    ],
)
def test_what_cannot_be_said_makes_no_message(convert, value):
    assert convert(value, scene()) is None


@given(roll=tilts, pitch=tilts, yaw=angles)
def test_an_imu_turns_as_the_aircraft_enu_from_flu(roll, pitch, yaw):
    made = through_cdr(
        conversions.imu(samples.attitude(roll=roll, pitch=pitch, yaw=yaw), scene()), "sensor_msgs/msg/Imu"
    )
    assert np.allclose(rotation_of(made.orientation), rotation_from_euler(roll, pitch, yaw), atol=1e-9)
    assert made.orientation_covariance[0] == 0.0, "unknown, not certain: sensor_msgs/Imu"
    assert made.angular_velocity_covariance[0] == made.linear_acceleration_covariance[0] == -1.0


@given(roll=tilts, pitch=tilts, yaw=angles, rates=st.tuples(*[st.floats(-3.0, 3.0)] * 3), passed=st.floats(0.02, 0.5))
def test_an_imu_has_the_rates_between_two_attitudes(roll, pitch, yaw, rates, passed):
    first = samples.attitude(roll=roll, pitch=pitch, yaw=yaw, source="nc/osd")
    angle = math.hypot(*rates) * passed
    axis = np.array(rates) / (math.hypot(*rates) or 1.0)
    cross = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    turn = np.eye(3) + math.sin(angle) * cross + (1 - math.cos(angle)) * cross @ cross
    turned = quaternion_from_rotation(rotation_from_euler(roll, pitch, yaw) @ turn)
    second = samples.attitude(samples.AT + passed, quaternion=tuple(turned), source="nc/osd")
    made = through_cdr(conversions.imu(second, scene({"state/attitude": first})), "sensor_msgs/msg/Imu")
    found = (made.angular_velocity.x, made.angular_velocity.y, made.angular_velocity.z)
    assert found == pytest.approx(rates, abs=1e-5)
    assert made.angular_velocity_covariance[0] == pytest.approx((math.radians(1.0) / passed) ** 2 / 6)


def test_a_battery_discharges_with_a_negative_current():
    counted = scene({"health": samples.alive()})
    made = through_cdr(conversions.battery_state(samples.battery(), counted), "sensor_msgs/msg/BatteryState")
    assert (made.voltage, made.current) == (15.5, -12.5)
    assert len(made.cell_voltage) == 4
    assert np.isnan(made.cell_voltage).all()
    assert math.isnan(made.percentage)
    unmeasured = through_cdr(
        conversions.battery_state(samples.battery(current=None), scene()), "sensor_msgs/msg/BatteryState"
    )
    assert math.isnan(unmeasured.current)
    assert len(unmeasured.cell_voltage) == 0


@given(yaw=angles, x=tilts, y=tilts)
def test_odometry_is_of_the_body_in_the_frame_of_the_target(yaw, x, y):
    value = samples.estimate(yaw=yaw, tilt=(x, y), **SURE)
    made = through_cdr(conversions.odometry(value, scene()), "nav_msgs/msg/Odometry")
    assert (made.header.frame_id, made.child_frame_id) == ("target/pad", "base_link")
    rotation = rotation_of(made.pose.pose.orientation)
    # The thrust leans the way it accelerates, and the twist is the velocity seen from the body.
    assert np.allclose(rotation[:2, 2] / rotation[2, 2], [math.tan(x), math.tan(y)], atol=1e-9)
    linear = made.twist.twist.linear
    assert np.allclose(rotation @ [linear.x, linear.y, linear.z], value.velocity, atol=1e-9)
    assert np.allclose(made.pose.covariance.reshape(6, 6)[:3, :3], np.diag([0.01, 0.04, 0.09]))
    turned = rotation @ made.twist.covariance.reshape(6, 6)[:3, :3] @ rotation.T
    assert np.allclose(turned, np.diag([0.02, 0.05, 0.08]))
    turns = np.diag(made.pose.covariance.reshape(6, 6))[3:]
    assert list(turns) == [conversions.UNKNOWN_VARIANCE] * 2 + [0.0004]


def test_an_odometry_is_as_sure_as_its_estimate_and_its_heading_as_the_newest_image():
    def seen(target, variance, late):
        spread = (*([0.0] * 35), variance)
        return samples.pose(samples.AT + late, target=target, covariance=spread)

    latest = {
        "vision/a/pose": seen("pad", 0.01, 0.0),
        "vision/b/pose": seen("pad", 0.0025, 0.1),
        "vision/c/pose": seen("other", 0.5, 0.2),
    }
    made = conversions.odometry(samples.estimate(**SURE), scene(latest))
    assert made.pose.covariance[35] == pytest.approx(0.0029)
    made = conversions.odometry(samples.estimate(**SURE | {"covariance": None}), scene())
    assert np.allclose(np.diag(made.pose.covariance.reshape(6, 6))[:3], [0.01, 0.04, 0.09])


TREE = "tf2_msgs/msg/TFMessage"


def edges_of(message):
    made = through_cdr(message, TREE)
    return {(one.header.frame_id, one.child_frame_id): one.transform for one in made.transforms}


def test_targets_hang_under_their_cameras_and_mounts_are_sent_whole_every_time():
    found = edges_of(conversions.edge(samples.edge(parent="camera/down", child="pad", static=False), scene()))
    moved = found["down_optical_frame", "target/pad"]
    assert (moved.translation.x, moved.translation.z, moved.rotation.x, moved.rotation.w) == (0.1, -0.05, 1.0, 0.0)
    other = samples.edge(child="camera/front")
    found = edges_of(conversions.mount(samples.edge(), scene({"mounts": (other,)})))
    assert set(found) == {
        ("map", "odom"),
        ("base_link", "down_optical_frame"),
        ("base_link", "front_optical_frame"),
    }
    named = scene(frames=Frames("mk1/"))
    assert set(edges_of(conversions.mount(samples.edge(), named))) == {
        ("mk1/map", "mk1/odom"),
        ("mk1/base_link", "mk1/down_optical_frame"),
    }


@pytest.mark.parametrize(
    ("position", "latest"),
    [
        (samples.position(position_enu=None), {"state/attitude": samples.attitude()}),
        (samples.position(), {}),
        (samples.position(), {"state/attitude": samples.attitude(samples.AT - 0.6)}),
    ],
    ids=["home unknown", "no attitude", "an old attitude"],
)
def test_the_body_is_nowhere_where_something_is_missing(position, latest):
    assert conversions.place(position, scene(latest)) is None


def test_a_jpeg_goes_as_it_came_and_decoded_and_every_image_has_its_calibration_with_its_own_stamp():
    grey = np.tile(np.arange(0, 160, 10, dtype=np.uint8), (16, 1))
    coded = samples.image(coding="jpeg", pixels=encode_jpeg(grey, 95, 16)[0], width=16, height=16)
    made = through_cdr(conversions.compressed(coded, scene()), "sensor_msgs/msg/CompressedImage")
    assert (made.format, bytes(made.data)) == ("jpeg", coded.pixels)
    decoded = through_cdr(conversions.image(coded, scene()), "sensor_msgs/msg/Image")
    assert np.abs(decoded.data.reshape(16, 16).astype(int) - grey).max() < 10
    known = scene({"vision/down/setup": samples.setup()})
    shown, told = conversions.image(samples.image(), known), conversions.info_of_image(samples.image(), known)
    assert shown.header.stamp == told.header.stamp


def test_detections_have_corners_from_bottom_left_counter_clockwise_and_markers_outline_every_tag():
    made = through_cdr(
        conversions.detections(samples.tags(samples.AT, SQUARE), scene()), "apriltag_msgs/msg/AprilTagDetectionArray"
    )
    (tag,) = made.detections
    assert (tag.family, tag.id, tag.hamming, tag.decision_margin) == ("tag36h11", 0, 1, 40.0)
    assert [(corner.x, corner.y) for corner in tag.corners] == [(10, 30), (30, 30), (30, 10), (10, 10)]
    assert (tag.centre.x, tag.centre.y) == pytest.approx((20.0, 20.0))
    first, second = conversions.markers(samples.tags(samples.AT, SQUARE, SQUARE), scene())
    made = through_cdr(first, "visualization_msgs/msg/ImageMarker")
    assert (made.ns, made.id, made.type) == ("tag36h11", 0, conversions.POLYGON)
    assert [(point.x, point.y) for point in made.points] == list(SQUARE)
    assert second.id == 1
