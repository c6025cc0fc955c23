"""From a tracker's result to the values on the bus."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from mkdaemon.frames import quaternion_from_rotation
from mkdaemon.stamp import Stamp
from mkdaemon.telemetry.base import Telemetry
from mkdaemon.telemetry.vision import (
    CameraSetup,
    Exposure,
    LensShape,
    Tags,
    TagShape,
    TagSighting,
    TargetShape,
    Transform,
    VisionPose,
)
from mkdaemon.vision.arrays import Array
from mkdaemon.vision.camera.exposure import ExposureControl
from mkdaemon.vision.camera.image import CameraImage
from mkdaemon.vision.camera.intrinsics import Intrinsics
from mkdaemon.vision.pose.pose import calibration_sd
from mkdaemon.vision.pose.projection import Projection
from mkdaemon.vision.pose.rolling import skew
from mkdaemon.vision.tags.cellread import Detection
from mkdaemon.vision.tags.tagmap import Tag, TagMap
from mkdaemon.vision.track.attitude import Mounting
from mkdaemon.vision.track.follower import TargetPose
from mkdaemon.vision.track.tracker import VisionResult


def camera_frame(name: str) -> str:
    """Name of a camera's frame in `tf`."""
    return f"camera/{name}"


def values_of(
    result: VisionResult, image: CameraImage, stamp: Stamp, mounting: Mounting | None, ready_at: float
) -> Iterator[tuple[str, Telemetry]]:
    """Key suffixes and values of one image; no poses of a vehicle on which nobody said how the camera sits.

    `stamp` is of the middle of its exposure; the tracker's result was there at `ready_at` [s; monotonic].
    """
    if result.detections:
        yield f"vision/{image.camera}/tags", Tags(**_seen(image, stamp), tags=tuple(map(_sighting, result.detections)))
    if mounting is None:
        return
    for found in result.poses:
        yield f"vision/{image.camera}/pose", pose_of(found, image, stamp, mounting, ready_at)
        child = found.pose
        yield "tf", transform(camera_frame(image.camera), found.frame, child.rotation, child.position, stamp)


def _sighting(found: Detection) -> TagSighting:
    return TagSighting(
        family=found.family,
        id=found.tag_id,
        hamming=found.hamming,
        decision_margin=found.decision_margin,
        corners=found.corners.tolist(),
        search=found.view,
    )


def pose_of(found: TargetPose, image: CameraImage, stamp: Stamp, mounting: Mounting, ready_at: float) -> VisionPose:
    """A pose both ways round, with the covariance carried from camera to body."""
    target_from_cam, camera_target, covariance = found.camera_in_target()
    target_from_flu = target_from_cam @ mounting.flu_from_cam.T
    arm = -target_from_flu @ mounting.position_flu
    vehicle_target = camera_target + arm
    # A small turn w (target axes) moves the body by w x arm.
    carry = np.eye(6)
    carry[:3, 3:] = -skew(arm)
    return VisionPose(
        **_seen(image, stamp),
        target=found.target,
        position_target=vehicle_target.tolist(),
        quaternion_target_from_flu=quaternion_from_rotation(target_from_flu),
        position_flu=(-target_from_flu.T @ vehicle_target).tolist(),
        quaternion_flu_from_target=quaternion_from_rotation(target_from_flu.T),
        covariance=(carry @ covariance @ carry.T).ravel().tolist(),
        calibration_sd=calibration_sd(found.pose),
        position_cam=found.pose.position.tolist(),
        quaternion_cam_from_target=quaternion_from_rotation(found.pose.rotation),
        source=found.pose.source,
        mode=found.mode,
        points=found.pose.points,
        rms_px=found.pose.rms_px,
        ambiguity=found.ratio if np.isfinite(found.ratio) else None,
        decided_by=found.decided_by,
        decode_age=max(found.decode_age, 0.0),
        delivered=image.received_at - image.captured_at,
        latency=ready_at - image.captured_at,
    )


def transform(
    parent: str, child: str, parent_from_child: Array, position: Array, stamp: Stamp, *, static: bool = False
) -> Transform:
    """One edge of the tree of frames."""
    turn = quaternion_from_rotation(parent_from_child)
    return Transform(
        parent=parent, child=child, stamp=stamp, translation=position.tolist(), quaternion=turn, static=static
    )


def _seen(image: CameraImage, stamp: Stamp) -> dict[str, object]:
    return {"camera": image.camera, "sequence": image.sequence, "stamp": stamp, "stamped_by": image.stamped_by}


def exposure_of(control: ExposureControl) -> Exposure:
    """What a camera is told, and the levels it was told for."""
    levels = dict.fromkeys(("black", "white", "noise")) if control.levels is None else control.levels._asdict()
    return Exposure(exposure_ms=1000.0 * control.setting.exposure, gain=control.setting.gain, **levels)


def outlines_of(result: VisionResult, tagmap: TagMap, projection: Projection | None) -> list[Array]:
    """Corners `(4, 2)` [px] of all tags of an image: decoded ones, and those of posed targets that are in front."""
    found = [detection.corners for detection in result.detections]
    if projection is None:
        return found
    posed = {pose.target: pose.pose for pose in result.poses}
    for pose, target in ((posed[target.name], target) for target in tagmap.targets if target.name in posed):
        for tag in target.tags:
            corners, visible = projection.project(tag.corners @ pose.rotation.T + pose.position)
            if visible.all():
                found.append(corners)
    return found


def setup_of(
    camera: str, intrinsics: Intrinsics | None, mounting: Mounting | None, tagmap: TagMap, stamp: Stamp
) -> CameraSetup:
    """What a camera is and looks for; no lens without a calibration, no place where nobody said how it sits."""
    lens = None
    if intrinsics is not None:
        lens = LensShape(**intrinsics.model_dump(), distortion=intrinsics.distortion.tolist())
    return CameraSetup(
        stamp=stamp,
        camera=camera,
        lens=lens,
        position_flu=None if mounting is None else mounting.position_flu.tolist(),
        quaternion_flu_from_cam=None if mounting is None else quaternion_from_rotation(mounting.flu_from_cam),
        targets=tuple(
            TargetShape(name=target.name, moving=target.moving, tags=tuple(map(_tag_shape, target.tags)))
            for target in tagmap.targets
        ),
    )


def _tag_shape(tag: Tag) -> TagShape:
    rows = tuple("".join("." if cell else "#" for cell in row) for row in tag.bitmap)
    return TagShape(family=tag.family.name, id=tag.tag_id, corners=tag.outline.tolist(), cells=rows)
