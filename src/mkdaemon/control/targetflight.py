"""Flight against a target that the cameras see: every kind of setpoint that needs an estimate.

It owns the estimator and the autopilot: poses, attitudes and the sticks that were sent come in, and setpoints turn into
sticks. While the target is out of sight the ladder of docs/safety.md rules: dead reckoning, level, then the failure
that ends the flight.
"""

from __future__ import annotations

import math
from collections import deque
from typing import Final

import numpy as np

from mkdaemon.config.autopilot import AutopilotConfig
from mkdaemon.control.estimator.estimator import Estimator
from mkdaemon.control.estimator.model import AircraftModel
from mkdaemon.control.estimator.values import GAS_CENTRE, Estimate, StickCommand, TargetView, ThrottleUse
from mkdaemon.control.guidance.autopilot import Autopilot, Goal, at_origin
from mkdaemon.control.guidance.landing import Landing, LandingLimits, LandingPhase
from mkdaemon.control.guidance.takeoff import IDLE_GAS, TakeOff, TakeOffLimits, TakeOffPhase
from mkdaemon.control.limiter import StickCounts
from mkdaemon.control.setpoints import Guided, landing_of
from mkdaemon.control.targetgoals import (
    Arrival,
    Goals,
    error_value,
    estimate_value,
    floating,
    ground_obstacle,
    guide_attitude,
    level_at,
    new_autopilot,
    obstacle,
    velocity_between,
    view_of,
)
from mkdaemon.control.vehicle import VehicleFacts
from mkdaemon.telemetry.control import ErrorValue, EstimateValue
from mkdaemon.telemetry.refusals import Token, refuse
from mkdaemon.telemetry.setpoint import (
    AttitudeSetpoint,
    HoldSetpoint,
    LandSetpoint,
    Setpoint,
    SetpointFrame,
    StickSetpoint,
    TakeOffSetpoint,
)
from mkdaemon.telemetry.state import Attitude
from mkdaemon.telemetry.vision import VisionPose

ATTITUDE_LATENCY: Final = 0.024
"""How old an attitude is when it arrives [s]: the board's frame time and half the radio's latency; docs/control.md."""
SHOWN: Final = 1.13
"""What a FlightCtrl reports over the angle that its sticks ask for; docs/control.md, "The attitude loop"."""
FORGOTTEN: Final = 5.0
"""A target out of sight for longer is met anew [s]."""
SENT_KEPT: Final = 50
"""Stick frames that an estimate begun in flight learns of: one second of them."""
JUST_STOOD: Final = 0.5
"""A take-off follows its first setpoint, that of an aircraft that stands, within this time [s]."""
STRAIGHT_UP: Final = 0.8
"""A take-off climbs straight up to this height: lower, a lean takes the target out of the camera's sight [m]."""
_NO_TARGET: Final = "a target in sight"


class TargetFlight:
    """Guidance of every kind of setpoint that needs an estimate.

    Attributes:
        target: name of the target that is followed; empty before the first.
        landing: the landing that is flown; None outside one.
        take_off: the take-off that is flown; None outside one.
        error: how far the aircraft is from its goal; None without a goal.
        model: what is believed of the aircraft.
        guided_at: when sticks last followed from what images showed [s].
    """

    def __init__(self, cfg: AutopilotConfig, hover_throttle: float) -> None:
        """Prepare; nothing is estimated before the first pose.

        Args:
            cfg: limits and entry conditions.
            hover_throttle: first guess of the throttle that carries the aircraft [stick from the centre].
        """
        self.target = ""
        self.landing: Landing | None = None
        self.take_off: TakeOff | None = None
        self.error: ErrorValue | None = None
        self._cfg = cfg
        self._arrival = Arrival(cfg.arrived_within, cfg.arrived_for)
        self._hover_gas = hover_throttle + GAS_CENTRE
        self._goals = Goals(cfg)
        self.model = AircraftModel()
        self._estimator: Estimator | None = None
        self._autopilot: Autopilot | None = None
        self._attitude: Attitude | None = None
        self._last_view: TargetView | None = None
        self._sent: deque[StickCommand] = deque(maxlen=SENT_KEPT)
        self._clean_since, self.guided_at, self._stood_at = math.inf, -math.inf, -math.inf

    def model_known(self, model: AircraftModel) -> None:
        """Take the model of the aircraft's own parameter set; the estimate begins anew with it."""
        if model != self.model:
            self.model = model
            self._estimator = self._autopilot = None

    def pose_received(self, pose: VisionPose, now: float) -> None:
        """Take a pose that arrives now [s]; the first target is followed until it has been out of sight for long."""
        view, known = view_of(pose), self._estimator
        is_other = bool(self.target) and pose.target != self.target
        lifted_by = None
        if self.take_off is not None and not is_other:
            lifted_by = self.take_off.seen(-float(view.position_flu[2]), view.at)
        if known is None or view.at - known.seen_at > FORGOTTEN or lifted_by is not None:
            # What was believed of an aircraft that stood on the ground says nothing about its throttle.
            compass = 0.0 if self._attitude is None else self._attitude.yaw
            velocity = None if is_other else velocity_between(self._last_view, view)
            self._estimator = Estimator(
                self.model, view, lifted_by or self._hover_gas, compass=compass, velocity=velocity
            )
            for command in self._sent if lifted_by is not None else ():
                self._estimator.sent(command)
            self.target, self._autopilot, self._clean_since = pose.target, None, view.at
        elif pose.target == self.target:
            known.target_seen(view)
            if known.innovation > self._cfg.clean_innovation:
                self._clean_since = view.at
        if pose.target == self.target and (is_other or self._last_view is None or view.at >= self._last_view.at):
            self._last_view = view

    def attitude_received(self, attitude: Attitude) -> None:
        """Take the attitude the boards report."""
        self._attitude = attitude
        if self._estimator is not None:
            at = attitude.stamp.monotonic - ATTITUDE_LATENCY
            scale = SHOWN if attitude.source.startswith("fc/") else 1.0
            self._estimator.attitude_received(at, attitude.pitch / scale, attitude.roll / scale, attitude.yaw)

    def sticks_made(self, counts: StickCounts, use: ThrottleUse, now: float) -> None:
        """Take note of a stick frame that goes out now [s], and of what becomes of its throttle."""
        command = StickCommand(now, counts.pitch, counts.roll, counts.yaw, counts.throttle + GAS_CENTRE, use)
        self._sent.append(command)
        if self._estimator is not None:
            self._estimator.sent(command)

    def is_in_sight(self, now: float) -> bool:
        """Whether a target has been seen lately enough to hold or land by it."""
        return self._estimator is not None and now - self._estimator.seen_at <= self._cfg.level_after

    def pose_age(self, now: float) -> float | None:
        """Time since the newest image of the target that is followed [s]; None where there was none."""
        return None if self._last_view is None else now - self._last_view.at

    @property
    def contradicting(self) -> tuple[str, ...]:
        """Cameras whose images contradict those of others."""
        return () if self._estimator is None else self._estimator.contradicting

    def estimate(self, now: float) -> EstimateValue | None:
        """Return what is believed now, as it is published; None before the first pose."""
        return None if self._estimator is None else estimate_value(self.target, self._estimator, now)

    # -- guidance -------------------------------------------------------------------------------------------------

    def check(self, setpoint: Setpoint) -> None:
        """Refuse a setpoint that cannot be followed at all; see `Guidance.check`."""
        if isinstance(setpoint, AttitudeSetpoint | TakeOffSetpoint):
            return
        frame = getattr(setpoint, "frame", SetpointFrame.PAD)
        if frame is SetpointFrame.HOME:
            raise refuse(Token.NO_FRAME, name=setpoint.suffix, frame=frame.value)
        if self._estimator is None:
            raise refuse(Token.NO_ESTIMATE, name=setpoint.suffix)

    def guide(self, setpoint: Setpoint, facts: VehicleFacts, now: float, *, is_flying: bool) -> Guided:
        """Return what the setpoint asks for; see `Guidance.guide`."""
        self.error = None
        if isinstance(setpoint, AttitudeSetpoint):
            gas = self._hover_gas if self._estimator is None else self._estimator.hover_gas
            return guide_attitude(setpoint, self.model, gas, self._cfg.neutral_band)
        step = min(max(now - self.guided_at, 0.005), 0.1) if is_flying else 0.02
        self.guided_at = now
        if isinstance(setpoint, TakeOffSetpoint):
            if not is_flying:
                self.take_off = self._autopilot = None
                self._stood_at = now
                return Guided(level_at(IDLE_GAS), self._ground_obstacle(facts, now), stage=TakeOffPhase.IDLE.value)
            blind = self._lift(now, step)
            if blind is not None:
                return blind
        else:
            self.take_off = None
        estimator = self._estimator
        if estimator is None:
            return Guided(level_at(self._hover_gas), _NO_TARGET, "no target in sight")
        estimator.advance(now)
        estimate = estimator.estimate(now)
        autopilot = self._autopilot
        if autopilot is None or not is_flying:
            autopilot = self._autopilot = new_autopilot(self._cfg, estimator, now)
            self._goals.forget()
        if isinstance(setpoint, LandSetpoint) and is_flying:
            return self._land(setpoint, estimate, autopilot, now, step)
        self.landing = None
        if estimate.age > self._cfg.level_after:
            return Guided(level_at(estimate.hover_gas), _NO_TARGET, self._lost_sight(estimate))
        if isinstance(setpoint, TakeOffSetpoint):
            return self._climb(setpoint, estimate, autopilot, now, step)
        goal = self._goals.goal(setpoint, estimate, autopilot)
        self.error = error_value(setpoint.kind, goal, estimate)
        found = obstacle(self._cfg, self.target, estimate, now - self._clean_since)
        is_there = is_flying and estimate.age <= self._cfg.freeze_after
        is_done = is_there and self._arrival.has_arrived(goal, estimate, now)
        return Guided(floating(autopilot.sticks(goal, now, step)), found, is_done=is_done)

    def stop(self, setpoint: Setpoint, facts: VehicleFacts, now: float) -> Guided:
        """What an aborted manoeuvre becomes: hold where a target is in sight, level where none is.

        Two things cannot be stopped: a landing below its last decision goes on, and a take-off that no image has shown
        off the ground ends with a release.

        Args:
            setpoint: what the holder streams.
            facts: about the vehicle.
            now: [s].
        """
        if self.landing is not None and self.landing.phase in (LandingPhase.COMMIT, LandingPhase.DOWN):
            return self.guide(landing_of(setpoint), facts, now, is_flying=True)
        if self.take_off is not None and self.take_off.is_blind:
            self.take_off.fail("aborted")
            return Guided(level_at(IDLE_GAS), failure="take-off ended: aborted")
        estimator = self._estimator
        if self.is_in_sight(now) or not isinstance(setpoint, StickSetpoint | AttitudeSetpoint):
            hold = HoldSetpoint(epoch=setpoint.epoch, sequence=setpoint.sequence, ttl=setpoint.ttl)
            return self.guide(hold, facts, now, is_flying=True)
        return Guided(level_at(self._hover_gas if estimator is None else estimator.hover_gas))

    def _land(
        self, setpoint: LandSetpoint, estimate: Estimate, autopilot: Autopilot, now: float, step: float
    ) -> Guided:
        """Go down on the target; once committed or standing, what the eyes see no longer matters."""
        limits = LandingLimits(stand_height=self._cfg.stand_height)
        landing = self.landing = self.landing or Landing(limits, estimate)
        goal = landing.goal(estimate, setpoint.yaw, step)
        self.error = error_value(setpoint.kind, goal, estimate)
        sticks, stage = floating(autopilot.sticks(goal, now, step)), landing.phase.value
        if landing.phase is LandingPhase.DOWN:
            stands = now - landing.down_since >= self._cfg.stand_time
            shown = f"landed on {self.target}"
            if not landing.is_on_target:
                shown = f"came down, but nothing shows that it stands on {self.target}"
            return Guided(sticks, finished=shown if stands else "", stage=stage, is_done=True)
        self._hover_gas = estimate.hover_gas
        if landing.phase is LandingPhase.COMMIT or estimate.age <= self._cfg.level_after:
            return Guided(sticks, stage=stage)
        return Guided(level_at(estimate.hover_gas), failure=self._lost_sight(estimate), stage=stage)

    def _ground_obstacle(self, facts: VehicleFacts, now: float) -> str:
        """What must change before a take-off begins; empty for nothing."""
        estimator, height = self._estimator, None
        if estimator is not None and now - estimator.seen_at <= self._cfg.entry_age:
            height = float(estimator.estimate(now).position[2]) - self._cfg.stand_height
        return ground_obstacle(facts, self._hover_gas, height, now)

    def _lift(self, now: float, step: float) -> Guided | None:
        """Leave the ground; None once the autopilot flies."""
        take_off = self.take_off
        if take_off is None:
            flies = self._autopilot is not None
            if not flies and now - self._stood_at > JUST_STOOD:
                return Guided(level_at(self._hover_gas), failure="a take-off begins on the ground, with a new lease")
            limits = TakeOffLimits(ready=self._cfg.takeoff_ready, stand_height=self._cfg.stand_height)
            take_off = self.take_off = TakeOff(limits, self._hover_gas, now, is_in_air=flies)
        if not take_off.is_blind:
            return None
        attitude = self._attitude
        tilt = 0.0 if attitude is None else max(abs(attitude.pitch), abs(attitude.roll))
        sticks = level_at(take_off.gas(now, step, tilt))
        failure = f"take-off ended: {take_off.failure}" if take_off.is_over else ""
        return Guided(sticks, failure=failure, stage=take_off.phase.value)

    def _climb(
        self, setpoint: TakeOffSetpoint, estimate: Estimate, autopilot: Autopilot, now: float, step: float
    ) -> Guided:
        """Fly to the height over the middle of the target, and hold there."""
        take_off = self.take_off
        assert take_off is not None
        height, here = min(setpoint.height, self._cfg.fence_height), estimate.position
        goal = at_origin(height)
        self.error = error_value(setpoint.kind, goal, estimate)
        if self._arrival.has_arrived(goal, estimate, now):
            take_off.arrived()
        if float(here[2]) < STRAIGHT_UP and take_off.phase is TakeOffPhase.CLIMB:
            goal = Goal(position=np.array([*(autopilot.reference.position), height]))
        sticks = floating(autopilot.sticks(goal, now, step))
        return Guided(sticks, stage=take_off.phase.value, is_done=take_off.phase is TakeOffPhase.REACHED)

    def _lost_sight(self, estimate: Estimate) -> str:
        """Why the flight is over; empty while the target may come back into sight."""
        is_over = estimate.age > self._cfg.exit_after
        return f"no image of {self.target} for {estimate.age:.1f} s" if is_over else ""
