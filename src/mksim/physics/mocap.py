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


@dataclass(frozen=True, slots=True)
class FaultSize:
    """Size of the faults.

    Attributes:
        offset: of `off` [m].
        delay: of `late` and `late_unsaid` [s].
        axis: that is mirrored, 0 for x and 1 for y.
        carried: where `other_body` is carried about [m].
        beside: where the body of `neighbour` stands [m].
    """

    offset: tuple[float, float, float] = (0.3, 0.0, 0.0)
    delay: float = 0.5
    axis: int = 1
    carried: tuple[float, float, float] = (1.1, -0.6, 0.9)
    beside: tuple[float, float, float] = (0.3, 0.2, 0.1)


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
        size: of its faults.
    """

    def __init__(self, seed: int) -> None:
        """Start without a fault; `seed` of everything random."""
        self.fault = ""
        self.size = FaultSize()
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
    return Measured(measured.position + np.array(capture.size.offset), measured.rotation)


def _other(capture: MotionCapture, measured: Measured, at: float) -> Measured:
    way = np.array([0.2 * math.sin(1.1 * at), 0.2 * math.cos(0.9 * at), 0.1 * math.sin(0.7 * at)])
    return Measured(np.array(capture.size.carried) + way, rotation_from_euler(0.02 * math.sin(3.0 * at), 0.0, 1.0))


def _neighbour(capture: MotionCapture, measured: Measured, at: float) -> Measured:
    noise = 1e-4 * math.sin(1e4 * at)
    x, y, z = capture.size.beside
    return Measured(np.array([x, y, z + noise]), rotation_from_euler(noise, 0.0, 0.5))


def _late(capture: MotionCapture, measured: Measured, at: float) -> Measured:
    delay = capture.size.delay
    return Measured(measured.position, measured.rotation, delay, delay)


def _late_unsaid(capture: MotionCapture, measured: Measured, at: float) -> Measured:
    return Measured(measured.position, measured.rotation, capture.size.delay, 0.0)


def _flip(capture: MotionCapture) -> Matrix:
    return np.diag([-1.0 if axis == capture.size.axis else 1.0 for axis in range(3)])


def _mirrored(capture: MotionCapture, measured: Measured, at: float) -> Measured:
    flip = _flip(capture)
    return Measured(flip @ measured.position, flip @ measured.rotation @ flip)


def _crossed(capture: MotionCapture, measured: Measured, at: float) -> Measured:
    return Measured(_flip(capture) @ measured.position, measured.rotation)


def _wrong_up(capture: MotionCapture, measured: Measured, at: float) -> Measured:
    turn = rotation_from_euler(math.radians(90.0), 0.0, 0.0)
    return Measured(turn @ measured.position, turn @ measured.rotation)


FAULTS: Final[dict[str, Callable[[MotionCapture, Measured, float], Measured | None]]] = {
    "off": _off,
    "silent": lambda capture, measured, at: None,
    "late": _late,
    "late_unsaid": _late_unsaid,
    "mirrored": _mirrored,
    "mirrored_place": _crossed,
    "wrong_up": _wrong_up,
    "other_body": _other,
    "neighbour": _neighbour,
    "frozen": MotionCapture._repeat,  # noqa: SLF001  # the same class
}
"""Faults by name: 0.3 m off; silent; 0.5 s late, and the same unsaid; left-handed axes of the whole pose, or of the
place alone; y for up; the pose of another body that is carried, or that stands beside; the last pose repeated."""
