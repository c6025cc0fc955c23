"""Do camera and boards tell of the same motion at the same time? The test of the time stamps.

A tilt moves the target in the image at once, and shows in the attitude that the boards report. How far one has to be
moved in time to look like the other is the error of the stamps. Slow motion is left out of both, because what the
aircraft travels moves the target too. Source: normalised cross-correlation; C. Knapp and G. Carter, "The generalized
correlation method for estimation of time delay", IEEE Trans. ASSP 24 (1976).
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from mkdaemon.control.linear import Array

WINDOW: Final = 8.0
"""Length of the compared motion [s]."""
GRID: Final = 0.01
"""Both are compared on this grid [s]."""
SLOWEST: Final = 0.6
"""Slower motion is removed: the mean over this time is subtracted [s]."""
FARTHEST: Final = 0.25
"""Largest shift that is tried [s]."""
LEAST_MOTION: Final = math.radians(0.4)
"""Smaller tilts, as a root mean square, tell nothing [rad]."""
LEAST_RATE: Final = 12.0
"""Rarer samples tell nothing [Hz]."""
KEPT: Final = 1000
"""Samples of one source that are kept: `WINDOW` at 125 Hz, more than boards and cameras give."""
ALIKE: Final = 0.7
"""Correlation from which on the two are the same motion; its negative is a camera mounted the wrong way round."""


@dataclass(frozen=True, slots=True)
class Match:
    """Result of the comparison.

    Attributes:
        lag: error of the images' time stamps, positive if they are too late [s].
        likeness: correlation at that shift, -1 to 1.
    """

    lag: float
    likeness: float


class MotionMatch:
    """The motion of the last seconds, as the boards reported it and as each camera saw it by each target.

    Two targets in one camera's view lie in different directions: mixed, they would show motion that there was none.
    """

    def __init__(self) -> None:
        self._reported: deque[tuple[float, float, float]] = deque(maxlen=KEPT)
        self._seen: dict[tuple[str, str], deque[tuple[float, float, float]]] = {}

    def attitude_received(self, at: float, pitch: float, roll: float) -> None:
        """Take an attitude of the boards, measured at a time [s]; nose down and right side down positive [rad]."""
        self._reported.append((at, pitch, roll))

    def target_seen(self, target: str, at: float, position_flu: Sequence[float] | Array, camera: str = "") -> None:
        """Take where an image of a camera shows a target.

        Args:
            target: its name.
            at: when the image was taken [s; monotonic].
            position_flu: the target's origin in the body frame (3,) [m; FLU].
            camera: whose image it is.
        """
        depth = -float(position_flu[2])
        if depth <= 0.0:
            return
        forward, right = float(position_flu[0]), -float(position_flu[1])
        self.tilt_seen(target, at, math.atan2(forward, depth), math.atan2(right, depth), camera)

    def tilt_seen(self, target: str, at: float, pitch: float, roll: float, camera: str) -> None:
        """Take a tilt that a source of poses measured; signs and units as those of the boards, the rest as above."""
        self._seen = {view: seen for view, seen in self._seen.items() if seen[-1][0] >= at - WINDOW}
        self._seen.setdefault((target, camera), deque(maxlen=KEPT)).append((at, pitch, roll))

    def match(self, now: float, target: str) -> Match | None:
        """Compare the last seconds by one target; None where there was too little to see, or nothing moved.

        Of several cameras the worst counts: one that sees the opposite, else the one that is farthest off.

        Args:
            now: [s; monotonic].
            target: its name.
        """
        views = [seen for (name, _), seen in self._seen.items() if name == target]
        found = [match for seen in views if (match := self._match(seen, now)) is not None]
        return min(found, key=lambda match: (match.likeness > -ALIKE, -abs(match.lag)), default=None)

    def _match(self, samples: deque[tuple[float, float, float]], now: float) -> Match | None:
        reported, seen = _window(self._reported, now), _window(samples, now)
        if reported is None or seen is None:
            return None
        start, end = max(reported[0, 0], seen[0, 0]), min(reported[-1, 0], seen[-1, 0])
        grid = np.arange(start, end, GRID)
        reach = round(FARTHEST / GRID)
        if len(grid) < WINDOW / GRID / 2:
            return None
        first, second = _quick(reported, grid), _quick(seen, grid)
        middle = slice(reach, -reach)
        if float(np.sqrt((first[:, middle] ** 2).sum(axis=0).mean())) < LEAST_MOTION:
            return None
        # Normalised cross-correlation of both angles together, at each shift of the grid; the lag is its largest
        # magnitude, refined by a parabola through three values. A negative one is a mounting turned by half a turn.
        shifts = range(-reach, reach + 1)
        likeness = np.array([_likeness(first[:, middle], np.roll(second, -k, axis=1)[:, middle]) for k in shifts])
        best = int(np.argmax(np.abs(likeness)))
        return Match((best - reach + _vertex(np.abs(likeness), best)) * GRID, float(likeness[best]))


def _window(samples: deque[tuple[float, float, float]], now: float) -> Array | None:
    """The samples (n, 3) of the window, in the order of their times; None where they are too few, or too far apart.

    Half of them may be missing; those that are there must come at `LEAST_RATE` all the same: between two of them a
    straight line is drawn, and the lag that is found would be that of the line.
    """
    recent = np.array(sorted(sample for sample in samples if now - WINDOW <= sample[0]))
    if len(recent) < LEAST_RATE * WINDOW / 2 or float(np.median(np.diff(recent[:, 0]))) > 1.0 / LEAST_RATE:
        return None
    return recent


def _quick(samples: Array, grid: Array) -> Array:
    """Both angles (2, n) on the grid, less their mean over `SLOWEST`."""
    box = np.ones(round(SLOWEST / GRID))
    angles = np.array([np.interp(grid, samples[:, 0], samples[:, column]) for column in (1, 2)])
    weight = np.convolve(np.ones(len(grid)), box, "same")
    return np.array([angle - np.convolve(angle, box, "same") / weight for angle in angles])


def _likeness(first: Array, second: Array) -> float:
    size = math.sqrt(float((first**2).sum() * (second**2).sum()))
    return float((first * second).sum()) / size if size > 0.0 else 0.0


def _vertex(values: Array, best: int) -> float:
    """Where between its neighbours the parabola through a maximum is highest, -0.5 to 0.5."""
    if not 0 < best < len(values) - 1:
        return 0.0
    before, here, after = (float(value) for value in values[best - 1 : best + 2])
    bend = before - 2.0 * here + after
    return 0.0 if bend == 0.0 else min(max(0.5 * (before - after) / bend, -0.5), 0.5)
