"""A motion capture system around the simulated aircraft: poses at a fixed rate, late, with noise and named faults."""

from __future__ import annotations

import math
import random
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np

from mkdaemon.frames import Matrix, Vector, quaternion_from_rotation, rotation_from_euler
from mkdaemon.telemetry.position import PositionReport
from mksim.physics.truth import Truth

RATE: Final = 100.0
"""Of its cameras [Hz]."""
LATENCY: Final = 0.003
"""From the exposure of its cameras to the report [s]."""
PLACE_SD: Final = 0.0005
"""Noise of a position, each axis [m]."""
ANGLE_SD: Final = math.radians(0.1)
"""Noise of an angle, each axis [rad]."""
DROP_OUT: Final = 0.01
"""Share of measurements without the body: markers are hidden."""
OTHER: Final = (1.1, -0.6, 0.9)
"""Where another tracked body is carried about [m]."""


@dataclass(frozen=True, slots=True)
class Measured:
    """What the system makes of one exposure.

    Attributes:
        position: of the body (3,) [m].
        rotation: of the body (3, 3).
        latency: until it is reported [s].
        stated: what of that the report admits [s].
    """

    position: Vector
    rotation: Matrix
    latency: float = LATENCY
    stated: float = LATENCY

    @property
    def quaternion(self) -> tuple[float, float, float, float]:
        """The rotation (w, x, y, z)."""
        return quaternion_from_rotation(self.rotation)

    def report(self, epoch: int, sequence: int) -> PositionReport:
        """The report of it."""
        x, y, z = self.position.tolist()
        return PositionReport(
            epoch=epoch, sequence=sequence, age=self.stated, position=(x, y, z), quaternion=self.quaternion
        )


class MotionCapture:
    """Measures one body.

    Attributes:
        fault: name of the fault that it plays, one of `FAULTS`; empty for none.
    """

    def __init__(self, seed: int) -> None:
        """Start without a fault; `seed` of everything random."""
        self.fault = ""
        self._rng = random.Random(f"{seed} motion capture")
        self._last: Measured | None = None

    def measure(self, at: float, truth: Truth) -> Measured | None:
        """Expose at a time [s]; None where the body is not seen."""
        gauss = self._rng.gauss
        noise = np.array([gauss(0.0, PLACE_SD) for _ in range(3)])
        turned = rotation_from_euler(*(gauss(0.0, ANGLE_SD) for _ in range(3)))
        measured = Measured(truth.position_enu + noise, truth.enu_from_flu @ turned)
        if self._rng.random() < DROP_OUT:
            return None
        if self.fault != "frozen" or self._last is None:
            self._last = measured
        return FAULTS[self.fault](self, measured, at) if self.fault else measured

    def _repeat(self, measured: Measured, at: float) -> Measured | None:
        """Return the last measurement again."""
        del measured, at
        return self._last


def _off(capture: MotionCapture, measured: Measured, at: float) -> Measured:
    return Measured(measured.position + np.array([0.3, 0.0, 0.0]), measured.rotation)


def _other(capture: MotionCapture, measured: Measured, at: float) -> Measured:
    way = np.array([0.2 * math.sin(1.1 * at), 0.2 * math.cos(0.9 * at), 0.1 * math.sin(0.7 * at)])
    return Measured(np.array(OTHER) + way, rotation_from_euler(0.02 * math.sin(3.0 * at), 0.0, 1.0))


def _neighbour(capture: MotionCapture, measured: Measured, at: float) -> Measured:
    noise = 1e-4 * math.sin(1e4 * at)
    return Measured(np.array([0.3, 0.2, 0.1 + noise]), rotation_from_euler(noise, 0.0, 0.5))


def _mirrored(capture: MotionCapture, measured: Measured, at: float) -> Measured:
    flip = np.diag([1.0, -1.0, 1.0])
    return Measured(flip @ measured.position, flip @ measured.rotation @ flip)


def _crossed(capture: MotionCapture, measured: Measured, at: float) -> Measured:
    return Measured(measured.position * (1.0, -1.0, 1.0), measured.rotation)


def _wrong_up(capture: MotionCapture, measured: Measured, at: float) -> Measured:
    turn = rotation_from_euler(math.radians(90.0), 0.0, 0.0)
    return Measured(turn @ measured.position, turn @ measured.rotation)


FAULTS: Final[dict[str, Callable[[MotionCapture, Measured, float], Measured | None]]] = {
    "off": _off,
    "silent": lambda capture, measured, at: None,
    "late": lambda capture, measured, at: Measured(measured.position, measured.rotation, 0.5, 0.5),
    "late_unsaid": lambda capture, measured, at: Measured(measured.position, measured.rotation, 0.5, 0.0),
    "mirrored": _mirrored,
    "mirrored_place": _crossed,
    "wrong_up": _wrong_up,
    "other_body": _other,
    "neighbour": _neighbour,
    "frozen": MotionCapture._repeat,  # noqa: SLF001  # the same class
}
"""Faults by name: 0.3 m off; silent; 0.5 s late, and the same unsaid; left-handed axes of the whole pose, or of the
place alone; y for up; the pose of another body that is carried, or that stands beside; the last pose repeated."""
