"""A position reference that moves as the aircraft can: bounded speed and acceleration, no step.

The regulator follows it with its velocity and acceleration fed forward, so a far goal saturates nothing and the
overshoot is that of the regulator, not of the step.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from mkdaemon.control.linear import Array

BRAKING: Final = 0.65
"""Share of the acceleration that braking plans with: the reference of a step of 1 m is at nine tenths after 1.7 s, and
passes its goal by less than 2 %."""


@dataclass(frozen=True, slots=True)
class ReferenceLimits:
    """Bounds of the reference.

    Attributes:
        speed: [m/s].
        acceleration: [m/s2].
    """

    speed: float
    acceleration: float


class Reference:
    """A moving reference in `n` dimensions, bounded as a vector.

    Attributes:
        position: (n,) [m].
        velocity: (n,) [m/s].
        acceleration: (n,) [m/s2].
    """

    def __init__(self, position: Array, velocity: Array | None = None) -> None:
        self.position = np.array(position, dtype=np.float64)
        self.velocity = np.zeros_like(self.position) if velocity is None else np.array(velocity, dtype=np.float64)
        self.acceleration = np.zeros_like(self.position)

    def move(self, goal: Array, limits: ReferenceLimits, step: float, *, goal_velocity: Array | float = 0.0) -> None:
        """Go on towards a goal for a time.

        The speed towards the goal is what can still be braked away with `BRAKING` of the acceleration, and falls off
        linearly close to it.

        Args:
            goal: (n,) [m].
            limits: bounds.
            step: [s].
            goal_velocity: of the goal itself (n,) [m/s].
        """
        away = goal - self.position
        distance = float(np.linalg.norm(away))
        braking = limits.acceleration * BRAKING
        near = 0.12 + braking * step
        slope = math.sqrt(2.0 * braking * near) / near
        speed = distance * slope if distance < near else math.sqrt(2.0 * braking * distance)
        wanted = away * (min(speed, limits.speed) / max(distance, 1e-9)) + goal_velocity
        change = (wanted - self.velocity) / max(step, 0.12)
        size = float(np.linalg.norm(change))
        if size > limits.acceleration:
            change *= limits.acceleration / size
        self.acceleration = change
        self.position = self.position + self.velocity * step + 0.5 * change * step * step
        self.velocity = self.velocity + change * step
