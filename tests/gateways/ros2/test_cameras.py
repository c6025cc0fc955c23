"""What cameras see as ROS messages."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mkdaemon.gateways.ros2 import cameras
from mkdaemon.vision.camera.imagecodec import encode_jpeg
from tests.gateways.ros2 import samples
from tests.gateways.ros2.bagtypes import scene, through_cdr

SQUARE = ((10.0, 10.0), (30.0, 10.0), (30.0, 30.0), (10.0, 30.0))
"""Top-left, top-right, bottom-right, bottom-left [px]."""


def test_a_plain_image_keeps_its_pixels():
    made = through_cdr(cameras.image(samples.frame(), scene()), "sensor_msgs/msg/Image")
    assert (made.width, made.height, made.step, made.encoding) == (4, 3, 4, "mono8")
    assert bytes(made.data) == bytes(range(12))
    assert made.header.frame_id == "down_optical_frame"
    assert cameras.compressed(samples.frame(), scene()) is None


def test_a_jpeg_goes_as_it_came_and_decoded():
    grey = np.tile(np.arange(0, 160, 10, dtype=np.uint8), (16, 1))
    coded = samples.frame("jpeg", encode_jpeg(grey, 95, 16)[0], 16, 16)
    made = through_cdr(cameras.compressed(coded, scene()), "sensor_msgs/msg/CompressedImage")
    assert (made.format, bytes(made.data)) == ("jpeg", coded.pixels)
    decoded = through_cdr(cameras.image(coded, scene()), "sensor_msgs/msg/Image")
    assert np.abs(decoded.data.reshape(16, 16).astype(int) - grey).max() < 10


@pytest.mark.parametrize(
    "broken", [samples.frame(width=5), samples.frame("jpeg", b"\xff\xd8\xffnone"), samples.frame("png", b"none")]
)
def test_a_damaged_image_is_no_image(broken):
    assert cameras.image(broken, scene()) is None


@pytest.mark.parametrize(("model", "word"), [("pinhole", "plumb_bob"), ("fisheye", "equidistant")])
def test_a_calibration_is_told_as_its_file_has_it(model, word):
    made = through_cdr(cameras.info(samples.setup(model), scene()), "sensor_msgs/msg/CameraInfo")
    assert made.distortion_model == word
    assert list(made.k) == [425.0, 0.0, 319.5, 0.0, 424.0, 239.5, 0.0, 0.0, 1.0]
    assert list(made.p[:4]) == [425.0, 0.0, 319.5, 0.0]
    assert list(made.d) == [-0.12, 0.02, 0.0, 0.0, 0.0]
    assert cameras.info(samples.setup(is_calibrated=False), scene()) is None


def test_every_image_has_its_calibration_with_its_own_stamp():
    known = scene({"vision/down/setup": samples.setup()})
    shown, told = cameras.image(samples.frame(), known), cameras.info_of_image(samples.frame(), known)
    assert shown.header.stamp == told.header.stamp
    assert cameras.info_of_image(samples.frame(), scene()) is None


def test_detections_have_corners_from_bottom_left_counter_clockwise():
    made = through_cdr(cameras.detections(samples.tags(SQUARE), scene()), "apriltag_msgs/msg/AprilTagDetectionArray")
    (tag,) = made.detections
    assert (tag.family, tag.id, tag.hamming, tag.decision_margin) == ("tag36h11", 0, 1, 40.0)
    assert [(corner.x, corner.y) for corner in tag.corners] == [(10, 30), (30, 30), (30, 10), (10, 10)]
    assert (tag.centre.x, tag.centre.y) == pytest.approx((20.0, 20.0))


@given(st.lists(st.tuples(st.floats(-4, 4), st.floats(-4, 4)), min_size=4, max_size=4))
def test_the_homography_carries_the_ideal_corners_to_those_seen(shifts):
    corners = tuple((x + dx, y + dy) for (x, y), (dx, dy) in zip(SQUARE, shifts, strict=True))
    (tag,) = samples.tags(corners).tags
    matrix = cameras.homography(tag)
    for (x, y), seen in zip(((-1, 1), (1, 1), (1, -1), (-1, -1)), reversed(corners), strict=True):
        u, v, w = matrix @ [x, y, 1.0]
        assert (u / w, v / w) == pytest.approx(seen, abs=1e-6)


def test_markers_outline_every_tag():
    first, second = cameras.markers(samples.tags(SQUARE, SQUARE), scene())
    made = through_cdr(first, "visualization_msgs/msg/ImageMarker")
    assert (made.ns, made.id, made.type) == ("tag36h11", 0, cameras.POLYGON)
    assert [(point.x, point.y) for point in made.points] == list(SQUARE)
    assert second.id == 1
