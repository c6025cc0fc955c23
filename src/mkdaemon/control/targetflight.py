"""Flight by position, velocity and attitude setpoints against a target that the cameras see.

It owns the estimator and the autopilot: poses, attitudes and the sticks that were sent come in, and setpoints turn into
sticks. While the target is out of sight the ladder of docs/safety.md rules: dead reckoning, level, then the failure
that ends the flight.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Final

import numpy as np

from mkdaemon.config.autopilot import AutopilotConfig
from mkdaemon.control.estimator.estimator import Estimator
from mkdaemon.control.estimator.model import AircraftModel
from mkdaemon.control.estimator.values import Estimate, StickCommand, TargetView
from mkdaemon.control.guidance.autopilot import GAS_CENTRE, Autopilot, AutopilotSticks, Goal
from mkdaemon.control.guidance.horizontal import HorizontalCosts
from mkdaemon.control.guidance.landing import Landing, LandingLimits, LandingPhase
from mkdaemon.control.guidance.reference import ReferenceLimits
from mkdaemon.control.guidance.vertical import VerticalGains
from mkdaemon.control.limiter import StickCounts, Sticks
from mkdaemon.control.linear import Array
from mkdaemon.control.setpoints import Guidance, Guided, StickGuidance
from mkdaemon.control.vehicle import VehicleFacts
from mkdaemon.frames import rotation_from_quaternion
from mkdaemon.telemetry.control import EstimateValue
from mkdaemon.telemetry.refusals import Token, refuse
from mkdaemon.telemetry.setpoint import (
    AttitudeSetpoint,
    LandSetpoint,
    PositionSetpoint,
    Setpoint,
    SetpointFrame,
    StickSetpoint,
    VelocitySetpoint,
)
from mkdaemon.telemetry.state import Attitude
from mkdaemon.telemetry.vision import VisionPose

ATTITUDE_LATENCY: Final = 0.024
"""How old an attitude is when it arrives [s]: the board's frame time and half the radio's latency; docs/control.md."""
FORGOTTEN: Final = 5.0
"""A target out of sight for longer is met anew [s]."""
_NO_TARGET: Final = "a target in sight"


class TargetFlight:
    """Guidance of every kind of setpoint that needs an estimate.

    Attributes:
        target: name of the target that is followed; empty before the first.
        landing: the landing that is flown; None outside one.
    """

    def __init__(self, cfg: AutopilotConfig, hover_throttle: float) -> None:
        """Prepare; nothing is estimated before the first pose.

        Args:
            cfg: limits and entry conditions.
            hover_throttle: first guess of the throttle that carries the aircraft [stick from the centre].
        """
        self.target = ""
        self._cfg = cfg
        self._hover_gas = hover_throttle + GAS_CENTRE
        self._model = AircraftModel()
        self._estimator: Estimator | None = None
        self._autopilot: Autopilot | None = None
        self._clean_since = math.inf
        self._guided_at = -math.inf
        self.landing: Landing | None = None

    # -- what is reported -----------------------------------------------------------------------------------------

    def model_known(self, model: AircraftModel) -> None:
        """Take the model of the aircraft's own parameter set; the estimate begins anew with it."""
        if model != self._model:
            self._model = model
            self._estimator = self._autopilot = None

    def pose_received(self, pose: VisionPose) -> None:
        """Take a pose; the first target seen is followed until it has been out of sight for long."""
        view = _view_of(pose)
        known = self._estimator
        if known is None or view.at - known.seen_at > FORGOTTEN:
            self.target = pose.target
            self._estimator = Estimator(self._model, view, self._hover_gas)
            self._autopilot = None
            self._clean_since = view.at
        elif pose.target == self.target:
            known.target_seen(view)
            if known.innovation > self._cfg.clean_innovation:
                self._clean_since = view.at

    def attitude_received(self, attitude: Attitude) -> None:
        """Take the attitude the boards report."""
        if self._estimator is not None:
            at = attitude.stamp.monotonic - ATTITUDE_LATENCY
            self._estimator.attitude_received(at, attitude.pitch, attitude.roll, attitude.yaw)

    def sticks_made(self, counts: StickCounts, now: float) -> None:
        """Take note of a stick frame that goes out now [s]."""
        if self._estimator is not None:
            gas = counts.throttle + GAS_CENTRE
            self._estimator.sent(StickCommand(now, counts.pitch, counts.roll, counts.yaw, gas))

    def estimate(self, now: float) -> EstimateValue | None:
        """Return what is believed now, as it is published; None before the first pose."""
        if self._estimator is None:
            return None
        self._estimator.advance(now)
        found = self._estimator.estimate(now)
        return EstimateValue(
            target=self.target,
            position=_triple(found.position),
            velocity=_triple(found.velocity),
            tilt=(float(found.tilt[0]), float(found.tilt[1])),
            disturbance=(float(found.disturbance[0]), float(found.disturbance[1])),
            yaw=found.yaw,
            hover_throttle=found.hover_gas - GAS_CENTRE,
            position_sd=_triple(found.position_sd),
            image_age=found.age,
            innovation=self._estimator.innovation,
            is_nominal=self._estimator.is_nominal,
        )

    # -- guidance -------------------------------------------------------------------------------------------------

    def check(self, setpoint: Setpoint) -> None:
        """Refuse a setpoint that cannot be followed at all; see `Guidance.check`."""
        if isinstance(setpoint, AttitudeSetpoint):
            return
        frame = getattr(setpoint, "frame", SetpointFrame.PAD)
        if frame is SetpointFrame.HOME or (frame is SetpointFrame.BODY and isinstance(setpoint, PositionSetpoint)):
            raise refuse(Token.NO_FRAME, name=setpoint.suffix, frame=frame.value)
        if self._estimator is None:
            raise refuse(Token.NO_ESTIMATE, name=setpoint.suffix)

    def guide(self, setpoint: Setpoint, facts: VehicleFacts, now: float, *, is_flying: bool) -> Guided:
        """Return what the setpoint asks for; see `Guidance.guide`."""
        if isinstance(setpoint, AttitudeSetpoint):
            return self._guide_attitude(setpoint)
        estimator = self._estimator
        if estimator is None:
            return Guided(Sticks(0.0, 0.0, 0.0, self._hover_gas - GAS_CENTRE), _NO_TARGET, "no target in sight")
        estimator.advance(now)
        estimate = estimator.estimate(now)
        autopilot = self._autopilot
        if autopilot is None or not is_flying:
            autopilot = self._autopilot = self._begin(estimator, now)
            self._guided_at = now
        step = min(max(now - self._guided_at, 0.005), 0.1)
        self._guided_at = now
        if isinstance(setpoint, LandSetpoint) and is_flying:
            return self._land(setpoint, estimate, autopilot, now, step)
        self.landing = None
        if estimate.age > self._cfg.level_after:
            return Guided(_level(estimate), _NO_TARGET, self._lost_sight(estimate))
        goal = self._goal(setpoint, estimate, autopilot, step)
        return Guided(_floating(autopilot.sticks(goal, now, step)), self._obstacle(estimate, now))

    def _land(
        self, setpoint: LandSetpoint, estimate: Estimate, autopilot: Autopilot, now: float, step: float
    ) -> Guided:
        """Go down on the target; once committed or standing, what the eyes see no longer matters."""
        limits = LandingLimits(stand_height=self._cfg.stand_height)
        landing = self.landing = self.landing or Landing(limits, estimate)
        goal = landing.goal(estimate, setpoint.yaw, step)
        sticks = _floating(autopilot.sticks(goal, now, step))
        if landing.phase is LandingPhase.DOWN:
            stands = now - landing.down_since >= self._cfg.stand_time
            shown = f"landed on {self.target}"
            if not landing.is_on_target:
                shown = f"came down, but nothing shows that it stands on {self.target}"
            return Guided(sticks, finished=shown if stands else "")
        if landing.phase is LandingPhase.COMMIT or estimate.age <= self._cfg.level_after:
            return Guided(sticks)
        return Guided(_level(estimate), failure=self._lost_sight(estimate))

    def _lost_sight(self, estimate: Estimate) -> str:
        """Why the flight is over; empty while the target may come back into sight."""
        is_over = estimate.age > self._cfg.exit_after
        return f"no image of {self.target} for {estimate.age:.1f} s" if is_over else ""

    def _begin(self, estimator: Estimator, now: float) -> Autopilot:
        cfg = self._cfg
        return Autopilot(
            estimator,
            costs=HorizontalCosts(steepest=cfg.max_tilt),
            gains=VerticalGains(fastest=cfg.max_climb),
            level_limits=ReferenceLimits(cfg.max_speed, cfg.max_acceleration),
            height_limits=ReferenceLimits(cfg.max_climb, 0.8),
            now=now,
        )

    def _goal(self, setpoint: Setpoint, estimate: Estimate, autopilot: Autopilot, step: float) -> Goal:
        """Where to go: inside the fence; without a fresh image, where the aircraft is."""
        cfg = self._cfg
        if estimate.age > cfg.freeze_after:
            return Goal(position=np.array([*autopilot.reference.position, float(estimate.position[2])]))
        if isinstance(setpoint, LandSetpoint):
            return Goal(position=estimate.position, yaw=setpoint.yaw)
        if isinstance(setpoint, PositionSetpoint):
            wanted, yaw, speed = np.array(setpoint.position), setpoint.yaw, None
        else:
            assert isinstance(setpoint, VelocitySetpoint)
            velocity, yaw = np.array(setpoint.velocity), None
            if setpoint.frame is SetpointFrame.BODY:
                c, s = math.cos(estimate.yaw), math.sin(estimate.yaw)
                velocity = np.array([c * velocity[0] - s * velocity[1], s * velocity[0] + c * velocity[1], velocity[2]])
            # A point ahead that the reference never reaches, flown to no faster than asked.
            speed = float(np.hypot(*velocity[:2]))
            here = np.array([*autopilot.reference.position, *autopilot.height.position])
            wanted = here + velocity * cfg.velocity_lead
        level = wanted[:2] * min(1.0, cfg.fence_radius / max(float(np.hypot(*wanted[:2])), 1e-9))
        height = min(max(float(wanted[2]), cfg.fence_floor), cfg.fence_height)
        return Goal(position=np.array([*level, height]), yaw=yaw, speed=speed)

    def _obstacle(self, estimate: Estimate, now: float) -> str:
        """What must change before an autonomous flight begins; empty for nothing."""
        cfg = self._cfg
        sd = float(estimate.position_sd.max())
        if estimate.age > cfg.entry_age:
            return f"a fresh image of {self.target}: the last is {estimate.age:.2f} s old"
        speed = float(np.hypot(*estimate.velocity[:2]))
        if speed > cfg.entry_speed:
            return f"a slower aircraft: it moves at {speed:.1f} m/s over {self.target}"
        if sd > cfg.entry_sd:
            return f"a certain position: its standard deviation is {100 * sd:.0f} cm"
        if now - self._clean_since < cfg.entry_clean:
            return f"images that agree with the model for {cfg.entry_clean:g} s"
        return ""

    def _guide_attitude(self, setpoint: AttitudeSetpoint) -> Guided:
        """Tilt and thrust straight to counts; the FlightCtrl's leak is the client's business."""
        model = self._model
        gas = (self._estimator.hover_gas if self._estimator is not None else self._hover_gas) * math.sqrt(
            setpoint.thrust
        )
        pitch, roll = setpoint.pitch / model.rad_per_count, setpoint.roll / model.rad_per_count
        yaw = model.yaw_stick(setpoint.yaw_rate)
        is_neutral = max(abs(pitch), abs(roll), abs(yaw)) <= self._cfg.neutral_band
        return Guided(Sticks(pitch, roll, yaw, gas - GAS_CENTRE), "" if is_neutral else "a level attitude")


def guidance(target: TargetFlight, neutral_band: float) -> Mapping[type[Setpoint], Guidance]:
    """Return guidance for every kind of setpoint."""
    return {
        StickSetpoint: StickGuidance(neutral_band),
        AttitudeSetpoint: target,
        VelocitySetpoint: target,
        PositionSetpoint: target,
        LandSetpoint: target,
    }


def _view_of(pose: VisionPose) -> TargetView:
    return TargetView(
        pose.stamp.monotonic,
        np.array(pose.position_flu),
        rotation_from_quaternion(pose.quaternion_target_from_flu),
        np.array(pose.covariance).reshape(6, 6),
    )


def _floating(sticks: AutopilotSticks) -> Sticks:
    return Sticks(float(sticks.pitch), float(sticks.roll), float(sticks.yaw), float(sticks.throttle))


def _level(estimate: Estimate) -> Sticks:
    """No tilt at the throttle that carries the aircraft."""
    return Sticks(0.0, 0.0, 0.0, round(estimate.hover_gas - GAS_CENTRE))


def _triple(vector: Array) -> tuple[float, float, float]:
    return float(vector[0]), float(vector[1]), float(vector[2])
