"""The memory of one target: where it was, and so where it should be now."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from math import hypot
from typing import Final

import numpy as np

from mkdaemon.vision.arrays import Array
from mkdaemon.vision.limits import LIMITS
from mkdaemon.vision.pose.pose import Pose
from mkdaemon.vision.pose.rolling import KnownMotion, motion_of
from mkdaemon.vision.track.attitude import Mounting, Sight, Turning
from mkdaemon.vision.track.branches import Branches

SINCE: Final = 0.1
"""What a speed changes by from the images that told it to this one, 3 m/s^2 for 1/30 s, deviation [m/s]: without it the
rows of a rolling shutter told tilts too surely (NEES 2.2 for 1.1, 253 images to 4 m)."""


@dataclass(slots=True)
class Track:
    """State of one target.

    Attributes:
        coast: longest time without a pose [s].
        misses: images since the last accepted pose.
        decoded_at: when one of its tags was last decoded [s].
        branches: the readings of the images so far; none before the first.
        published: when the target was published last [s], and its range then [m]; also of a track that was lost.
    """

    coast: float
    misses: int = 0
    decoded_at: float = -np.inf
    branches: Branches | None = None
    published: tuple[float, float] | None = None
    _found: list[tuple[Sight, Pose]] = field(default_factory=list)

    @property
    def is_live(self) -> bool:
        """Whether there is a pose to predict from."""
        return bool(self._found)

    @property
    def has_velocity(self) -> bool:
        """Whether two recent poses exist."""
        return len(self._found) > 1

    @property
    def last(self) -> Pose:
        """The newest accepted pose; the track must be live."""
        return self._found[-1][1]

    @property
    def last_seen(self) -> Sight:
        """The image it was measured in."""
        return self._found[-1][0]

    def accept(self, seen: Sight, pose: Pose) -> None:
        """Remember a pose and the image it came from, in place of another one of that image."""
        if self._found and self.last_seen.time == seen.time:
            self._found.pop()
        self._found = [*(self._found[-1:] if self.goes_on(seen.time) else []), (seen, pose)]
        self.misses = 0

    def goes_on(self, time: float) -> bool:
        """Whether an image at a time [s] is one of this track: after the last pose, and not too late."""
        return self.is_live and 0.0 < time - self.last_seen.time <= self.coast

    def lose(self) -> None:
        """Forget all but where it was published: a wrong lock must not predict itself."""
        self._found.clear()
        self.branches = None
        self.misses = 0
        self.decoded_at = -np.inf

    def can_be_at(self, time: float, pose: Pose) -> bool:
        """Whether the target can have moved to a pose since it was published last, by its range.

        A camera turns faster than it moves, and a mirror image has the same range.
        """
        if self.published is None:
            return True
        then, range_m = self.published
        certain = LIMITS.certainty
        moved = certain.deviations * LIMITS.edges.speed_sd * (time - then)
        return abs(pose.range_m - range_m) <= abs(moved) + max(certain.wrong_m, certain.wrong_share * pose.range_m)

    def knows_turn(self, seen: Sight, mounting: Mounting | None) -> bool:
        """Whether attitudes tell how the camera turned from the last pose to an image."""
        return _camera_turn(seen, self.last_seen, mounting) is not None

    def predict(self, seen: Sight, mounting: Mounting | None) -> Pose:
        """Expected pose in an image.

        Motion is taken in the camera frame, where the position is known to a fraction of a pixel; in the target frame
        every error of tilt would swing it by the range. With the vehicle's attitude the turn of the camera is taken
        out first and put back for the new image; without, image motion and turn simply go on.
        """
        last_seen, last = self._found[-1]
        turned = _camera_turn(seen, last_seen, mounting)
        position, rotation = last.position, last.rotation
        speed: Array | None = None
        speed_sd = 0.0
        if self.has_velocity:
            before_seen, before = self._found[-2]
            passed = last_seen.time - before_seen.time
            earlier = _camera_turn(last_seen, before_seen, mounting)
            came_from = before.position if turned is None or earlier is None else earlier @ before.position
            step = last.position - came_from
            position = last.position + (seen.time - last_seen.time) / passed * step
            speed = step / passed
            if turned is None or earlier is None:
                rotation = last.rotation @ before.rotation.T @ last.rotation
                # Whatever the camera turned is in the step, and does not change the range: where it leads, too.
                sight = position / float(np.linalg.norm(position))
                speed = speed + ((last.range_m - before.range_m) / passed - float(speed @ sight)) * sight
            speed_sd = float(np.sqrt(last.covariance[2, 2] + before.covariance[2, 2])) / passed
        known = known_motion(position, speed, seen.turning_flu, mounting, speed_sd)
        if turned is not None:
            rotation, position = turned @ last.rotation, turned @ position
        return replace(last, rotation=rotation, position=position, known_motion=known)

    def motion_with(self, seen: Sight, pose: Pose, mounting: Mounting | None) -> KnownMotion | None:
        """What is known about the motion in the second image of a track from where its own fit puts the target.

        None where the image before is too old to tell a speed.

        Args:
            seen: the image.
            pose: fitted in it.
            mounting: of the camera.
        """
        if not self.goes_on(seen.time):
            return None
        return replace(self, _found=[*self._found, (seen, pose)]).predict(seen, mounting).known_motion


def known_motion(
    place: Array, speed: Array | None, turning_flu: Turning | None, mounting: Mounting | None, speed_sd: float = 0.0
) -> KnownMotion:
    """What is known about the motion of a camera while an image is read.

    Args:
        place: of the target `(3,)` [m; RDF].
        speed: of the target in camera axes, by the images before `(3,)` [m/s]; none without them.
        turning_flu: how the vehicle turns.
        mounting: of the camera.
        speed_sd: deviation of the speed along the optical axis that the images leave [m/s].
    """
    limits = LIMITS.edges
    turning, spread = np.zeros(3), limits.turning_sd
    if turning_flu is not None and mounting is not None:
        turning, spread = mounting.flu_from_cam.T @ turning_flu.rate, turning_flu.sd
        if speed is None:
            spread += limits.speed_sd / float(np.linalg.norm(place))
    along = limits.speed_sd if speed is None else hypot(SINCE, speed_sd)
    expected = motion_of(place, np.zeros(3) if speed is None else speed, turning)
    return KnownMotion(expected, np.array([spread] * 3 + [along]))


def _camera_turn(now: Sight, then: Sight, mounting: Mounting | None) -> Array | None:
    """Camera now from camera then `(3, 3)`, from two attitudes; none when one of them is unknown."""
    if now.enu_from_flu is None or then.enu_from_flu is None or mounting is None:
        return None
    camera = mounting.flu_from_cam
    turn: Array = camera.T @ now.enu_from_flu.T @ then.enu_from_flu @ camera
    return turn
