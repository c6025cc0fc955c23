"""The way of a camera over a target, carried on by the vehicle's inertia.

Shaking turns a camera by degrees between two images but hardly moves it: seen from the target, the lens follows a
smooth way. A constant-velocity Kalman filter on that way predicts from where the target is seen now, and so its tilt
against the line of sight, to some tenths of a degree; without any attitude of the vehicle.

Source: white-noise acceleration model, Bar-Shalom, Li and Kirubarajan, Estimation with Applications to Tracking, 6.2.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from mkdaemon.vision.limits import LIMITS
from mkdaemon.vision.pose.pose import Pose, inverse
from mkdaemon.vision.pose.rolling import skew
from mkdaemon.vision.track.attitude import updated

Array = npt.NDArray[np.float64]

AGREEMENT = LIMITS.agreement
ACCELERATION_PSD = 1.0
"""Of a vehicle over a target at rest: 1.3 m/s^2 that last for 0.3 s [m^2/s^3]."""
MOVING_PSD = 25.0
"""The same where the target moves by itself, as a deck or another vehicle does [m^2/s^3]."""
LEAST_INLIERS = 1e-3
"""Share of points that agree; a fit with fewer has no place."""
CAUTION = 4.0
"""Factor on the variance of a pose: its errors last for several images where light, blur or cover cause them."""
FLOOR = 0.002
"""Deviation of the lens from what a pose says that is always possible, of the range."""

PLACES, BOTH, SPEEDS = (np.kron(blocks, np.eye(3)) for blocks in ([[1, 0], [0, 0]], [[0, 1], [1, 0]], [[0, 0], [0, 1]]))
"""Which parts of a course's covariance an unknown acceleration makes larger."""


@dataclass(frozen=True, slots=True, eq=False)
class Course:
    """Position and velocity of the lens in the target's frame.

    Attributes:
        time: [s].
        state: position [m] and velocity [m/s] `(6,)`.
        covariance: of `state` `(6, 6)`.
        psd: of the acceleration that is expected [m^2/s^3].
    """

    time: float
    state: Array
    covariance: Array
    psd: float = ACCELERATION_PSD

    @classmethod
    def begin(cls, time: float, pose: Pose, psd: float = ACCELERATION_PSD) -> Course:
        """Start from one pose, at an unknown velocity."""
        centre, spread = _lens_place(pose)
        covariance = np.zeros((6, 6))
        covariance[:3, :3] = spread
        covariance[3:, 3:] = LIMITS.edges.speed_sd**2 * np.eye(3)
        return cls(time, np.concatenate([centre, np.zeros(3)]), covariance, psd)

    @property
    def centre(self) -> Array:
        """Position of the lens `(3,)` [m; target]."""
        return self.state[:3]

    @property
    def angle_sd(self) -> float:
        """Deviation of the direction from which the target is seen [rad]."""
        sight = self.centre / max(float(np.linalg.norm(self.centre)), 1e-9)
        across = np.eye(3) - np.outer(sight, sight)
        spread = float(np.trace(across @ self.covariance[:3, :3] @ across)) / 2
        return float(np.sqrt(spread)) / max(float(np.linalg.norm(self.centre)), 1e-9)

    def predict_at(self, time: float) -> Course:
        """The same course at a later time, before anything is seen.

        With F the motion over dt and Q the white acceleration of density q: P' = F P F^T + Q, the blocks of Q being
        q dt^3 / 3 for the position, q dt^2 / 2 between both, q dt for the velocity.
        """
        dt = time - self.time
        move = np.eye(6)
        move[:3, 3:] = dt * np.eye(3)
        noise = self.psd * (dt**3 / 3 * PLACES + dt**2 / 2 * BOTH + dt * SPEEDS)
        return Course(time, move @ self.state, move @ self.covariance @ move.T + noise, self.psd)

    def mahalanobis2(self, pose: Pose, caution: float | None = None) -> float:
        """Squared Mahalanobis distance of a pose from this course, three degrees of freedom.

        Args:
            pose: measured.
            caution: factor on its variance; what its errors over several images ask for when absent.
        """
        centre, spread = _lens_place(pose, caution)
        error = centre - self.centre
        return float(error @ np.linalg.solve(self.covariance[:3, :3] + spread, error))

    def log_density(self, pose: Pose) -> float:
        """Logarithm of the density of a pose's place by this course [1/m^3], without the constant 3 / 2 ln(2 pi)."""
        centre, spread = _lens_place(pose)
        error, both = centre - self.centre, self.covariance[:3, :3] + spread
        distance2 = float(error @ np.linalg.solve(both, error))
        return -(distance2 + float(np.linalg.slogdet(both)[1])) / 2.0

    def correct(self, pose: Pose) -> Course:
        """The course after a pose: a Kalman update, K = P H^T (H P H^T + R)^-1, H taking the position."""
        centre, spread = _lens_place(pose)
        gain = self.covariance[:, :3] @ np.linalg.inv(self.covariance[:3, :3] + spread)
        covariance = self.covariance - gain @ self.covariance[:3, :]
        state = self.state + gain @ (centre - self.centre)
        return Course(self.time, state, (covariance + covariance.T) / 2, self.psd)

    def fuse(self, pose: Pose) -> Pose:
        """A pose with what this course knew before it about where the lens is.

        The lens is at c = -R^T p in the target's frame; dc = -R^T dp - R^T [p]x w. A Kalman update of (p, w) by what
        the course knows of c; nearby, where the image says far more than inertia, nothing changes.

        A pose that surprises the course makes it as uncertain as the surprise is large: of two that contradict each
        other both together would claim to know more than either.

        Source: the ratio of Birge, Physical Review 40 (1932), 207.
        """
        known = max(1.0, self.mahalanobis2(pose, 1.0) / 3.0) * self.covariance[:3, :3]
        back = pose.rotation.T
        jacobian = np.hstack([-back, -back @ skew(pose.position)])
        return updated(pose, jacobian, self.centre + back @ pose.position, known + 1e-12 * np.eye(3))


def shared_doubt(pose: Pose) -> float:
    """Factor on a pose's variance for what images in a row teach: what lies over some points of it stays there.

    The covariance of one image knows by its residuals what its points share.
    """
    return 1.0 / max(pose.inliers, LEAST_INLIERS) ** AGREEMENT.power


def lasting_doubt(pose: Pose) -> float:
    """The same for a state that only images teach: where points disagree, they do so alike from image to image.

    A leaf's shadow pulls fits of one second by 4 degrees one way, each of which says it knows the tilt to 1 degree.
    """
    lasts = CAUTION if pose.inliers < AGREEMENT.whole else 1.0
    return lasts * shared_doubt(pose)


def _lens_place(pose: Pose, caution: float | None = None) -> tuple[Array, Array]:
    """Where a pose puts the lens [m; target] and how well that may be believed over several images."""
    factor = CAUTION * shared_doubt(pose) if caution is None else caution
    _, centre, spread = inverse(pose, factor * pose.covariance)
    return centre, spread[:3, :3] + (FLOOR * pose.range_m) ** 2 * np.eye(3)
