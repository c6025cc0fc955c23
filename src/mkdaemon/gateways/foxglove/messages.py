"""Values of the bus as Foxglove's messages: pure functions, one message of one value."""

from __future__ import annotations

import math
from typing import Final

from foxglove.messages import (
    CameraCalibration,
    Color,
    CompressedImage,
    ImageAnnotations,
    LocationFix,
    Log,
    LogLevel,
    Point2,
    PointsAnnotation,
    PointsAnnotationType,
    PoseInFrame,
    TextAnnotation,
)

from mkdaemon.client.pictures import viewable
from mkdaemon.frames import rotation_from_quaternion
from mkdaemon.gateways.foxglove.names import Names, pose, timestamp
from mkdaemon.reading import line_of
from mkdaemon.telemetry.base import Stamped
from mkdaemon.telemetry.event import FailsafeEvent
from mkdaemon.telemetry.image import CameraFrame
from mkdaemon.telemetry.state import Position
from mkdaemon.telemetry.tone import Tone
from mkdaemon.telemetry.vision import CameraSetup, Tags, VisionPose

GREEN: Final = Color(r=0.2, g=0.9, b=0.3, a=1.0)
CENTRE: Final = 0.5
"""Foxglove counts pixels from the corner of the image, we from the middle of its first pixel [px]."""
_MODELS: Final = {"pinhole": "plumb_bob", "fisheye": "kannala_brandt"}
"""Our words for distortion models and Foxglove's; both have OpenCV's order of the parameters."""
_LEVELS: Final = {Tone.WARN: LogLevel.Warning, Tone.BAD: LogLevel.Error}


def seen_pose(names: Names, value: VisionPose) -> PoseInFrame:
    """The vehicle against a target, as one camera saw it."""
    found = pose(value.position_target, rotation_from_quaternion(value.quaternion_target_from_flu))
    return PoseInFrame(timestamp=timestamp(value.stamp), frame_id=value.target, pose=found)


def location_fix(names: Names, value: Position) -> LocationFix:
    """Where the vehicle is on earth; the altitude is NaN where the receiver's is not known."""
    return _fix(value, names.body, (value.latitude_deg, value.longitude_deg), value.altitude)


def _fix(value: Position, frame: str, place: tuple[float, float], altitude: float | None = None) -> LocationFix:
    latitude, longitude = place
    height, time = math.nan if altitude is None else altitude, timestamp(value.stamp)
    return LocationFix(timestamp=time, frame_id=frame, latitude=latitude, longitude=longitude, altitude=height)


class HomeAnnouncer:
    """Where home is on earth: once, and when it changes."""

    def __init__(self, names: Names) -> None:
        """Have shown nothing yet.

        Args:
            names: of the vehicle.
        """
        self._frame = names.home
        self._shown: tuple[float, float] | None = None

    def __call__(self, suffix: str, value: Stamped) -> bytes | None:
        """The home of a position; None until it is known, and where it is the one that was shown."""
        if not isinstance(value, Position) or value.home_latitude_deg is None or value.home_longitude_deg is None:
            return None
        home = value.home_latitude_deg, value.home_longitude_deg
        if home == self._shown:
            return None
        self._shown = home
        return _fix(value, self._frame, home).encode()


def compressed_image(names: Names, value: CameraFrame) -> CompressedImage:
    """An image as it was published; one that was not compressed becomes a PNG."""
    data, coding = viewable(value)
    return CompressedImage(
        timestamp=timestamp(value.stamp), frame_id=names.camera(value.camera), data=data, format=coding
    )


def camera_calibration(names: Names, value: CameraSetup) -> CameraCalibration | None:
    """How a camera projects; None where it is not calibrated."""
    lens = value.lens
    if lens is None:
        return None
    fx, fy, cx, cy = lens.fx, lens.fy, lens.cx, lens.cy
    return CameraCalibration(
        timestamp=timestamp(value.stamp),
        frame_id=names.camera(value.camera),
        width=lens.width,
        height=lens.height,
        distortion_model=_MODELS.get(lens.model, lens.model),
        D=list(lens.distortion),
        K=[fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0],
        R=[1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
        P=[fx, 0.0, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0],
    )


def tag_annotations(names: Names, value: Tags) -> ImageAnnotations:
    """Outlines and numbers of the tags in an image."""
    time = timestamp(value.stamp)
    corners = [[Point2(x=x + CENTRE, y=y + CENTRE) for x, y in tag.corners] for tag in value.tags]
    return ImageAnnotations(
        timestamp=time,
        points=[
            PointsAnnotation(
                timestamp=time,
                type=PointsAnnotationType.LineLoop,
                points=outline,
                outline_color=GREEN,
                thickness=2.0,
            )
            for outline in corners
        ],
        texts=[
            TextAnnotation(timestamp=time, position=outline[0], text=str(tag.id), font_size=14.0, text_color=GREEN)
            for outline, tag in zip(corners, value.tags, strict=True)
        ],
    )


def log_line(names: Names, value: Stamped) -> Log | None:
    """An event in words, and what to do about a refusal; None for what is no event."""
    line = line_of(value)
    if line is None:
        return None
    level = LogLevel.Fatal if isinstance(value, FailsafeEvent) else _LEVELS.get(line.tone, LogLevel.Info)
    text = f"{line.text} {line.fix}" if line.fix else line.text
    return Log(timestamp=timestamp(value.stamp), level=level, message=text, name=names.vehicle)
