"""One image on its way through the tracker, and what it gave: tags, poses, alarms, refusals."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

from mkdaemon.telemetry.vision import Alarm, PoseRefusal
from mkdaemon.vision.arrays import Array
from mkdaemon.vision.pose.ambiguity import Decision
from mkdaemon.vision.pose.pose import Pose, inverse, with_floor
from mkdaemon.vision.tags.cellread import Detection
from mkdaemon.vision.track.attitude import Sight

FoundBy = Literal["predicted", "flow", "roi", "search"]
"""How a pose was found: from a prediction, where the image of the target is found again, in a window, in the whole
image."""


@dataclass(frozen=True, slots=True, eq=False)
class TargetPose:
    """A published pose of one target.

    Attributes:
        target: name of the target.
        frame: its frame in `tf`.
        pose: camera from target, with the covariance of the measurement alone.
        ratio: residual of the mirrored candidate over this one; infinite without a rival.
        decided_by: what settled which candidate is true.
        mode: how it was found.
        decode_age: time since a tag of the target was last decoded [s].
    """

    target: str
    frame: str
    pose: Pose
    ratio: float
    decided_by: Decision
    mode: FoundBy
    decode_age: float

    @property
    def covariance(self) -> Array:
        """Covariance `(6, 6)` of `pose` including the floor calibration leaves."""
        return with_floor(self.pose)

    def camera_in_target(self) -> tuple[Array, Array, Array]:
        """Rotation target from camera, position of the camera [m; target], covariance with floor in target axes."""
        return inverse(self.pose, self.covariance)


@dataclass(slots=True)
class Frame:
    """One image on its way through the tracker.

    Attributes:
        sight: the image, with what is known about its moment.
        detections: tags decoded in it so far.
        poses: that are published.
        refused: why a target has none.
        found: targets that are followed.
        started: targets whose decoded tags were judged.
    """

    sight: Sight
    detections: list[Detection] = field(default_factory=list)
    poses: list[TargetPose] = field(default_factory=list)
    refused: dict[str, PoseRefusal] = field(default_factory=dict)
    found: set[str] = field(default_factory=set)
    started: set[str] = field(default_factory=set)


@dataclass(frozen=True, slots=True, eq=False)
class VisionResult:
    """Everything one image gave.

    Attributes:
        camera: name of the camera.
        sequence: of the image.
        captured_at: middle of its exposure, monotonic [s].
        detections: decoded tags with their pixels; empty in images that were tracked without a search.
        poses: at most one per target.
        alarms: what is wrong with the image.
        refused: targets whose pose was measured and not believed, each with the reason.
    """

    camera: str
    sequence: int
    captured_at: float
    detections: tuple[Detection, ...]
    poses: tuple[TargetPose, ...]
    alarms: tuple[Alarm, ...]
    refused: tuple[tuple[str, PoseRefusal], ...] = ()

    def pose_of(self, target: str) -> TargetPose | None:
        """The pose of a target by name."""
        return next((pose for pose in self.poses if pose.target == target), None)
