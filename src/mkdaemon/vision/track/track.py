"""The memory of one target: where it was, and so where it should be now."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field, replace
from math import hypot
from typing import Final

import numpy as np

from mkdaemon.vision.arrays import Array
from mkdaemon.vision.limits import LIMITS
from mkdaemon.vision.pose.linetime import KnownMotion
from mkdaemon.vision.pose.pose import Pose
from mkdaemon.vision.pose.rolling import motion_of
from mkdaemon.vision.track.attitude import Sight, Turning
from mkdaemon.vision.track.branches import Branches

SINCE: Final = 0.1
"""What a speed changes by from the images that told it to this one, 3 m/s^2 for 1/30 s, deviation [m/s]."""


@dataclass(slots=True)
class Track:
    """State of one target.

    Attributes:
        coast: longest time without a pose [s].
        misses: images since the last accepted pose.
        decoded_at: when one of its tags was last decoded [s].
        branches: the readings of the images so far; none before the first.
        published: times [s] and poses of the newest images that were published; also of a track that was lost.
    """

    coast: float
    misses: int = 0
    decoded_at: float = -np.inf
    branches: Branches | None = None
    published: deque[tuple[float, Pose]] = field(default_factory=lambda: deque(maxlen=3))
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
        """Whether the target can have moved to a pose since it was published last, by its range."""
        if not self.published:
            return True
        (then, last), certain = self.published[-1], LIMITS.certainty
        moved = certain.deviations * LIMITS.edges.speed_sd * (time - then)
        return abs(pose.range_m - last.range_m) <= abs(moved) + max(certain.wrong_m, certain.wrong_share * pose.range_m)

    def turn_to(self, seen: Sight) -> Array | None:
        """Camera in an image from camera at the last pose `(3, 3)`, by attitudes; none where one is unknown."""
        return _turn_between(self.last_seen, seen)

    def predict(self, seen: Sight) -> Pose:
        """Expected pose in an image.

        Motion is taken in the camera frame; in the target's every error of tilt would swing the position by the range.
        With attitudes the turn of the camera is taken out first and put back for the new image.
        """
        (last_seen, last), turned = self._found[-1], self.turn_to(seen)
        position, rotation = last.position, last.rotation
        speed: Array | None = None
        speed_sd = 0.0
        if self.has_velocity:
            before_seen, before = self._found[-2]
            passed = last_seen.time - before_seen.time
            earlier = _turn_between(before_seen, last_seen) if turned is not None else None
            step = last.position - (before.position if earlier is None else earlier @ before.position)
            position = last.position + (seen.time - last_seen.time) / passed * step
            speed = step / passed
            if earlier is None:
                rotation = last.rotation @ before.rotation.T @ last.rotation
                # Whatever the camera turned is in the step, and does not change the range: where it leads, too.
                sight = position / float(np.linalg.norm(position))
                speed = speed + ((last.range_m - before.range_m) / passed - float(speed @ sight)) * sight
            speed_sd = float(np.sqrt(last.covariance[2, 2] + before.covariance[2, 2])) / passed
        known = known_motion(position, speed, seen.turning, speed_sd)
        if turned is not None:
            rotation, position = turned @ last.rotation, turned @ position
        return replace(last, rotation=rotation, position=position, known_motion=known)

    def motion_with(self, seen: Sight, pose: Pose) -> KnownMotion | None:
        """What is known about the motion in an image from where its own fit puts the target; none if it is too late."""
        if not self.goes_on(seen.time):
            return None
        return replace(self, _found=[*self._found, (seen, pose)]).predict(seen).known_motion


def known_motion(place: Array, speed: Array | None, turning: Turning | None, speed_sd: float = 0.0) -> KnownMotion:
    """What is known about the motion of a camera while an image is read.

    Args:
        place: of the target `(3,)` [m; RDF].
        speed: of the target in camera axes, by the images before `(3,)` [m/s]; none without them.
        turning: how the camera turns, by the vehicle's attitude.
        speed_sd: deviation of the speed along the optical axis that the images leave [m/s].
    """
    limits = LIMITS.edges
    rate, spread = np.zeros(3), limits.turning_sd
    if turning is not None:
        rate, spread = turning.rate, turning.sd
        if speed is None:
            spread += limits.speed_sd / float(np.linalg.norm(place))
    along = limits.speed_sd if speed is None else hypot(SINCE, speed_sd)
    expected = motion_of(place, np.zeros(3) if speed is None else speed, rate)
    return KnownMotion(expected, np.array([spread] * 3 + [along]))


def _turn_between(then: Sight, now: Sight) -> Array | None:
    """Camera now from camera then `(3, 3)`, from two attitudes; none when one of them is unknown."""
    if now.enu_from_cam is None or then.enu_from_cam is None:
        return None
    turn: Array = now.enu_from_cam.T @ then.enu_from_cam
    return turn
