"""One image on its way through the tracker."""

from __future__ import annotations

from dataclasses import dataclass, field

from mkdaemon.telemetry.vision import PoseRefusal
from mkdaemon.vision.camera.image import CameraImage
from mkdaemon.vision.pose.pose import Pose
from mkdaemon.vision.tags.detection import Detection
from mkdaemon.vision.track.level import Sight
from mkdaemon.vision.track.result import TargetPose


@dataclass(slots=True)
class Frame:
    """One image on its way through the tracker.

    Attributes:
        image: as the camera gave it.
        sight: what is known about it.
        detections: tags decoded in it so far.
        poses: that are published.
        refused: why a target has none.
        contradicting: poses that the attitude alone refused; the image would have published them.
        started: targets whose decoded tags were judged.
    """

    image: CameraImage
    sight: Sight
    detections: list[Detection] = field(default_factory=list)
    poses: list[TargetPose] = field(default_factory=list)
    refused: dict[str, PoseRefusal] = field(default_factory=dict)
    contradicting: dict[str, Pose] = field(default_factory=dict)
    started: set[str] = field(default_factory=set)
    _followed: set[str] = field(default_factory=set)

    def follow(self, name: str, refused: PoseRefusal) -> None:
        """A target was found and is followed, but not published."""
        self.refused[name] = refused
        self._followed.add(name)

    def has(self, name: str) -> bool:
        """Whether a target was found."""
        return name in self._followed or any(found.target == name for found in self.poses)
