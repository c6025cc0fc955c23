"""Choosing between a pose and its mirror image, or refusing to.

Four points in a plane are explained nearly as well by a pose mirrored about the line of sight. The evidence is taken in
the order of its strength: the vehicle's attitude over a level target, the track, the image itself.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

from mkdaemon.vision.pose.gates import BLIND_GREY_RMS_PX
from mkdaemon.vision.pose.pose import Pose, angle_between

Array = npt.NDArray[np.float64]
Decision = Literal["unique", "image", "attitude", "track"]

SAME_POSE = np.radians(1.0)
"""Candidates closer than this are one pose [rad]."""
SAMPLES_PER_FACT = 4.0
"""Neighbouring samples share pixels; a quarter of them counts as independent."""
MIN_LOG_ODDS = 12.0
"""Natural log of the odds from which the image alone decides: one in 160,000."""

CLEAR_RATIO = 1.4
"""Residual ratio asked for however many samples speak; unmodelled light and blur are shared by all of them."""
EXPLAINED_INLIERS = 0.95
"""Share of the pixels that agree where nothing lies over the target."""
MAX_ODDS_AGAINST = 2.0
"""Log odds of the image against a candidate up to which the track may still choose it."""


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


def choose(
    candidates: Sequence[Pose],
    *,
    min_ratio: float,
    tilt_errors: Sequence[float] | None = None,
    tilt_gate: float = 0.0,
    predicted: Array | None = None,
) -> Choice | None:
    """Pick the true candidate.

    Args:
        candidates: fitted poses of one target from all starts; may hold the same pose twice.
        min_ratio: residual ratio from which the image alone decides.
        tilt_errors: disagreement of each candidate with the vehicle's attitude [rad]; none when unknown.
        tilt_gate: largest believable disagreement [rad].
        predicted: rotation the track expects `(3, 3)`.

    Returns:
        The choice; none when nothing decides or the attitude contradicts every candidate.
    """
    order = sorted(range(len(candidates)), key=lambda k: candidates[k].loss)
    distinct: list[int] = []
    for k in order:
        if all(angle_between(candidates[k].rotation, candidates[j].rotation) > SAME_POSE for j in distinct):
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
    if ratio >= min_ratio and log_odds(first, second) >= MIN_LOG_ODDS:
        return Choice(first, ratio, "image")
    if _is_explained(first, second) and log_odds(first, second) >= MIN_LOG_ODDS:
        return Choice(first, ratio, "image")
    if predicted is not None:
        by_track = sorted(distinct, key=lambda k: angle_between(candidates[k].rotation, predicted))
        near, far = (angle_between(candidates[k].rotation, predicted) for k in by_track[:2])
        chosen = candidates[by_track[0]]
        # The track may break a tie; it may not overrule what the image says.
        against = log_odds(first, chosen) if chosen is not first else 0.0
        if near < np.radians(5.0) and far > 2.0 * near + np.radians(2.0) and against < MAX_ODDS_AGAINST:
            return Choice(chosen, ratio, "track")
    if ratio >= CLEAR_RATIO and log_odds(first, second) >= 4 * MIN_LOG_ODDS:
        return Choice(first, ratio, "image")
    return None


def log_odds(first: Pose, second: Pose) -> float:
    """Log likelihood ratio of two fits of equal Gaussian residuals with unknown variance."""
    facts = min(first.points, second.points) / SAMPLES_PER_FACT
    return 0.5 * facts * float(np.log(max(second.loss, 1e-12) / max(first.loss, 1e-12)))


def _is_explained(first: Pose, second: Pose) -> bool:
    """Whether a fit to grey values leaves no more than noise: then nothing unmodelled takes sides."""
    grey = first.source == "photometric" and second.source == "photometric"
    return grey and first.rms_px <= BLIND_GREY_RMS_PX and first.inliers >= EXPLAINED_INLIERS


def _ratio(candidates: Sequence[Pose], distinct: Sequence[int]) -> float:
    if len(distinct) < 2:
        return float("inf")
    return float(np.sqrt(candidates[distinct[1]].loss / max(candidates[distinct[0]].loss, 1e-12)))
