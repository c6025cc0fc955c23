"""Where the aircraft is, from everything that says so; and the tree of frames that follows from it."""

from __future__ import annotations

from typing import Final

from foxglove.messages import FrameTransform, FrameTransforms, PoseInFrame, Quaternion, Vector3

from mkdaemon.client.place import AircraftPlace, place_of_estimate, place_of_gps, place_of_pose
from mkdaemon.frames import quaternion_from_rotation
from mkdaemon.gateways.foxglove.names import Names, pose, quaternion, timestamp, vector
from mkdaemon.telemetry.base import Stamped
from mkdaemon.telemetry.control import ControlEstimate
from mkdaemon.telemetry.state import Attitude, Position
from mkdaemon.telemetry.vision import CameraSetup, VisionPose

PLACE_KEYS: Final = ("control/estimate", "vision/*/pose", "state/attitude", "state/position")
"""Keys that say where the aircraft is."""
OLD: Final = 1.0
"""A camera's pose counts by itself after this silence of the flight core [s]."""
LOST: Final = 5.0
"""GPS counts after this time without a target [s]."""


class Whereabouts:
    """The best source of the moment: the flight core, else a camera, else GPS.

    Attributes:
        attitude: the last one.
        place: the last one; None while none is known.
    """

    def __init__(self) -> None:
        """Know nothing yet."""
        self.attitude: Attitude | None = None
        self.place: AircraftPlace | None = None
        self._position: Position | None = None
        self._estimated = self._seen = float("-inf")

    def take(self, value: Stamped) -> AircraftPlace | None:
        """Take a value; the place, where the value makes a newer one known."""
        at = value.stamp.monotonic
        found: AircraftPlace | None = None
        match value:
            case ControlEstimate():
                found = place_of_estimate(value, self.attitude)
                self._estimated = max(self._estimated, at)
            case VisionPose() if at - self._estimated > OLD:
                found = place_of_pose(value)
            case Attitude():
                self.attitude = value
            case Position():
                self._position = value
        if found is not None:
            self._seen = max(self._seen, at)
        elif isinstance(value, Attitude | Position) and at - self._seen > LOST:
            found = self._by_gps()
        if found is None or (self.place is not None and found.at < self.place.at):
            return None
        self.place = found
        return found

    def _by_gps(self) -> AircraftPlace | None:
        if self._position is None or self.attitude is None:
            return None
        return place_of_gps(self._position, self.attitude)


class FrameTree:
    """The tree of frames: the target or home, `map`, `base_link`, the cameras."""

    def __init__(self, names: Names) -> None:
        """Know nothing yet.

        Args:
            names: of the frames.
        """
        self._names = names
        self._where = Whereabouts()

    def __call__(self, suffix: str, value: Stamped) -> bytes | None:
        """The edges that a value tells; None for none."""
        if isinstance(value, CameraSetup):
            return self._mount(value)
        place, names = self._where.take(value), self._names
        if place is not None:
            turn = quaternion_from_rotation(place.rotation)
            return _tree(
                value,
                (names.root(place.frame), names.map, NOWHERE, UNTURNED),
                (names.map, names.body, vector(place.position), quaternion(turn)),
            )
        if isinstance(value, Attitude) and self._where.place is None:
            return _tree(value, (names.map, names.body, NOWHERE, quaternion(value.quaternion)))
        return None

    def _mount(self, setup: CameraSetup) -> bytes | None:
        """Mounting of a camera; None if it is not configured."""
        place, turn = setup.position_flu, setup.quaternion_flu_from_cam
        if place is None or turn is None:
            return None
        return _tree(setup, (self._names.body, self._names.camera(setup.camera), vector(place), quaternion(turn)))


class Poses:
    """Where the aircraft is, in the frame of the target or of home."""

    def __init__(self, names: Names) -> None:
        """Know nothing yet.

        Args:
            names: of the frames.
        """
        self._names = names
        self._where = Whereabouts()

    def __call__(self, suffix: str, value: Stamped) -> bytes | None:
        """The pose that a value tells; None for none."""
        place = self._where.take(value)
        if place is None:
            return None
        frame, found = self._names.root(place.frame), pose(place.position, place.rotation)
        return PoseInFrame(timestamp=timestamp(value.stamp), frame_id=frame, pose=found).encode()


NOWHERE: Final = Vector3()
UNTURNED: Final = Quaternion(w=1.0)


def _tree(value: Stamped, *edges: tuple[str, str, Vector3, Quaternion]) -> bytes:
    """Edges as parent, child, place and rotation of the child."""
    time = timestamp(value.stamp)
    return FrameTransforms(
        transforms=[
            FrameTransform(
                timestamp=time, parent_frame_id=parent, child_frame_id=child, translation=place, rotation=turn
            )
            for parent, child, place, turn in edges
        ]
    ).encode()
