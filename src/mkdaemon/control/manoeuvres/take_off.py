"""Take-off from the ground: throttle rises until an image shows the aircraft above it, then the autopilot climbs.

A camera that stands on its target sees little or nothing of it, so the first centimetres are flown blind, level and
quickly: the wind carries the aircraft out of the camera's cone as fast as slow throttle lets it rise. How much blind
throttle, and for how long, is bounded. Source: docs/control.md, "Take-off".
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import StrEnum
from typing import ClassVar, Final

import numpy as np

from mkdaemon.config.autopilot import AutopilotConfig
from mkdaemon.control.estimator.liftoff import LiftOff
from mkdaemon.control.estimator.values import Estimate
from mkdaemon.control.manoeuvres.by_target import ByTarget, error_value, floating
from mkdaemon.control.manoeuvres.hold import Hold
from mkdaemon.control.manoeuvres.manoeuvre import Manoeuvre, Step, ended, level_at
from mkdaemon.control.regulator.autopilot import Autopilot, Goal, at_origin
from mkdaemon.control.sight import Sight
from mkdaemon.telemetry.control import Outcome
from mkdaemon.telemetry.setpoint import TakeOffSetpoint

IDLE_GAS: Final = 27.0
"""Throttle that carries nothing [count of 254]."""
LIKELY: Final = (0.75, 1.25)
"""Accepted range of the measured hover throttle over the assumed one."""
STRAIGHT_UP: Final = 0.8
"""A take-off climbs straight up to this height: lower, a lean takes the target out of the camera's sight [m]."""
FAR: Final = 1.0
"""To a middle that is farther aside it climbs all the way first, and crosses then: on the edge of a map, a lean at
0.9 m took every tag out of sight [m]."""
OLDEST: Final = 0.6
"""An older image proves nothing [s]: the estimator could not roll back to it, and would fly on from where it was."""

LONGEST_RAMP: Final = 5.0
"""Throttle rises, fails and is cut within this time [s]."""
LONGEST_ARRIVAL: Final = 15.0
"""And twice the time of the way up is what a climb may take [s]: wind, late images or the pilot's throttle may keep it
from arriving for ever."""


class TakeOffPhase(StrEnum):
    """Phase of a take-off; the value is the text shown."""

    IDLE = "idle: the pilot raises his throttle"
    """Lowest throttle; on stock firmware nothing moves while ours is the smaller one."""
    RAMP = "throttle rises"
    """Level, more and more throttle, until images show the aircraft off the ground."""
    CLIMB = "climbs"
    """The autopilot flies to the height asked for; where it takes too long, it is aborted and holds where it is."""
    REACHED = "at height"
    """It holds there."""
    FAILED = "failed"
    """Nothing showed that it lifts off, or it tips over: it is released."""


@dataclass(frozen=True, slots=True)
class TakeOffLimits:
    """Throttle and times.

    Attributes:
        ready: time at the lowest throttle before it rises [s].
        stand_height: of the body origin above the target when the feet stand [m].
        lift: this much higher, the aircraft flies [m].
        rise: of the throttle [share of hover a second]; slower lets the wind carry the aircraft out of sight.
        most: blind throttle ends here [share of hover].
        counts_from: the blind time counts from this throttle on [share of hover], or from the first image in the air.
        blind: longest time above it without an image of a flying aircraft [s].
        steepest: tilt on the ground at which it ends: a foot that sticks tips the aircraft over [rad].
        cut: after that the throttle is at its lowest for this long before the release [s].
    """

    ready: float = 3.0
    stand_height: float = 0.10
    lift: float = 0.06
    rise: float = 2.5
    most: float = 1.25
    counts_from: float = 1.05
    blind: float = 1.2
    steepest: float = 0.26
    cut: float = 1.0

    def rises_for(self, hover_gas: float) -> float:
        """Return how long the throttle rises until the blind time counts, by an assumed hover throttle [s]."""
        return (self.counts_from - IDLE_GAS / hover_gas) / self.rise


class TakeOff:
    """One take-off.

    Attributes:
        phase: where it stands.
        failure: why it failed; None before.
    """

    def __init__(self, limits: TakeOffLimits, hover_gas: float, now: float, *, is_in_air: bool = False) -> None:
        """Begin.

        Args:
            limits: throttle and times.
            hover_gas: assumed hover throttle [count of 254].
            now: [s].
            is_in_air: it flies already, so that only the climb is left.
        """
        self.phase = TakeOffPhase.CLIMB if is_in_air else TakeOffPhase.IDLE
        self.failure: Outcome | None = None
        self._limits = limits
        self._hover_gas = hover_gas
        self._began = now
        self._share = IDLE_GAS / hover_gas
        self._strong_since: float | None = None
        self._cut_left = 0.0
        self._now = now
        self._risen: dict[bool, list[tuple[float, float]]] = {False: [], True: []}

    @property
    def is_blind(self) -> bool:
        """Whether throttle is computed here and not by the autopilot."""
        return self.phase not in (TakeOffPhase.CLIMB, TakeOffPhase.REACHED)

    @property
    def stands(self) -> bool:
        """Whether nothing has shown it off the ground yet. After a failed take-off it is not known whether it flies."""
        return self.phase in (TakeOffPhase.IDLE, TakeOffPhase.RAMP)

    @property
    def is_over(self) -> bool:
        """Whether a failed take-off is to be released."""
        return self.phase is TakeOffPhase.FAILED and self._cut_left <= 0.0

    def gas(self, now: float, step: float, tilt: float) -> float:
        """Go on for a time; the throttle to send [count of 254].

        Args:
            now: [s].
            step: time since the last call [s].
            tilt: largest angle that the boards report, pitch or roll [rad].
        """
        limits, self._now = self._limits, now
        if self.phase is TakeOffPhase.IDLE and now - self._began >= limits.ready:
            self.phase = TakeOffPhase.RAMP
        elif self.phase is TakeOffPhase.RAMP:
            # One image may be wrong; hover throttle neither drops an aircraft that flies nor lifts one that stands.
            self._share = 1.0 if self._has_risen else min(self._share + limits.rise * step, limits.most)
            if self._strong_since is None and (self._has_risen or self._share >= limits.counts_from):
                self._strong_since = now
            if tilt > limits.steepest:
                self.fail(Outcome.TIPPED)
                self._share, self._cut_left = IDLE_GAS / self._hover_gas, limits.cut
            elif self._strong_since is not None and now - self._strong_since > limits.blind:
                self.fail(Outcome.NOT_LIFTED)
        elif self.phase is TakeOffPhase.FAILED:
            self._cut_left -= step
        return self._share * self._hover_gas

    def fail(self, why: Outcome) -> None:
        """End the take-off, if no image has shown the aircraft off the ground: it may fly or stand.

        So the pilot gets it with this throttle: lowering the throttle would drop an aircraft that flies.
        """
        if self.is_blind:
            self.phase, self.failure = TakeOffPhase.FAILED, why

    def seen(self, height: float, at: float, *, is_placed: bool = False) -> tuple[tuple[float, float], ...]:
        """Take the height an image shows; once two in a row show that it flies, return all that show it.

        A source of poses counts by itself: one that is late without saying so does not outvote a camera.

        Args:
            height: of the body origin above the target [m].
            at: when the image was taken [s].
            is_placed: a source of poses shows it.

        Returns:
            When each was taken [s], and the height of the feet [m]; empty while it is not shown.
        """
        limits = self._limits
        if self.phase is not TakeOffPhase.RAMP or self._now - at > OLDEST:
            return ()
        flown = height - limits.stand_height
        risen = self._risen[is_placed]
        if flown <= limits.lift:
            risen.clear()
        elif not risen or at > risen[-1][0]:
            risen.append((at, flown))
        if len(risen) < 2:
            return ()
        self.phase = TakeOffPhase.CLIMB
        return tuple(risen)

    @property
    def _has_risen(self) -> bool:
        """Whether the newest image, or the newest pose of a source, shows it off the ground."""
        return any(self._risen.values())

    def arrived(self) -> None:
        """Note that the aircraft holds at the height asked for."""
        if self.phase is TakeOffPhase.CLIMB:
            self.phase = TakeOffPhase.REACHED


class TakeOffFlight(ByTarget):
    """Takes off, or climbs on in the air, to a height over the middle of the target, and holds there."""

    kind: ClassVar[str] = "takeoff"

    def __init__(self, sight: Sight, cfg: AutopilotConfig, setpoint: TakeOffSetpoint) -> None:
        super().__init__(sight, cfg, setpoint)
        self.take_off: TakeOff | None = None
        self._is_in_air = self._is_up = False

    def enter(self, before: Manoeuvre | None, now: float) -> str:
        """Begin on the ground, or after another manoeuvre by the target, which is climbed on from."""
        self._is_in_air = isinstance(before, ByTarget)
        return super().enter(before, now)

    def height_seen(self, height: float, at: float, *, is_placed: bool = False) -> LiftOff | None:
        """Take the height above the target that an image shows: see `TakeOff.seen` and `lifted_off`."""
        risen = () if self.take_off is None else self.take_off.seen(height, at, is_placed=is_placed)
        low, high = LIKELY
        assumed = self._sight.hover_gas
        return self._sight.lift_off(risen, (low * assumed, high * assumed)) if risen else None

    def step(self, now: float, *, is_flying: bool) -> Step:
        """Decide the sticks; blind until an image shows the aircraft off the ground."""
        sight = self._sight
        if not is_flying:
            self.take_off, self.stepped_at = None, now
            # A setpoint that comes before the first step in flight must find that it stands.
            ground = not self._is_in_air
            return Step(level_at(IDLE_GAS), self.kind, stage=TakeOffPhase.IDLE.value, may_touch=ground)
        if self.take_off is None:
            limits = TakeOffLimits(ready=self._cfg.takeoff_ready, stand_height=self._cfg.stand_height)
            self.take_off = TakeOff(limits, sight.hover_gas, now, is_in_air=self._is_in_air)
        take_off = self.take_off
        if not take_off.is_blind:
            return super().step(now, is_flying=True)
        step = min(max(now - self.stepped_at, 0.005), 0.1)
        self.stepped_at = now
        attitude = sight.attitude
        tilt = 0.0 if attitude is None else max(abs(attitude.pitch), abs(attitude.roll))
        sticks = level_at(take_off.gas(now, step, tilt))
        end = ended(take_off.failure) if take_off.is_over and take_off.failure is not None else None
        shown = Step(sticks, self.kind, stage=take_off.phase.value, longest=self._cfg.takeoff_ready + LONGEST_RAMP)
        return replace(shown, end=end, stands=take_off.stands, may_touch=True)

    def abort(self, now: float) -> Manoeuvre:
        """Hold; a take-off that no image has shown off the ground ends with a release."""
        if self.take_off is not None and self.take_off.is_blind:
            self.take_off.fail(Outcome.TAKE_OFF_ABORTED)
            return self
        return Hold(self._sight, self._cfg)

    def _fly(self, estimate: Estimate, autopilot: Autopilot, now: float, step: float, *, is_flying: bool) -> Step:
        take_off = self.take_off
        assert take_off is not None
        height, here = min(self._wanted.height, self._cfg.fence_height), estimate.position
        goal = at_origin(height)
        error = error_value(self.kind, goal, estimate)
        if self._arrival.has_arrived(goal, estimate, now):
            take_off.arrived()
        is_far = float(np.hypot(*here[:2])) > FAR
        self._is_up |= float(here[2]) >= (height - self._cfg.arrived_within if is_far else STRAIGHT_UP)
        is_low = float(here[2]) < STRAIGHT_UP or (is_far and not self._is_up)
        if is_low and take_off.phase is TakeOffPhase.CLIMB:
            goal = Goal(position=np.array([*(autopilot.reference.position), height]))
        sticks, is_done = floating(autopilot.sticks(goal, now, step)), take_off.phase is TakeOffPhase.REACHED
        longest = LONGEST_ARRIVAL + 2.0 * height / self._cfg.max_climb
        return Step(sticks, self.kind, stage=take_off.phase.value, longest=longest, is_done=is_done, error=error)
