"""The memory of one target: where it was, and so where it should be now."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt

from mkdaemon.vision.limits import LIMITS
from mkdaemon.vision.pose.linetime import KnownMotion
from mkdaemon.vision.pose.pose import Pose
from mkdaemon.vision.pose.rolling import motion_of
from mkdaemon.vision.track.attitude import Mounting, Turning
from mkdaemon.vision.track.branches import Branches

Array = npt.NDArray[np.float64]

TRACK = LIMITS.track


@dataclass(frozen=True, slots=True, eq=False)
class _Moment:
    time: float
    pose: Pose
    enu_from_flu: Array | None


@dataclass(frozen=True, slots=True, eq=False)
class Prediction:
    """Where a target should be.

    Attributes:
        pose: expected.
        has_attitude: whether the vehicle's attitude went into it.
    """

    pose: Pose
    has_attitude: bool


@dataclass(slots=True)
class Track:
    """State of one target.

    Attributes:
        misses: images since the last accepted pose.
        decoded_at: when one of its tags was last decoded [s].
        tried_at: when decoding was last tried [s].
        in_doubt: the poses remembered may be mirrored; they are good for following, not for deciding.
        branches: the readings of the images so far, while no attitude tells them apart; none before the first.
        image: pixels of the last accepted pose, for finding the target again.
        published: when the target was published last [s], and its range then [m]; also of a track that was lost.
    """

    misses: int = 0
    decoded_at: float = -np.inf
    tried_at: float = -np.inf
    in_doubt: bool = False
    branches: Branches | None = None
    image: npt.NDArray[np.uint8] | None = None
    published: tuple[float, float] | None = None
    _moments: list[_Moment] = field(default_factory=list)

    @property
    def is_live(self) -> bool:
        """Whether there is a pose to predict from."""
        return bool(self._moments)

    @property
    def has_velocity(self) -> bool:
        """Whether two recent poses exist."""
        return len(self._moments) > 1

    @property
    def last(self) -> Pose:
        """The newest accepted pose; the track must be live."""
        return self._moments[-1].pose

    @property
    def last_time(self) -> float:
        """When it was measured [s]."""
        return self._moments[-1].time

    def accept(self, time: float, pose: Pose, enu_from_flu: Array | None, image: npt.NDArray[np.uint8]) -> None:
        """Remember a pose and the image it came from, in place of another one of that image."""
        self.image = image
        if self._moments and self._moments[-1].time == time:
            self._moments.pop()
        gap = time - self._moments[-1].time if self._moments else 0.0
        if self._moments and not 0 < gap < TRACK.grace:
            self._moments.clear()
        self._moments = [*self._moments[-1:], _Moment(time, pose, enu_from_flu)]
        self.misses = 0

    def lose(self) -> None:
        """Forget everything: a wrong lock must not predict itself."""
        self._moments.clear()
        self.image = None
        self.in_doubt = False
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

    def predict(
        self,
        time: float,
        enu_from_flu: Array | None,
        mounting: Mounting | None,
        turning_flu: Turning | None = None,
    ) -> Prediction:
        """Expected pose at a time.

        Motion is taken in the camera frame, where the position is known to a fraction of a pixel; in the target frame
        every error of tilt would swing it by the range. With the vehicle's attitude the turn of the camera is taken
        out first and put back for the new image; without, image motion and turn simply go on.
        """
        now = self._moments[-1]
        before = self._moments[-2] if self.has_velocity else None
        turned = _camera_turn(enu_from_flu, now.enu_from_flu, mounting)
        position, rotation = now.pose.position, now.pose.rotation
        speed: Array | None = None
        speed_sd = 0.0
        if before is not None:
            ahead = (time - now.time) / (now.time - before.time)
            earlier = _camera_turn(now.enu_from_flu, before.enu_from_flu, mounting)
            if turned is not None and earlier is not None:
                step = position - earlier @ before.pose.position
            else:
                step = position - before.pose.position
                rotation = now.pose.rotation @ before.pose.rotation.T @ now.pose.rotation
            position = position + ahead * step
            speed = step / (now.time - before.time)
            if turned is None or earlier is None:
                # Whatever the camera turned is in the step, and does not change the range: where it leads, too.
                sight = position / float(np.linalg.norm(position))
                nearing = (now.pose.range_m - before.pose.range_m) / (now.time - before.time)
                speed = speed + (nearing - float(speed @ sight)) * sight
            variance = float(now.pose.covariance[2, 2] + before.pose.covariance[2, 2])
            speed_sd = float(np.sqrt(variance)) / (now.time - before.time)
        known = known_motion(position, speed, turning_flu, mounting, speed_sd)
        if turned is None:
            return Prediction(replace(now.pose, rotation=rotation, position=position, known_motion=known), False)
        turned_on = turned @ now.pose.rotation
        return Prediction(replace(now.pose, rotation=turned_on, position=turned @ position, known_motion=known), True)

    def motion_with(
        self,
        time: float,
        pose: Pose,
        enu_from_flu: Array | None,
        mounting: Mounting | None,
        turning_flu: Turning | None = None,
    ) -> KnownMotion | None:
        """What is known about the motion in an image from where its own fit puts the target.

        None where the track has a velocity, or the image before is too old to tell one.

        Args:
            time: of the image [s].
            pose: fitted in it.
            enu_from_flu: the vehicle's attitude then.
            mounting: of the camera.
            turning_flu: how the vehicle turns then.
        """
        if self.has_velocity or not 0.0 < time - self.last_time < TRACK.grace:
            return None
        later = replace(self, _moments=[*self._moments, _Moment(time, pose, enu_from_flu)])
        return later.predict(time, enu_from_flu, mounting, turning_flu).pose.known_motion


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
    along = limits.speed_sd if speed is None else float(np.hypot(limits.known_climbing_sd, speed_sd))
    expected = motion_of(place, np.zeros(3) if speed is None else speed, turning)
    return KnownMotion(expected, np.array([spread] * 3 + [along]))


def _camera_turn(now: Array | None, then: Array | None, mounting: Mounting | None) -> Array | None:
    """Camera now from camera then `(3, 3)`, from two attitudes; none when one of them is unknown."""
    if now is None or then is None or mounting is None:
        return None
    camera = mounting.flu_from_cam
    turn: Array = camera.T @ now.T @ then @ camera
    return turn
