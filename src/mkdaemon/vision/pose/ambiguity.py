"""Choosing between a pose and its mirror image, or refusing to.

Four points in a plane are explained nearly as well by a pose mirrored about the line of sight. The evidence is taken in
the order of its strength: the vehicle's attitude over a level target, then the image itself.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from mkdaemon.vision.limits import LIMITS
from mkdaemon.vision.pose.pose import Pose, angle_between

Decision = Literal["unique", "image", "attitude", "track"]


@dataclass(frozen=True, slots=True, eq=False)
class Choice:
    """The pose that survived.

    Attributes:
        pose: the candidate.
        ratio: second over first residual; infinite when there is no second.
        decided_by: what settled it.
    """

    pose: Pose
    ratio: float
    decided_by: Decision


FIELD = 1.5
"""Power of what neighbours share, for the variance of a mean over a field: (1 + r) / (1 - r) each way, to 10 %."""


def choose(
    candidates: Sequence[Pose],
    *,
    min_ratio: float,
    tilt_errors: Sequence[float] | None = None,
    tilt_gate: float = 0.0,
) -> Choice | None:
    """Pick the true candidate.

    Args:
        candidates: fitted poses of one target from all starts; may hold the same pose twice.
        min_ratio: residual ratio from which the image alone decides.
        tilt_errors: disagreement of each candidate with the vehicle's attitude [rad]; none when unknown.
        tilt_gate: largest believable disagreement [rad].

    Returns:
        The choice; none when nothing decides or the attitude contradicts every candidate.
    """
    decides, same_pose = LIMITS.ambiguity, LIMITS.certainty.blind_angle_sd
    order = sorted(range(len(candidates)), key=lambda k: candidates[k].loss)
    distinct: list[int] = []
    for k in order:
        if all(angle_between(candidates[k].rotation, candidates[j].rotation) > same_pose for j in distinct):
            distinct.append(k)
    if not distinct:
        return None
    ratio = _ratio(candidates, distinct)
    if tilt_errors is not None:
        fitting = [k for k in distinct if tilt_errors[k] <= tilt_gate]
        if len(fitting) == 1:
            rivals = len(distinct) > 1
            return Choice(candidates[fitting[0]], ratio, "attitude" if rivals else "unique")
        if not fitting:
            return None
        distinct = fitting
    first = candidates[distinct[0]]
    if len(distinct) == 1:
        return Choice(first, ratio, "unique")
    second = candidates[distinct[1]]
    if log_odds(first, second) >= decides.decided and (ratio >= min_ratio or _is_explained(first, second)):
        return Choice(first, ratio, "image")
    return None


def log_odds(first: Pose, second: Pose) -> float:
    """Log likelihood ratio of two fits of equal Gaussian residuals with unknown variance.

    n / 2 ln(s2^2 / s1^2) with n independent residuals; neighbouring samples share pixels and are not, and those of grey
    values share what the model lacks too: behind a dirty lens it spoke for the mirror image by 6 nats an image.

    Where a fit leaves nothing but noise, s^2 is its cost: the noise is that of its own residuals, as what the other's
    share is why it is wrong, and a reading that wants a bend or a motion nobody expects pays for it. Elsewhere
    something may take sides, and the loss, which what is hidden hardly moves, is asked.
    """
    least = LIMITS.ambiguity.samples_per_fact
    points = 0.5 * min(first.points, second.points)
    if first.cost is not None and second.cost is not None and _is_explained(first, second):
        facts: float = points / max(least, first.shared**FIELD)
        return facts * float(np.log(max(second.cost, 1e-12) / max(first.cost, 1e-12)))
    facts = points / max(least, max(first.shared, second.shared) ** FIELD)
    return facts * float(np.log(max(second.loss, 1e-12) / max(first.loss, 1e-12)))


def prefers(first: Pose, second: Pose) -> bool:
    """Whether the image prefers one fit to another of its kind, by more than blur or light do."""
    return first.source == second.source and log_odds(first, second) > LIMITS.branches.silent


def _is_explained(first: Pose, second: Pose) -> bool:
    """Whether a fit to grey values leaves no more than noise: then nothing unmodelled takes sides."""
    grey = first.source == "photometric" and second.source == "photometric"
    quiet = first.unexplained_px <= LIMITS.health.drift_px
    return grey and quiet and first.inliers >= LIMITS.agreement.whole


def _ratio(candidates: Sequence[Pose], distinct: Sequence[int]) -> float:
    if len(distinct) < 2:
        return float("inf")
    return float(np.sqrt(candidates[distinct[1]].loss / max(candidates[distinct[0]].loss, 1e-12)))
