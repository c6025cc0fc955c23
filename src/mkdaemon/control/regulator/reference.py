"""A position reference that moves as the aircraft can: bounded speed and acceleration, no step.

The regulator follows it with its velocity and acceleration fed forward, so a far goal saturates nothing and the
overshoot is that of the regulator, not of the step.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from mkdaemon.control.linear import Array

BRAKING: Final = 0.65
"""Share of the acceleration that braking plans with: a reference passes its goal by less than 2 % of a step of 1 m."""
NEARING: Final = 2.0
"""Speed over distance close to the goal [1/s]: from where braking would slow down by more, it does not."""
TAKEN_UP: Final = 0.12
"""Least time in which a wanted speed is reached [s]."""
RESTS: Final = 1e-3
"""A reference so near its goal, and so slow, moves no more [m; m/s]."""


@dataclass(frozen=True, slots=True)
class ReferenceLimits:
    """Bounds of the reference.

    Attributes:
        speed: [m/s].
        acceleration: [m/s2].
    """

    speed: float
    acceleration: float

    def towards(self, away: Sequence[float], velocity: Sequence[float], step: float) -> list[float]:
        """Acceleration (n,) for the next step [m/s2].

        The speed towards the goal is what can still be braked away with `BRAKING` of the acceleration, and falls off
        linearly close to it, so that braking never jumps.

        Args:
            away: from here to the goal (n,) [m].
            velocity: (n,) [m/s].
            step: [s].
        """
        distance, braking = math.hypot(*away), self.acceleration * BRAKING
        near = braking / NEARING**2
        speed = distance * NEARING if distance < near else math.sqrt(2.0 * braking * (distance - near / 2.0))
        share, rate = min(speed, self.speed) / max(distance, 1e-9), 1.0 / max(step, TAKEN_UP)
        change = [(part * share - now) * rate for part, now in zip(away, velocity, strict=True)]
        size = math.hypot(*change)
        return change if size <= self.acceleration else [part * self.acceleration / size for part in change]


@dataclass(frozen=True, slots=True)
class KnownCourse:
    """A reference whose way is known, and what is seen of it ahead.

    Attributes:
        position: x, y, z (3,) [m].
        velocity: (3,) [m/s].
        acceleration: (3,) [m/s2].
        jumps: changes of the horizontal acceleration at each of the next steps (count, 2) [m/s2].
        gains: changes of the horizontal velocity at each of them (count, 2) [m/s].
    """

    position: Array
    velocity: Array
    acceleration: Array
    jumps: Array
    gains: Array


class Reference:
    """A moving reference in `n` dimensions, bounded as a vector.

    Attributes:
        position: (n,) [m].
        velocity: (n,) [m/s].
        acceleration: (n,) [m/s2].
    """

    def __init__(self, position: Array, velocity: Array | None = None, acceleration: Array | None = None) -> None:
        self.position = np.array(position, dtype=np.float64)
        self.velocity = np.zeros_like(self.position) if velocity is None else np.array(velocity, dtype=np.float64)
        self.acceleration = np.zeros_like(self.position) if acceleration is None else np.array(acceleration)

    def move(self, goal: Array, limits: ReferenceLimits, step: float) -> None:
        """Go on towards a goal for a time.

        Args:
            goal: (n,) [m].
            limits: bounds.
            step: [s].
        """
        self.acceleration = np.array(limits.towards((goal - self.position).tolist(), self.velocity.tolist(), step))
        self.position = self.position + self.velocity * step + 0.5 * self.acceleration * step * step
        self.velocity = self.velocity + self.acceleration * step

    def jumps_ahead(self, goal: Array, limits: ReferenceLimits, step: float, count: int) -> Array | None:
        """Changes of the acceleration at each of the next steps (count, n) [m/s2]; None where it rests on its goal.

        Args:
            goal: (n,) [m].
            limits: bounds.
            step: [s].
            count: of steps.
        """
        away, velocity, before = (goal - self.position).tolist(), self.velocity.tolist(), self.acceleration.tolist()
        if max(map(abs, (*away, *velocity))) < RESTS:
            return None
        jumps = []
        for _ in range(count):
            after = limits.towards(away, velocity, step)
            jumps.append([new - old for new, old in zip(after, before, strict=True)])
            away = [s - (v + 0.5 * a * step) * step for s, v, a in zip(away, velocity, after, strict=True)]
            velocity = [v + a * step for v, a in zip(velocity, after, strict=True)]
            before = after
        return np.array(jumps)
