"""Flies along a path that was uploaded.

The aircraft flies to where the path's clock stands, and settles there. Then the clock runs, and the reference is the
path itself: position, velocity and acceleration, seen ahead. The clock slows down smoothly for a pause, and where the
aircraft falls behind, so that it never has to catch up.
"""

from __future__ import annotations

import math
from typing import ClassVar, Final

import numpy as np

from mkdaemon.config.autopilot import AutopilotConfig
from mkdaemon.control.estimator.values import Estimate
from mkdaemon.control.manoeuvres.by_target import ByTarget, error_value, floating
from mkdaemon.control.manoeuvres.hold import Hold
from mkdaemon.control.manoeuvres.manoeuvre import Manoeuvre, Step
from mkdaemon.control.path.curve import PathCurve
from mkdaemon.control.regulator.autopilot import Autopilot, Goal
from mkdaemon.control.regulator.horizontal import PREVIEW, STEP
from mkdaemon.control.regulator.reference import BRAKING, KnownCourse
from mkdaemon.control.sight import Sight, triple
from mkdaemon.telemetry.path import PathProgress
from mkdaemon.telemetry.setpoint import PathSetpoint

APPROACHES: Final = "flies to the path"
"""Stage before it begins, and after a search."""
FOLLOWS: Final = "follows the path"
"""Stage while the clock runs."""
PAUSES: Final = "paused on the path"
"""Stage while its holder has paused it."""
ENDED: Final = "at the end of the path"
"""Stage when the clock has reached the end."""
APPROACH: Final = 60.0
"""Longest way to the path [s]; across a fence of 5 m it takes 12."""
SLOWEST: Final = 3.0
"""A flight along the path takes at most this many times its duration, and `APPROACH`."""
BEHIND: Final = 0.25
"""Up to this distance from where it should be the aircraft follows at full speed [m]; twice what gusts of 2 m/s do."""
STOPS: Final = 0.6
"""From this distance on the clock stands [m]: as far as the regulator looks, `HorizontalCosts.reach`."""
QUICKEST: Final = 1.5
"""Largest change of the clock's rate [1/s], where the path is slow."""


class PathClock:
    """The time along a path, which runs at 0 to 1 times the time of day.

    Attributes:
        at: where it stands [s].
        rate: how fast it runs.
    """

    def __init__(self, curve: PathCurve, acceleration: float) -> None:
        """Stand at the beginning; a change of rate changes the speed by at most `acceleration` [m/s2]."""
        self.at = self.rate = self._slope = 0.0
        self._curve, self._acceleration = curve, acceleration

    @property
    def has_ended(self) -> bool:
        """Whether it stands at the end."""
        return self.at >= self._curve.duration

    def stop(self) -> None:
        """Stand where it is, at once: the aircraft is not on the path."""
        self.rate = self._slope = 0.0

    def move(self, wanted: float, step: float) -> KnownCourse:
        """Go on for a time [s] towards a wanted rate.

        Returns:
            The path there, and ahead with that wanted rate.
        """
        before = self._slope
        speed = float(np.linalg.norm(self._curve.at(np.array([self.at])).velocity[0, :3]))
        quickest = min(QUICKEST, self._acceleration / max(speed, 1e-3))
        self._slope = _towards(wanted, self.rate, quickest, step)
        self.at = min(self.at + (self.rate + 0.5 * self._slope * step) * step, self._curve.duration)
        self.rate += self._slope * step
        return self._course(wanted, quickest, before)

    def _course(self, wanted: float, quickest: float, slope: float) -> KnownCourse:
        """What is seen from here.

        Accelerations are those of the steps before each of the next boundaries, as those of `Reference.jumps_ahead`.
        """
        times, rates, slopes = [self.at], [self.rate], [slope]
        for _ in range(PREVIEW):
            slopes.append(_towards(wanted, rates[-1], quickest, STEP))
            times.append(times[-1] + (rates[-1] + 0.5 * slopes[-1] * STEP) * STEP)
            rates.append(rates[-1] + slopes[-1] * STEP)
        ends, rate, slope_of = np.array(times), np.array(rates)[:, None], np.array(slopes)[:, None]
        at = self._curve.at(ends)
        between = self._curve.at(np.where(ends < self._curve.duration, ends - 0.5 * rate[:, 0] * STEP, ends))
        velocity = at.velocity * rate
        acceleration = between.acceleration * rate**2 + between.velocity * slope_of
        return KnownCourse(
            at.position[0, :3],
            velocity[0, :3],
            acceleration[0, :3],
            np.diff(acceleration[:, :2], axis=0),
            np.diff(velocity[:, :2], axis=0),
        )


def _towards(wanted: float, rate: float, quickest: float, step: float) -> float:
    """Change of a rate towards a wanted one in a step [1/s]."""
    return min(max((wanted - rate) / step, -quickest), quickest)


def rate_behind(away: float) -> float:
    """How fast the clock of a path is to run; `away` is the distance from where the aircraft should be [m]."""
    return min(max((STOPS - away) / (STOPS - BEHIND), 0.0), 1.0)


class FollowPath(ByTarget):
    """Follows a path in the axes of the target."""

    kind: ClassVar[str] = "path"

    def __init__(self, sight: Sight, cfg: AutopilotConfig, setpoint: PathSetpoint) -> None:
        super().__init__(sight, cfg, setpoint)
        self._begin()

    def _begin(self) -> None:
        """Stand at the beginning of the wanted path; admission has seen that it is stored."""
        self._path = self._sight.paths.find(self._wanted.path)
        self._clock = PathClock(self._path.curve, BRAKING * self._cfg.max_acceleration)
        self._on_path: Autopilot | None = None

    def enter(self, before: Manoeuvre | None, now: float) -> str:
        """Begin, or go on where the same flight stood before its sticks had no answer."""
        if isinstance(before, FollowPath) and before.flight == self.flight:
            self._clock = before._clock  # noqa: SLF001  # the same class
        return super().enter(before, now)

    @property
    def flight(self) -> tuple[str, int]:
        """Path and run: another flight has others."""
        return self._wanted.path, self._wanted.run

    def follow(self, setpoint: PathSetpoint) -> None:
        """Take the newest setpoint; another path, or another run, begins at its first point."""
        before = self.flight
        super().follow(setpoint)
        if self.flight != before:
            self._begin()

    def abort(self, now: float) -> Manoeuvre:
        """Hold where it comes to rest."""
        return Hold(self._sight, self._cfg)

    def _found(self, height: float) -> None:
        """Return to the path after a search."""
        self._on_path = None

    def _fly(self, estimate: Estimate, autopilot: Autopilot, now: float, step: float, *, is_flying: bool) -> Step:
        clock, curve = self._clock, self._path.curve
        if self._on_path is not autopilot:
            clock.stop()
            goal = self._goal(clock.at)
            course = None
        else:
            # The course is where the aircraft should be when the sticks act; now it should be where it was before.
            goal = self._goal(clock.at - clock.rate * autopilot.estimator.model.uplink)
            away = math.dist(triple(estimate.position), triple(goal.position))
            course = clock.move(self._rate(estimate, away), step)
        is_seen = is_flying and estimate.age <= self._cfg.freeze_after
        has_arrived = is_seen and self._arrival.has_arrived(goal, estimate, now)
        if course is None and has_arrived:
            self._on_path = autopilot
        flown = Goal(position=goal.position, yaw=goal.yaw, course=course)
        if course is None and not is_seen:
            flown = Goal(position=np.array([*autopilot.reference.position, float(estimate.position[2])]))
        sticks = floating(autopilot.sticks(flown, now, step))
        stage, longest = self._stage(is_on_path=course is not None)
        return Step(
            sticks,
            self.kind,
            stage=stage,
            longest=longest,
            is_done=has_arrived and clock.has_ended and course is not None,
            error=error_value(self.kind, goal, estimate),
            path=self._progress(stage, curve),
        )

    def _goal(self, at: float) -> Goal:
        """Where to be at a time of the path [s]."""
        place = self._path.curve.at(np.array([at])).position[0]
        yaw = math.remainder(float(place[3]), math.tau) if self._path.curve.turns else None
        return Goal(position=self._inside_fence(place[:3]), yaw=yaw)

    def _rate(self, estimate: Estimate, away: float) -> float:
        """How fast the clock is to run, at a distance from where the aircraft should be [m]."""
        if self._wanted.paused or estimate.age > self._cfg.freeze_after:
            return 0.0
        return rate_behind(away)

    def _stage(self, *, is_on_path: bool) -> tuple[str, float]:
        """Where it stands, and how long it may stand there [s]."""
        if not is_on_path:
            return APPROACHES, APPROACH
        if self._clock.has_ended:
            return ENDED, APPROACH
        if self._wanted.paused:
            return PAUSES, math.inf
        return FOLLOWS, SLOWEST * self._path.curve.duration + APPROACH

    def _progress(self, stage: str, curve: PathCurve) -> PathProgress:
        return PathProgress(
            id=self._path.answer.id,
            target=self._sight.target,
            stage=stage,
            is_paused=self._wanted.paused,
            progress=self._clock.at / curve.duration,
            left=curve.duration - self._clock.at,
            rate=self._clock.rate,
            points=self._path.drawn,
        )
