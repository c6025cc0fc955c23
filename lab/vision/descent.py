"""A descent over a target with wander, and what attitude and barometer make of it."""

from __future__ import annotations

from math import radians
from typing import Final

import numpy as np
import numpy.typing as npt

from lab.vision.flight import LOOKING_DOWN, VGA
from mkdaemon.frames import rotation_from_euler
from mkdaemon.vision.track.attitude import AttitudeHistory, AttitudeSample
from mksim.scene.view import CameraView

Array = npt.NDArray[np.float64]

SECONDS, FPS = 10.0, 15.0
HIGH, LOW = 4.0, 1.0
BIAS, WANDER, NOISE = radians(0.3), radians(0.4), radians(0.1)
"""Of the reported attitude: constant, with a correlation of 1 s, and of each sample."""
BAROMETER: Final = 0.15
"""Wander of the barometer, deviation [m], correlation 10 s."""
BAROMETER_DELAY: Final = 0.1


class Descent:
    """A way from 4 m to 1 m with wander, and what attitude and barometer make of it."""

    def __init__(self, seed: int, *, yaws: bool) -> None:
        rng = np.random.default_rng([seed, 0x5E1F])
        self._phase, self._rates = rng.uniform(0, 2 * np.pi, 5), rng.uniform(1.0, 3.0, 5)
        self._turn = radians(60.0) if yaws else 0.0
        self.bias = BIAS * rng.standard_normal(2)
        times = np.arange(0.0, SECONDS + 0.1, 0.02)
        wander = _correlated(rng, len(times), 0.02, 1.0, WANDER, 2)
        noise = NOISE * rng.standard_normal((len(times), 2))
        self.attitude = AttitudeHistory(
            _sample(float(time), self.angles(float(time)) + np.append(self.bias + slow + fast, 0.0))
            for time, slow, fast in zip(times, wander, noise, strict=True)
        )
        barometer = _correlated(rng, int(SECONDS / 0.2), 0.2, 10.0, BAROMETER, 1)[:, 0]
        self.readings = [
            (0.2 * k, float(np.round((self.height(0.2 * k - BAROMETER_DELAY) + off) / 0.05) * 0.05))
            for k, off in enumerate(barometer)
        ]

    def height(self, time: float) -> float:
        """Of the lens [m]."""
        return float(HIGH + (LOW - HIGH) * np.clip((time - 1.0) / (SECONDS - 2.0), 0.0, 1.0))

    def angles(self, time: float) -> Array:
        """Roll, pitch, yaw [rad]."""
        wave = np.sin(self._rates * time + self._phase)
        yaw = self._turn * np.sin(0.6 * time + self._phase[2])
        return np.array([radians(4.0) * wave[0], radians(4.0) * wave[1], yaw])

    def view(self, time: float) -> CameraView:
        """What the camera sees, hanging exactly below the vehicle."""
        enu_from_cam = rotation_from_euler(*self.angles(time)) @ LOOKING_DOWN.flu_from_cam
        wave = np.sin(0.7 * self._rates * time + self._phase)
        at = np.array([0.25 * wave[3], 0.25 * wave[4], self.height(time)])
        return CameraView(VGA, enu_from_cam, at, np.zeros(3), np.zeros(3), 0.004, time)


def _sample(time: float, angles: Array) -> AttitudeSample:
    roll, pitch, yaw = (float(angle) for angle in angles)
    return AttitudeSample(time, roll, pitch, yaw)


def _correlated(rng: np.random.Generator, count: int, step: float, time: float, sd: float, axes: int) -> Array:
    """Ornstein-Uhlenbeck noise `(count, axes)`."""
    keep = np.exp(-step / time)
    found = sd * rng.standard_normal((count, axes))
    for k in range(1, count):
        found[k] = keep * found[k - 1] + np.sqrt(1 - keep**2) * found[k]
    return found
