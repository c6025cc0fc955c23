"""Flies to a position in the frame of a target: estimate, reference, regulators, whole counts.

Whole counts from wanted numbers: what rounding leaves over is added to the next one.

A count of tilt is 0.45 deg, 8 cm/s2: rounding alone would shake a hover by centimetres. Source: error feedback
quantisation, e.g. S. Norsworthy et al., "Delta-Sigma Data Converters" (1997), first order.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from mkdaemon.control.estimator.estimator import Estimator
from mkdaemon.control.estimator.values import GAS_CENTRE, Estimate
from mkdaemon.control.limiter import StickCounts
from mkdaemon.control.linear import Array
from mkdaemon.control.regulator.horizontal import PREVIEW, STEP, HorizontalCosts, HorizontalRegulator
from mkdaemon.control.regulator.reference import KnownCourse, Reference, ReferenceLimits
from mkdaemon.control.regulator.vertical import VerticalGains, gas


class CountShaper:
    """One axis of sticks."""

    def __init__(self, lowest: int, highest: int) -> None:
        self._lowest = lowest
        self._highest = highest
        self._rest = 0.0

    def count(self, wanted: float) -> int:
        """Return the count to send for a wanted number of counts; bounded, the rest carried over is below one."""
        total = wanted + self._rest
        count = min(max(round(total), self._lowest), self._highest)
        self._rest = min(max(total - count, -1.0), 1.0)
        return count


UNKNOWN_SPEED: Final = 0.25
"""A flight begins with a reference that rests on the estimate, until the speed is known to this [m/s]."""
LEAP: Final = 12.0
"""While the pilot's throttle caps ours, we ask for this much more than the throttle in use, or for hover
[count of 254]. It is a fifth of the weight, with which the aircraft rises when a cap ends that carries it, and more
than `throttlelid.MARGIN`, so that the cap stays visible. Under a cap that carries nothing the aircraft sinks to the
ground, and must not rise from there when the cap ends."""
RECENTRED: Final = 0.02
"""Share of the unexplained vertical acceleration that goes into the hover throttle at each call: a second at 50 Hz."""
YAW_TOLERANCE: Final = math.radians(4.0)
"""Heading error that is left alone: the compass of the FlightCtrl holds the heading meanwhile."""
YAW_LEAST: Final = 8.0
"""Smallest yaw stick that unlocks that compass [stick]; 5 to 7 creep against it; docs/firmware-notes.md."""
YAW_MOST: Final = 28.0
"""Largest yaw stick [stick]: 10 deg/s, slow enough for the tilts to follow."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Goal:
    """Goal in the frame of the target.

    Attributes:
        position: (3,) [m].
        yaw: heading of the forward axis [rad]; None for whatever it is.
        yaw_rate: turn at this rate where there is no heading, nose left positive [rad/s].
        climb: speed of the wanted height, which is then used directly, without a reference trajectory [m/s].
        speed: largest horizontal speed on the way [m/s]; None for the autopilot's own limit.
        gas_share: throttle in place of the height's regulator [share of hover]; None for the regulator.
        course: moves the reference in place of the position, if the speed is known; None for the position.
    """

    position: Array
    yaw: float | None = None
    yaw_rate: float = 0.0
    climb: float = 0.0
    speed: float | None = None
    gas_share: float | None = None
    course: KnownCourse | None = None


class Autopilot:
    """One flight against one target.

    Attributes:
        estimator: of position and velocity.
        reference: where the aircraft should be now.
        estimate: what the latest sticks were computed from.
    """

    def __init__(
        self,
        estimator: Estimator,
        *,
        costs: HorizontalCosts,
        gains: VerticalGains,
        level_limits: ReferenceLimits,
        height_limits: ReferenceLimits,
        estimate: Estimate,
    ) -> None:
        """Begin where an estimate has the aircraft, climbing as it climbs.

        Raises:
            ValueError: the costs stabilise nothing on this model.
        """
        self.estimator = estimator
        self._gains = gains
        self._level_limits = level_limits
        self._height_limits = height_limits
        known = estimator.model
        self._regulators = {
            model.stick_filter: HorizontalRegulator(model, costs) for model in (known, known.with_other_filter())
        }
        self._pitch, self._roll = CountShaper(-127, 127), CountShaper(-127, 127)
        self._throttle = CountShaper(-127, 127)
        self._asked = 0
        self.estimate = estimate
        self._is_speed_known = False
        self.reference = Reference(estimate.position[:2], estimate.velocity[:2])
        self.height = self._level_with(estimate)

    def sticks(self, goal: Goal, now: float, step: float = STEP) -> StickCounts:
        """Return the sticks to send now.

        Args:
            goal: where to go.
            now: [s; monotonic].
            step: time since the last call [s].
        """
        estimator = self.estimator
        estimator.advance(now)
        limits = self._level_limits
        if goal.speed is not None:
            limits = ReferenceLimits(min(goal.speed, limits.speed), limits.acceleration)
        estimate = self.estimate = estimator.estimate(now + estimator.model.uplink)
        if not self._is_speed_known:
            self.reference = Reference(estimate.position[:2], estimate.velocity[:2])
            self.height = self._level_with(estimate)
            self._is_speed_known = estimator.velocity_sd <= UNKNOWN_SPEED
        elif goal.course is None:
            self.reference.move(goal.position[:2], limits, step)
        if goal.course is not None and self._is_speed_known:
            return self._along(goal, goal.course)
        if goal.climb:
            self.height = Reference(goal.position[2:], np.array([goal.climb]))
        else:
            self.height.move(goal.position[2:], self._height_limits, step)
        jumps = self.reference.jumps_ahead(goal.position[:2], limits, STEP, PREVIEW) if self._is_speed_known else None
        return self._counts(goal, jumps)

    def _along(self, goal: Goal, course: KnownCourse) -> StickCounts:
        """Return the sticks that follow a course."""
        level, height = slice(0, 2), slice(2, 3)
        self.reference, self.height = (
            Reference(course.position[axes], course.velocity[axes], course.acceleration[axes])
            for axes in (level, height)
        )
        return self._counts(goal, course.jumps, course.gains)

    def _counts(self, goal: Goal, jumps: Array | None, gains: Array | None = None) -> StickCounts:
        """Return the sticks for the references, with what is seen ahead of them."""
        estimator, estimate = self.estimator, self.estimate
        rad_per_count = estimator.model.rad_per_count * estimator.stick_gain
        regulator = self._regulators[estimator.model.stick_filter]
        tilt = regulator.tilt(estimate, self.reference, jumps, gains) / rad_per_count
        c, s = math.cos(estimate.yaw), math.sin(estimate.yaw)
        return StickCounts(
            pitch=self._pitch.count(float(tilt[0] * c + tilt[1] * s)),
            roll=self._roll.count(float(tilt[0] * s - tilt[1] * c)),
            yaw=self._yaw_stick(goal),
            throttle=self._throttle_stick(goal),
        )

    def _level_with(self, estimate: Estimate) -> Reference:
        """Return a height reference that climbs as the aircraft does, but no faster than it may.

        From a faster one it would brake as gently as it moves, 0.8 m/s^2: over 3.6 m after a take-off by late images
        that climbs at 2.4 m/s.
        """
        fastest = self._height_limits.speed
        return Reference(estimate.position[2:], np.clip(estimate.velocity[2:], -fastest, fastest))

    def _throttle_stick(self, goal: Goal) -> int:
        """Return the throttle for the height, or for what the goal says; where ours cannot act, not much more."""
        estimator, estimate = self.estimator, self.estimate
        if goal.gas_share is None:
            wanted = gas(estimate, float(self.height.position[0]), float(self.height.velocity[0]), self._gains)
            estimator.recentre_hover(RECENTRED, self._asked + GAS_CENTRE)
        else:
            wanted = goal.gas_share * estimate.hover_gas
        cap = estimator.throttle_cap
        if cap is not None:
            wanted = min(wanted, max(cap + LEAP, estimate.hover_gas))
        self._asked = self._throttle.count(wanted - GAS_CENTRE)
        return self._asked

    def _yaw_stick(self, goal: Goal) -> int:
        """Return the yaw stick for a heading, or a rate that the tilts can follow [stick]."""
        if goal.yaw is not None or not goal.yaw_rate:
            return yaw_stick(self.estimate, goal.yaw)
        wanted = self.estimator.model.yaw_stick(goal.yaw_rate)
        return round(math.copysign(min(max(abs(wanted), YAW_LEAST), YAW_MOST), goal.yaw_rate))


def yaw_stick(estimate: Estimate, yaw: float | None) -> int:
    """Return the yaw stick that turns towards a heading; nose left positive [stick]."""
    error = 0.0 if yaw is None else math.remainder(yaw - estimate.yaw, math.tau)
    if abs(error) <= YAW_TOLERANCE:
        return 0
    return round(math.copysign(min(YAW_LEAST + math.degrees(abs(error)) * 0.7, YAW_MOST), error))


def at_origin(height: float) -> Goal:
    """A goal above the middle of the target [m]."""
    return Goal(position=np.array([0.0, 0.0, height]))
