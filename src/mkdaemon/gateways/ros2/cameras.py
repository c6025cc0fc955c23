"""What cameras see, as ROS messages: images, calibrations, AprilTags."""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from mkdaemon.client.pictures import decoded
from mkdaemon.gateways.ros2.messages import ConversionScene, Doubles, header, vector
from mkdaemon.stamp import Stamp
from mkdaemon.telemetry.image import CameraFrame
from mkdaemon.telemetry.vision import CameraSetup, Tags, TagSighting

POLYGON: Final = 3
"""Kind of an ImageMarker: a closed line."""
SHOWN_FOR: Final = 1
"""Lifetime of a marker that is not renewed [s]."""
_IDEAL: Final = ((-1.0, 1.0), (1.0, 1.0), (1.0, -1.0), (-1.0, -1.0))
"""Corners of a tag in the order of apriltag_msgs, from bottom left counter-clockwise, in the plane of the tag."""


def image(value: CameraFrame, scene: ConversionScene) -> Any | None:
    """Image, mono8; None where the camera's coding needs OpenCV and it is not installed, and where it is damaged."""
    pixels = value.pixels if value.coding == "gray8" else decoded(value.pixels)
    if pixels is None or len(pixels) != value.width * value.height:
        return None
    return scene.types.new(
        "sensor_msgs/msg/Image",
        header=_header(scene, value.stamp, value.camera),
        height=value.height,
        width=value.width,
        encoding="mono8",
        is_bigendian=0,
        step=value.width,
        data=scene.types.octets(pixels),
    )


def compressed(value: CameraFrame, scene: ConversionScene) -> Any | None:
    """CompressedImage of a JPEG or PNG as it came; None where the camera sends plain pixels: see `image`."""
    if value.coding == "gray8":
        return None
    return scene.types.new(
        "sensor_msgs/msg/CompressedImage",
        header=_header(scene, value.stamp, value.camera),
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
        header=_header(scene, stamp, setup.camera),
        height=lens.height,
        width=lens.width,
        distortion_model="equidistant" if lens.model == "fisheye" else "plumb_bob",
        d=np.array(lens.distortion, dtype=np.float64),
        k=intrinsics,
        r=np.eye(3).ravel(),
        p=projection,
        binning_x=0,
        binning_y=0,
        roi=types.new("sensor_msgs/msg/RegionOfInterest", x_offset=0, y_offset=0, height=0, width=0, do_rectify=False),
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
            goodness=0.0,
            decision_margin=tag.decision_margin,
            centre=_point(scene, homography(tag)[:2, 2]),
            corners=[_point(scene, corner) for corner in reversed(tag.corners)],
            homography=homography(tag).ravel(),
        )
        for tag in value.tags
    ]
    stamp = _header(scene, value.stamp, value.camera)
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
    stamp = _header(scene, value.stamp, value.camera)
    return [
        types.new(
            "visualization_msgs/msg/ImageMarker",
            header=stamp,
            ns=tag.family,
            id=tag.id,
            type=POLYGON,
            action=0,
            position=vector(types, (0.0, 0.0, 0.0), "Point"),
            scale=2.0,
            outline_color=line,
            filled=0,
            fill_color=line,
            lifetime=types.new("builtin_interfaces/msg/Duration", sec=SHOWN_FOR, nanosec=0),
            points=[vector(types, (*corner, 0.0), "Point") for corner in tag.corners],
            outline_colors=[],
        )
        for tag in value.tags
    ]


def _header(scene: ConversionScene, stamp: Stamp, camera: str) -> Any:
    return header(scene.types, stamp, scene.frames.camera(camera))
