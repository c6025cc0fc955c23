"""Landing on a target that may move: down inside a cone, then through the ground effect without hesitation.

Near the ground the rotors' cushion carries the aircraft away sideways, so below `commit_height` the decision is final:
throttle falls below hover and stays there until the feet stand. Source: docs/control.md, "Landing"; without the final
push a third to two thirds of the landings miss.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from mkdaemon.control.estimator.values import Estimate
from mkdaemon.control.guidance.autopilot import Goal


class LandingPhase(StrEnum):
    """Where a landing stands."""

    APPROACH = "approach"
    """Over the target, waiting until it is inside the cone."""
    DESCEND = "descend"
    """Inside the cone, sinking."""
    COMMIT = "commit"
    """Too low to change its mind."""
    DOWN = "down"
    """The feet stand: throttle goes to its lowest."""


@dataclass(frozen=True, slots=True)
class LandingLimits:
    """The cone and the speeds.

    Attributes:
        stand_height: of the body origin when the feet stand on the target [m].
        base: radius of the cone at standing height [m].
        slope: growth of the radius with height.
        speed: largest speed against the target inside the cone [m/s].
        sink: rate of descent [m/s].
        slow_sink: below `slow_height` [m/s].
        slow_height: above standing height [m].
        commit_height: above standing height [m].
        commit_error: largest horizontal error at which to commit [m].
        commit_gas: throttle while committed [share of hover].
        sight: oldest image with which to descend [s].
        blind: oldest image with which to commit [s].
        climb: rate to look for a lost target from above [m/s].
        highest: where that climb ends [m].
        settled: time the feet must stand [s].
        longest_commit: after this the feet stand, whatever the eyes say [s]: three times the fall.
    """

    stand_height: float = 0.10
    base: float = 0.07
    slope: float = 0.12
    speed: float = 0.35
    sink: float = 0.40
    slow_sink: float = 0.28
    slow_height: float = 0.5
    commit_height: float = 0.13
    commit_error: float = 0.13
    commit_gas: float = 0.90
    sight: float = 0.25
    blind: float = 0.6
    climb: float = 0.3
    highest: float = 1.6
    settled: float = 0.1
    longest_commit: float = 0.8


class Landing:
    """One landing.

    Attributes:
        phase: where it stands.
        down_since: since when the feet stand [s]; infinite before.
    """

    def __init__(self, limits: LandingLimits, estimate: Estimate) -> None:
        self.phase = LandingPhase.APPROACH
        self.down_since = math.inf
        self._limits = limits
        self._height = float(estimate.position[2])
        self._committed = self._low_since = estimate.at

    def goal(self, estimate: Estimate, yaw: float | None, step: float) -> Goal:
        """Decide how to go on, and return where to.

        Args:
            estimate: now.
            yaw: heading to hold [rad]; None for any.
            step: time since the last call [s].
        """
        limits = self._limits
        height = float(estimate.position[2]) - limits.stand_height
        error = float(np.hypot(*estimate.position[:2]))
        speed = float(np.hypot(*estimate.velocity[:2]))
        inside = error < limits.base + limits.slope * max(height, 0.0) and speed < limits.speed
        if self.phase in (LandingPhase.APPROACH, LandingPhase.DESCEND):
            may_commit = (inside and estimate.age < limits.sight) or (
                error < limits.commit_error and estimate.age < limits.blind
            )
            if height < limits.commit_height and may_commit:
                self.phase = LandingPhase.COMMIT
            else:
                descends = inside and estimate.age < limits.sight
                self.phase = LandingPhase.DESCEND if descends else LandingPhase.APPROACH
        climb = self._climb(height, estimate.age, float(estimate.position[2]), step)
        self._settle(height, estimate.at)
        share = {LandingPhase.COMMIT: limits.commit_gas, LandingPhase.DOWN: 0.0}.get(self.phase)
        return Goal(position=np.array([0.0, 0.0, self._height]), yaw=yaw, climb=climb, gas_share=share)

    def _climb(self, height: float, age: float, up: float, step: float) -> float:
        """Move the wanted height; returns its speed [m/s]."""
        limits = self._limits
        if self.phase is LandingPhase.APPROACH:
            if age > 1.6 * limits.sight and up < limits.highest:
                self._height = min(self._height + 0.5 * step, up + 0.3)
                return limits.climb
            self._height = max(self._height, limits.stand_height + 0.25) if height < 0.25 else self._height
            return 0.0
        sink = limits.slow_sink if height < limits.slow_height else limits.sink
        self._height = max(self._height - sink * step, up - 0.10)
        return -sink

    def _settle(self, height: float, at: float) -> None:
        """Notice that the feet stand: throttle that still half carries would let the wind slide the aircraft away."""
        if self.phase is not LandingPhase.COMMIT:
            self._committed = self._low_since = at
            return
        if height > 0.03:
            self._low_since = at
        if at - self._low_since >= self._limits.settled or at - self._committed >= self._limits.longest_commit:
            self.phase, self.down_since = LandingPhase.DOWN, at
