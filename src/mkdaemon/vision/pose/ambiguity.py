"""What one image says for a pose against its mirror image.

Four points in a plane are explained nearly as well by a pose mirrored about the line of sight.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np

from mkdaemon.vision.arrays import Array
from mkdaemon.vision.limits import LIMITS
from mkdaemon.vision.pose.pose import Pose, angle_between

Decision = Literal["unique", "image", "attitude", "track"]

CAUTION = 4.0
"""Images over which the errors of a pose last, where light, blur or cover cause them: a factor on its variance, and by
which what it says beyond `silent` counts less."""
FIELD = 1.5
"""Power of what neighbours share, for the variance of a mean over a field: (1 + r) / (1 - r) each way, to 10 %."""


def loss_of(size: Array, most: float, least: float) -> float:
    """Loss of a fit for rivals: geometric mean of min(r, most)^2 + least^2, by the sizes of its residuals `(n,)`.

    Log odds of two fits are then n / 2 times the log of their ratio, and what is hidden costs both the same.
    """
    return float(np.exp(np.mean(np.log(np.minimum(size, most) ** 2 + least**2))))


def log_odds(first: Pose, second: Pose) -> float:
    """Log likelihood ratio of two fits of equal Gaussian residuals with unknown variance.

    n / 2 ln(s2^2 / s1^2) with n independent residuals; neighbouring samples share pixels and are not, and those of grey
    values share what the model lacks too: behind a dirty lens it spoke for the mirror image by 6 nats an image.

    Where a fit leaves nothing but noise, s^2 is its cost: the noise is that of its own residuals, as what the other's
    share is why it is wrong, and a reading that wants a bend or a motion nobody expects pays for it. Elsewhere
    something may take sides, and the loss, which what is hidden hardly moves, is asked.
    """
    points = min(first.points, second.points)
    if first.cost is not None and second.cost is not None and _is_explained(first, second):
        return 0.5 * facts(points, first.shared) * float(np.log(max(second.cost, 1e-12) / max(first.cost, 1e-12)))
    shared = max(first.shared, second.shared)
    return 0.5 * facts(points, shared) * float(np.log(max(second.loss, 1e-12) / max(first.loss, 1e-12)))


def facts(points: int, shared: float) -> float:
    """Independent residuals among so many, of which neighbours share so much (`Pose.shared`)."""
    return points / float(max(LIMITS.ambiguity.samples_per_fact, shared**FIELD))


def evidence(first: Pose, second: Pose) -> float:
    """What an image adds to the log odds of a fit against one that it likes less, zero to `decided` [nats].

    Where a fit leaves nothing but noise, all it says; elsewhere what hides the target, light or blur may take sides.
    """
    odds = log_odds(first, second)
    odds = odds if _is_explained(first, second) else (odds - LIMITS.ambiguity.silent) / CAUTION
    return min(max(odds, 0.0), LIMITS.ambiguity.decided)


def prefers(first: Pose, second: Pose) -> bool:
    """Whether the image prefers one fit to another of its kind, by more than blur or light do."""
    return first.source == second.source and log_odds(first, second) > LIMITS.ambiguity.silent


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
