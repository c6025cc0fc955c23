"""Evidence of one image for a pose against its mirror image, which fits a plane nearly as well."""

from __future__ import annotations

from collections.abc import Sequence
from math import log, sin

import numpy as np

from mkdaemon.vision.arrays import Array
from mkdaemon.vision.limits import LIMITS
from mkdaemon.vision.pose.pose import Pose, angle_between

CAUTION = 4.0
"""Images over which the errors of a pose last, where light, blur or cover cause them: a factor on its variance, and by
which what it says beyond `silent` counts less."""
MIRRORED = 0.26
"""Mean square root of (x^2 - 1/3) cos(t) and x y, half of the edges each way: 0.32 head on, this at 60 degrees."""
FIELD = 1.5
"""Power of what neighbours share, for the variance of a mean over a field: (1 + r) / (1 - r) each way, to 10 %."""


def loss_of(size: Array, most: float, least: float) -> float:
    """Loss of a fit for rivals: geometric mean of min(r, most)^2 + least^2, by the sizes of its residuals `(n,)`.

    Log odds of two fits are then n / 2 times the log of their ratio, and what is hidden costs both the same.
    """
    return float(np.exp(np.mean(np.log(np.minimum(size, most) ** 2 + least**2))))


def log_odds(first: Pose, second: Pose) -> float:
    """Log likelihood ratio of two fits of equal Gaussian residuals with unknown variance.

    n / 2 ln(s2^2 / s1^2) with n independent residuals; neighbouring samples share pixels, and what the model lacks.
    Where a fit leaves nothing but noise, s^2 is its cost, in which an unexpected bend or motion counts, and
    what the other's residuals share is why it is wrong. Elsewhere s^2 is the loss, which what is hidden hardly moves.
    """
    points, shared, of = min(first.points, second.points), max(first.shared, second.shared), (first.loss, second.loss)
    if first.cost is not None and second.cost is not None and _is_explained(first, second):
        shared, of = first.shared, (first.cost, second.cost)
    return 0.5 * facts(points, shared) * float(np.log(max(of[1], 1e-12) / max(of[0], 1e-12)))


def facts(points: int, shared: float) -> float:
    """Number of independent residuals, if neighbours share a part (`Pose.shared`)."""
    return points / float(max(LIMITS.ambiguity.samples_per_fact, shared**FIELD))


def evidence(first: Pose, second: Pose) -> float:
    """Contribution of an image to the log odds of a fit against a worse one, zero to `decided` [nats]."""
    odds = log_odds(first, second)
    odds = odds if _is_explained(first, second) else (odds - LIMITS.ambiguity.silent) / CAUTION
    return min(max(odds, 0.0), LIMITS.ambiguity.decided)


def mirror_odds(pose: Pose, side: float, focal_px: float) -> float:
    """Log odds against the mirror image of a pose by perspective alone, before an image is asked.

    In the mirror image of a tilt t, points at (x, y) of a square, in halves of its side s from its middle, are
    f s^2 / (2 r^2) sin(t) (x^2 cos(t), x y) off, at a range r; `MIRRORED` of it no move takes up. A fit that is the
    mirror image leaves as much, so half of what a fit leaves may be that. Rivals closer than `wrong_angle` are none.

    Args:
        pose: a fit.
        side: of the largest tag [m].
        focal_px: focal length.
    """
    tilt = max(pose.tilt, LIMITS.certainty.wrong_angle / 2)
    off_px = MIRRORED * focal_px * (side / pose.range_m) ** 2 / 2 * sin(tilt)
    left2 = max(pose.rms_px**2, LIMITS.edges.systematic_px**2)
    return 0.5 * facts(pose.points, pose.shared) * log((left2 + off_px**2) / (2 * left2))


def prefers(first: Pose, second: Pose, inertia: float = 0.0) -> bool:
    """Whether the image prefers one fit to another of its kind by more than blur or light do; `inertia` adds odds."""
    odds = log_odds(first, second) if first.source == second.source else 0.0
    return odds + inertia > LIMITS.ambiguity.silent


def _is_explained(first: Pose, second: Pose) -> bool:
    """Whether a fit to grey values leaves no more than noise: then nothing unmodelled takes sides."""
    grey = first.source == "photometric" and second.source == "photometric"
    quiet = first.unexplained_px <= LIMITS.health.drift_px
    return grey and quiet and first.inliers >= LIMITS.agreement.whole


def residual_ratio(pose: Pose, others: Sequence[Pose]) -> float:
    """Residual of the best other reading over that of a pose; infinite without one."""
    same = LIMITS.certainty.blind_angle_sd
    rivals = [other.loss for other in others if angle_between(pose.rotation, other.rotation) > same]
    return float(np.sqrt(min(rivals) / max(pose.loss, 1e-12))) if rivals else float("inf")
