"""The memory of one target: where it was, and so where it should be now."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt

from mkdaemon.vision.attitude import Mounting
from mkdaemon.vision.pose import Pose, angle_between

Array = npt.NDArray[np.float64]

MAX_SPEED = 8.0
"""Camera against target [m/s]; a faster step is a wrong pose, not a motion."""
MAX_TURN = np.radians(25.0)
"""Largest turn between two images that is continued [rad]."""
FORGET_VELOCITY = 0.3
"""Poses farther apart than this do not make a velocity [s]."""


@dataclass(frozen=True, slots=True, eq=False)
class _Moment:
    time: float
    pose: Pose
    enu_from_flu: Array | None


@dataclass(slots=True)
class Track:
    """State of one target.

    Attributes:
        misses: images since the last accepted pose.
        decoded_at: when one of its tags was last decoded [s].
        tried_at: when decoding was last tried [s].
        image: pixels of the last accepted pose, for optical flow.
    """

    misses: int = 0
    decoded_at: float = -np.inf
    tried_at: float = -np.inf
    image: npt.NDArray[np.uint8] | None = None
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
        """Remember a pose and the image it came from."""
        self.image = image
        if self.misses > 2 or (self._moments and not 0 < time - self._moments[-1].time < FORGET_VELOCITY):
            self._moments.clear()
        self._moments = [*self._moments[-1:], _Moment(time, pose, enu_from_flu)]
        self.misses = 0

    def lose(self) -> None:
        """Forget everything: a wrong lock must not predict itself."""
        self._moments.clear()
        self.image = None
        self.misses = 0
        self.decoded_at = -np.inf

    def predict(self, time: float, enu_from_flu: Array | None, mounting: Mounting | None) -> tuple[Pose, bool]:
        """Expected pose at a time.

        The vehicle's attitude change turns the camera; the camera's way through the target frame goes on at constant
        velocity. Without attitude the last turn is repeated.

        Returns:
            The pose and whether the attitude was used.
        """
        now = self._moments[-1]
        before = self._moments[-2] if self.has_velocity else None
        ahead = time - now.time
        centre = -now.pose.rotation.T @ now.pose.position
        if before is not None:
            velocity = (centre + before.pose.rotation.T @ before.pose.position) / (now.time - before.time)
            if float(np.linalg.norm(velocity)) < MAX_SPEED:
                centre = centre + velocity * ahead
        rotation = now.pose.rotation
        used = False
        if enu_from_flu is not None and now.enu_from_flu is not None and mounting is not None:
            camera = mounting.flu_from_cam
            rotation = camera.T @ enu_from_flu.T @ now.enu_from_flu @ camera @ rotation
            used = True
        elif before is not None:
            steady = abs(ahead - (now.time - before.time)) < 0.5 * (now.time - before.time)
            if steady and angle_between(now.pose.rotation, before.pose.rotation) < MAX_TURN:
                rotation = now.pose.rotation @ before.pose.rotation.T @ now.pose.rotation
        return replace(now.pose, rotation=rotation, position=-rotation @ centre), used
