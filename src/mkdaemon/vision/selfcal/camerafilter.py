"""Lens, sizes, mounting, deck and scale of the attitude, estimated together from what images and attitude say.

The unknowns: the turn of the mounting about body forward, left, up [rad], the horizontal part of the target's normal,
east and north, the share by which the vehicle reports too much tilt; then those of the images (`ImageEvidence`).
A mounting turns with the vehicle, a deck does not: without yaw only their sum is seen, and the deviations say so. What
is constant in the vehicle's own attitude counts as mounting. A lens that is too long turns poses near the rim of the
image, which the attitude contradicts.

With n the normal that an image shows, in body axes, and E the attitude, the horizontal part of the normal in the world
is y = E n. Were the mounting turned by m, the lens or a size changed by p, the deck d and the scale k, it would be
y = d - E (m x n) - E M (T p x n_cam) + k E e_z, with T the turn of a pose with lens and sizes.
"""

from __future__ import annotations

from typing import Final

import numpy as np
import numpy.typing as npt

from mkdaemon.vision.pose.bend import Bend
from mkdaemon.vision.pose.rolling import skew
from mkdaemon.vision.selfcal.evidence import LENS, ImageEvidence

Array = npt.NDArray[np.float64]

LENS_SD: Final = (0.03, 10.0, 10.0, 0.05)
"""How far a calibration may be off, deviations: 3 % of the focal length, 10 px, 0.05."""
MOUNTING_SD: Final = np.radians(5.0)
DECK_SD: Final = np.radians(2.5)
"""As in `track.deck`."""
TILT_SCALE_SD: Final = 0.08
"""Real gyros: attitudes of 0.89 to 1.13 times the truth."""
MOUNTING_DRIFT: Final = np.radians(0.02)
"""Of the mounting with the attitude's bias, random walk [rad/sqrt(s)]: 0.2 degrees in 100 s."""
DECK_DRIFT: Final = {False: np.radians(0.02), True: np.radians(2.0)}
"""Of the target's normal, by whether it moves [rad/sqrt(s)]."""
ALIKE_TIME: Final = 0.2
"""For so long errors of the attitude are one error [s]: images that follow sooner weigh less."""
SOONEST: Final = 0.01
"""Images that follow sooner count as so far apart [s]."""
LONGEST: Final = 10.0
"""A longer time without an image counts as so much [s]."""
SIZE_SD: Final = 0.03
"""How far a tag's size may be off, logarithm."""
MELT_SD: Final = 0.008
"""By how much a tag of the smallest readable cells may look smaller or larger, logarithm; one error of all images."""
MOUNTING: Final = slice(0, 3)
DECK: Final = slice(3, 5)
TILT_SCALE: Final = 5
LENS_AT: Final = 6
SIZES_AT: Final = LENS_AT + len(LENS)


class CameraFilter:
    """A Kalman filter of what is constant, or nearly so, about one camera and one target.

    Args:
        attitude_sd: how well the vehicle knows its attitude at one moment [rad].
        flu_from_cam: the mounting believed `(3, 3)`; none says nothing about attitude.
        is_level: whether the target lies level at rest.
        is_moving: whether it moves.
        sizes: how many unknown sizes the images speak of, melting apart.
        bend: what is known of that of its print; none where it does not bend.

    Attributes:
        mean: of the unknowns `(n,)`.
        covariance: of them `(n, n)`.
        looks: images taken in.
    """

    def __init__(
        self,
        attitude_sd: float,
        flu_from_cam: Array | None,
        *,
        is_level: bool,
        is_moving: bool,
        sizes: int,
        bend: Bend | None = None,
    ) -> None:
        self._attitude_sd = attitude_sd
        self._flu_from_cam = flu_from_cam if is_level else None
        self._deck_drift = DECK_DRIFT[is_moving]
        rises = np.zeros(0 if bend is None else len(bend.mean))
        sd = np.array(
            [*[MOUNTING_SD] * 3, *[DECK_SD] * 2, TILT_SCALE_SD, *LENS_SD, *[SIZE_SD] * sizes, MELT_SD, *rises]
        )
        self.mean: Array = np.zeros(len(sd))
        self.covariance: Array = np.diag(sd**2)
        if bend is not None:
            self.mean[-len(bend.mean) :] = bend.mean
            self.covariance[-len(bend.mean) :, -len(bend.mean) :] = bend.covariance
        self.looks = 0
        self._time: float | None = None

    @property
    def sd(self) -> Array:
        """Standard deviations `(n,)`."""
        deviations: Array = np.sqrt(np.diag(self.covariance))
        return deviations

    def image_seen(self, time: float, evidence: ImageEvidence, enu_from_flu: Array | None) -> None:
        """Take in one image.

        Args:
            time: middle of its exposure [s].
            evidence: what it says.
            enu_from_flu: the vehicle's attitude then `(3, 3)`; none when unknown.
        """
        spent = self._drift_to(time)
        self.looks += 1
        self._edges_seen(evidence)
        if enu_from_flu is not None and self._flu_from_cam is not None:
            self._normal_seen(evidence, enu_from_flu, self._flu_from_cam, spent)

    def _drift_to(self, time: float) -> float:
        spent = 0.0 if self._time is None else min(max(time - self._time, 0.0), LONGEST)
        self._time = time
        drift = np.zeros(len(self.mean))
        drift[MOUNTING] = MOUNTING_DRIFT
        drift[DECK] = self._deck_drift
        self.covariance = self.covariance + spent * np.diag(drift**2)
        return spent

    def _edges_seen(self, evidence: ImageEvidence) -> None:
        before = np.linalg.inv(self.covariance)
        after, right = before.copy(), before @ self.mean
        after[LENS_AT:, LENS_AT:] += evidence.matrix
        right[LENS_AT:] += evidence.pull
        self.covariance = np.linalg.inv(after)
        self.mean = self.covariance @ right

    def _normal_seen(self, evidence: ImageEvidence, enu_from_flu: Array, flu_from_cam: Array, spent: float) -> None:
        enu_from_cam = enu_from_flu @ flu_from_cam
        normal_cam = evidence.rotation[:, 2]
        # a small turn w moves the normal n by w x n = -[n]x w
        moved_cam = (-enu_from_cam @ skew(normal_cam))[:2]
        moved_flu = (-enu_from_flu @ skew(flu_from_cam @ normal_cam))[:2]
        observe = np.zeros((2, len(self.mean)))
        observe[:, LENS_AT:] = -moved_cam @ evidence.turn
        observe[:, MOUNTING] = -moved_flu
        observe[:, DECK] = np.eye(2)
        observe[:, TILT_SCALE] = enu_from_flu[:2, 2]
        shared = max(ALIKE_TIME / max(spent, SOONEST), 1.0)
        noise = moved_cam @ evidence.covariance @ moved_cam.T + self._attitude_sd**2 * shared * np.eye(2)
        surprise = (enu_from_cam @ normal_cam)[:2] - observe @ self.mean
        gain = self.covariance @ observe.T @ np.linalg.inv(observe @ self.covariance @ observe.T + noise)
        self.mean = self.mean + gain @ surprise
        kept = self.covariance - gain @ observe @ self.covariance
        self.covariance = (kept + kept.T) / 2
