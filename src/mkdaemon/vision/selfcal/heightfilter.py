"""Heights over a target, as the eyes see them, against the barometer: on ways down and up their scales must agree.

With z the height by the eyes, e the share of it that is too much, b the barometer, a its offset and L its delay,
b = a + z - e z - L dz/dt. The offset wanders, so slow flights say little, and a hover nothing.
"""

from __future__ import annotations

from typing import Final

import numpy as np
import numpy.typing as npt

from mkdaemon.vision.selfcal.limits import SELFCAL

Array = npt.NDArray[np.float64]

SCALE_SD: Final = 0.5
"""How far heights may be off, deviation: a size may be that of another print."""
DELAY: Final = (0.15, 0.1)
"""Of a barometer's height when it arrives here, mean and deviation [s]."""
OFFSET_SD: Final = 100.0
"""Of the two zeros [m]: nothing is known."""
WANDER: Final = 0.067
"""Of a barometer, random walk [m/sqrt(s)]: 0.15 m with 10 s of correlation, as the simulator's."""
READING_SD: Final = 0.03
"""Of one reading [m]: steps of 5 cm."""
LOWEST: Final = 0.7
"""Below, the rotors' own pressure is on the barometer [m]."""
LONGEST_GAP: Final = 0.5
"""Between two poses that a reading lies between [s]."""
PAUSE: Final = 5.0
"""Without both for so long the offset is unknown again [s]."""
KEPT: Final = 50
"""Readings that wait for the next pose."""


class HeightFilter:
    """Compares the heights over one target with those of the barometer.

    Attributes:
        covered: between the lowest and the highest height that was compared [m].
    """

    def __init__(self) -> None:
        self._mean: Array = np.array([0.0, 0.0, DELAY[0]])
        self._covariance: Array = np.diag(np.array([OFFSET_SD, SCALE_SD, DELAY[1]]) ** 2)
        self._waiting: list[tuple[float, float]] = []
        self._last: tuple[float, float] | None = None
        self._compared_at: float | None = None
        self._low, self._high = np.inf, -np.inf

    @property
    def scale(self) -> tuple[float, float]:
        """Share by which the eyes' heights are too large, and its deviation."""
        return float(self._mean[1]), float(np.sqrt(self._covariance[1, 1]))

    @property
    def contradicts(self) -> bool:
        """Whether the barometer says that heights are wrong: by enough to matter, and by no accident."""
        share, sd = self.scale
        return self.covered > SELFCAL.least_way and abs(share) > max(SELFCAL.height, SELFCAL.certain * sd)

    @property
    def covered(self) -> float:
        """Between the lowest and the highest height that was compared [m]."""
        return max(float(self._high - self._low), 0.0)

    def reading_received(self, time: float, height: float) -> None:
        """Take the barometer's height [m] at a time [s]; it counts when the next pose is there."""
        self._waiting = [*self._waiting[1 - KEPT :], (time, height)]

    def pose_seen(self, time: float, height: float) -> None:
        """Take the eyes' height over the target [m] at a time [s]."""
        before, self._last = self._last, (time, height)
        if before is None or not 0.0 < time - before[0] < LONGEST_GAP:
            return
        due = [reading for reading in self._waiting if before[0] <= reading[0] < time]
        self._waiting = [reading for reading in self._waiting if reading[0] >= time]
        speed = (height - before[1]) / (time - before[0])
        for at, barometer in due:
            here = before[1] + speed * (at - before[0])
            if here > LOWEST:
                self._compare(at, here, speed, barometer)

    def _compare(self, time: float, height: float, speed: float, barometer: float) -> None:
        spent = 0.0 if self._compared_at is None else max(time - self._compared_at, 0.0)
        self._compared_at = time
        if spent > PAUSE:
            self._covariance[0, :] = self._covariance[:, 0] = 0.0
            self._covariance[0, 0] = OFFSET_SD**2
        self._covariance[0, 0] += WANDER**2 * spent
        self._low, self._high = min(self._low, height), max(self._high, height)
        observe = np.array([1.0, -height, -speed])
        surprise = barometer - height - float(observe @ self._mean)
        seen = self._covariance @ observe
        gain = seen / (float(observe @ seen) + READING_SD**2)
        self._mean = self._mean + gain * surprise
        kept = self._covariance - np.outer(gain, seen)
        self._covariance = (kept + kept.T) / 2
