"""Landing on a target that may move: down inside a cone, then through the ground effect without hesitation.

Near the ground the rotors' cushion pushes the aircraft sideways. Therefore, below `commit_height`, the landing is
committed: the throttle falls below hover and stays there until the feet stand. The estimate must have sunk to that
height; a sudden jump does not commit. A fresh image of an aircraft that is high cancels it. Without the final push a
third to two thirds of the landings miss (docs/lab/control.md, "Landing").

A touchdown is final, and needs evidence: a fresh image, or a fall of sufficient length (`Fall`). No message on the line
reports the touchdown. Without an image, `Fall` bounds the time of it: from the highest possible position, with the
slowest possible sink rate, the thrust that was sent and the ground effect, the aircraft must have come down.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import ClassVar, Final

import numpy as np

from mkdaemon.config.autopilot import AutopilotConfig
from mkdaemon.control.estimator.model import GRAVITY, F, ground_effect
from mkdaemon.control.estimator.values import Estimate
from mkdaemon.control.manoeuvres.by_target import ByTarget, error_value, floating
from mkdaemon.control.manoeuvres.hold import Hold
from mkdaemon.control.manoeuvres.manoeuvre import Manoeuvre, Step, ended, level_at
from mkdaemon.control.regulator.autopilot import Autopilot, Goal
from mkdaemon.control.sight import Sight
from mkdaemon.telemetry.control import Outcome

DEVIATIONS: Final = 3.0
"""The aircraft is no higher than this many standard deviations above its estimate."""
CLIMB_DOUBT: Final = 0.15
"""It sinks slower than estimated by this at most [m/s]."""
THRUST_DOUBT: Final = 1.08
"""Its thrust is larger than estimated by this factor at most: 4 % of hover throttle."""

LONGEST_WAIT: Final = 60.0
"""A wait that is longer by this than it should be widens nothing more [s]: by then nothing is asked for."""


class Fall:
    """A fall from a commit on.

    Attributes:
        height: largest height of the feet above the ground that is possible now [m].
        climb: largest climb rate that is possible now [m/s].
    """

    def __init__(self, height: float, climb: float, height_sd: float) -> None:
        """Begin.

        Args:
            height: estimated, of the feet above the ground [m].
            climb: estimated [m/s].
            height_sd: standard deviation of the height [m].
        """
        self.height = height + DEVIATIONS * height_sd
        self.climb = climb + CLIMB_DOUBT

    def has_ended(self, thrust: float, step: float) -> bool:
        """Go on for a time; whether the aircraft stands, wherever it began.

        Args:
            thrust: that the motors give, out of the cushion [share of the weight].
            step: [s].
        """
        lift = thrust * THRUST_DOUBT * float(ground_effect(self.height))
        self.climb += GRAVITY * (lift - 1.0) * step
        self.height += self.climb * step
        return self.height <= 0.0


class LandingPhase(StrEnum):
    """Phase of a landing."""

    APPROACH = "approach"
    """Over the target, waiting until it is inside the cone."""
    DESCEND = "descend"
    """Inside the cone, sinking."""
    COMMIT = "commit"
    """Too low to change its mind, unless fresh images show that it is not."""
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
        commit_sd: largest standard deviation of the height at which to commit [m].
        leap: nothing is decided this far below the wanted height, which sinks no faster than the aircraft can [m].
        refuted: a fresh image of the feet this high above the ground takes the commit back [m].
        commit_gas: throttle while committed [share of hover].
        push_after: time of the commit after which throttle goes down further [s].
        push: by how much [share of hover a second].
        least_gas: where that ends [share of hover]; attitude control fades with throttle.
        sight: oldest image with which to descend [s].
        blind: oldest image with which to commit [s].
        climb: rate to look for a lost target from above [m/s].
        highest: where that climb ends [m].
        touch_age: oldest image that shows whether the feet stand [s].
        touch_height: lower than this they stand, where an image shows it [m].
        settled: time the feet must stand [s].
        pad_radius: a touchdown farther from the middle is not on the target [m].
        patience: longest wait for the conditions above [s].
        yielding: then every tolerance doubles each time after this wait [s]: no landing waits until the battery is
            empty.
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
    commit_sd: float = 0.05
    leap: float = 0.5
    refuted: float = 0.26
    commit_gas: float = 0.90
    push_after: float = 0.3
    push: float = 1.0
    least_gas: float = 0.6
    sight: float = 0.25
    blind: float = 0.6
    climb: float = 0.3
    highest: float = 1.6
    touch_age: float = 0.15
    touch_height: float = 0.03
    settled: float = 0.1
    pad_radius: float = 0.35
    patience: float = 12.0
    yielding: float = 4.0


class Landing:
    """One landing.

    Attributes:
        phase: where it stands.
        down_since: since when the feet stand [s]; infinite before.
        is_on_target: they stand on the target, as far as the estimate could tell when they touched.
        longest: how long it may last [s]: until every condition is so wide that it commits, and the way down.
    """

    def __init__(self, limits: LandingLimits, estimate: Estimate) -> None:
        self.phase = LandingPhase.APPROACH
        self.down_since = math.inf
        self.is_on_target = False
        self._limits = limits
        self._height = float(estimate.position[2])
        self._committed = self._up_at = estimate.at
        self._fall: Fall | None = None
        self._waited = 0.0
        self.longest = limits.patience + LONGEST_WAIT + self._height / limits.slow_sink

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
        width = self._width(height, step)
        cone = width * (limits.base + limits.slope * max(height, 0.0))
        inside = error < cone and speed < width * limits.speed
        if self.phase in (LandingPhase.APPROACH, LandingPhase.DESCEND):
            may_commit = error < width * limits.commit_error and estimate.age < width * limits.blind
            is_certain = float(estimate.position_sd[2]) < width * limits.commit_sd
            has_sunk = self._height - float(estimate.position[2]) < width * limits.leap
            if height < limits.commit_height and may_commit and is_certain and has_sunk:
                self.phase = LandingPhase.COMMIT
                self._committed = self._up_at = estimate.at
                self._fall = Fall(height, float(estimate.velocity[2]), float(estimate.position_sd[2]))
            else:
                descends = inside and estimate.age < width * limits.sight
                self.phase = LandingPhase.DESCEND if descends else LandingPhase.APPROACH
        elif self.phase is LandingPhase.COMMIT and self._is_refuted(estimate, height):
            self.phase, self._height = LandingPhase.APPROACH, float(estimate.position[2])
        climb = self._climb(height, estimate.age / width, float(estimate.position[2]), step)
        if self.phase is LandingPhase.COMMIT:
            self._settle(estimate, height, error, step)
        share = self._commit_gas(estimate.at) if self.phase is LandingPhase.COMMIT else None
        return Goal(position=np.array([0.0, 0.0, self._height]), yaw=yaw, climb=climb, gas_share=share)

    def approach_again(self, height: float) -> None:
        """Begin the approach once more at a height above the target [m]."""
        self.phase, self._height = LandingPhase.APPROACH, height

    def _is_refuted(self, estimate: Estimate, height: float) -> bool:
        """Whether an image shows the aircraft higher than estimated when the landing was committed."""
        is_high = height - DEVIATIONS * float(estimate.position_sd[2]) > self._limits.refuted
        return is_high and estimate.age <= self._limits.touch_age

    def _width(self, height: float, step: float) -> float:
        """How much wider its conditions are than they should be: 1 until it has waited for too long.

        It waits while it does not sink, or has come so low that it should commit.
        """
        limits = self._limits
        if self.phase is not LandingPhase.DESCEND or height < limits.commit_height:
            self._waited += step
        late = min(self._waited - limits.patience, LONGEST_WAIT)
        return math.exp2(max(0.0, late / limits.yielding))

    def _commit_gas(self, at: float) -> float:
        """Throttle of the commit [share of hover]: less and less where the aircraft hangs on its cushion."""
        limits = self._limits
        late = max(0.0, at - self._committed - limits.push_after)
        return max(limits.least_gas, limits.commit_gas - limits.push * late)

    def _climb(self, height: float, age: float, up: float, step: float) -> float:
        """Move the wanted height; returns its speed [m/s]. A stage that waits for longer takes `age` for less."""
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

    def _settle(self, estimate: Estimate, height: float, error: float, step: float) -> None:
        """Notice that the feet stand: throttle that still half carries would let the wind slide the aircraft away.

        The model knows no ground, so a predicted height goes on falling: it is no evidence.
        """
        limits = self._limits
        assert self._fall is not None
        has_fallen = self._fall.has_ended(1.0 + float(estimate.vertical[F]), step)
        is_seen_down = estimate.age <= limits.touch_age and height <= limits.touch_height
        if not (has_fallen or is_seen_down):
            self._up_at = estimate.at
        if estimate.at - self._up_at >= limits.settled:
            self.phase, self.down_since = LandingPhase.DOWN, estimate.at
            spread = float(np.hypot(*estimate.position_sd[:2]))
            self.is_on_target = error + 2.0 * spread < limits.pad_radius


class Land(ByTarget):
    """Descends onto the target; once committed or standing, it ignores vision."""

    kind: ClassVar[str] = "land"
    is_timed_whole: ClassVar[bool] = True

    def __init__(self, sight: Sight, cfg: AutopilotConfig, yaw: float | None = None) -> None:
        """Land with a heading [rad], None for any."""
        super().__init__(sight, cfg)
        self.landing: Landing | None = None
        self._yaw = yaw

    def abort(self, now: float) -> Manoeuvre:
        """Hold; below its last decision a landing goes on."""
        return self if self._flies_blind() else Hold(self._sight, self._cfg)

    def _flies_blind(self) -> bool:
        return self.landing is not None and self.landing.phase in (LandingPhase.COMMIT, LandingPhase.DOWN)

    def _found(self, height: float) -> None:
        """Approach the target once more, from where the search has led."""
        if self.landing is not None:
            self.landing.approach_again(height)

    def step(self, now: float, *, is_flying: bool) -> Step:
        """Decide the sticks; once the feet stand they follow from no estimate."""
        if self.landing is not None and self.landing.phase is LandingPhase.DOWN:
            self.stepped_at = now
            return self._stand(self.landing, now)
        step = super().step(now, is_flying=is_flying)
        return step if self.landing is None else replace(step, longest=self.landing.longest)

    def _stand(self, landing: Landing, now: float) -> Step:
        """Level at the lowest throttle, until the aircraft has stood long enough to be released."""
        how = Outcome.LANDED if landing.is_on_target else Outcome.LANDED_ASIDE
        has_stood = now - landing.down_since >= self._cfg.stand_time
        end = ended(how, target=self._sight.target) if has_stood else None
        return Step(
            level_at(0.0), self.kind, stage=landing.phase.value, is_done=True, end=end, stands=True, may_touch=True
        )

    def _fly(self, estimate: Estimate, autopilot: Autopilot, now: float, step: float, *, is_flying: bool) -> Step:
        if not is_flying:
            return Step(
                floating(autopilot.sticks(Goal(position=estimate.position, yaw=self._yaw), now, step)), self.kind
            )
        landing = self.landing = self.landing or Landing(LandingLimits(stand_height=self._cfg.stand_height), estimate)
        goal = landing.goal(estimate, self._yaw, step)
        if landing.phase is LandingPhase.DOWN:
            return self._stand(landing, now)
        error = error_value(self.kind, goal, estimate)
        sticks, stage = floating(autopilot.sticks(goal, now, step)), landing.phase.value
        self._sight.hover_gas = estimate.hover_gas
        if landing.phase is LandingPhase.COMMIT or estimate.age <= self._cfg.level_after:
            may_touch = landing.phase is LandingPhase.COMMIT
            return Step(sticks, self.kind, stage=stage, error=error, may_touch=may_touch)
        level = Step(level_at(estimate.hover_gas), self.kind, stage=stage, is_level=True)
        return replace(level, end=self._lost_sight(estimate), error=error)
