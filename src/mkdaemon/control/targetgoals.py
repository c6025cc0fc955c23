"""What setpoints mean against a target: where to go, and what must be true before a flight begins with them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from mkdaemon.config.autopilot import AutopilotConfig
from mkdaemon.control.estimator.estimator import Estimator
from mkdaemon.control.estimator.model import AircraftModel
from mkdaemon.control.estimator.values import GAS_CENTRE, Estimate, TargetView
from mkdaemon.control.guidance.autopilot import Autopilot, AutopilotSticks, Goal
from mkdaemon.control.guidance.horizontal import HorizontalCosts
from mkdaemon.control.guidance.reference import ReferenceLimits
from mkdaemon.control.guidance.vertical import VerticalGains
from mkdaemon.control.limiter import Sticks
from mkdaemon.control.linear import Array
from mkdaemon.control.setpoints import Guided
from mkdaemon.control.vehicle import VehicleFacts
from mkdaemon.frames import rotation_from_quaternion
from mkdaemon.telemetry.control import ErrorValue, EstimateValue
from mkdaemon.telemetry.setpoint import (
    AttitudeSetpoint,
    HoldSetpoint,
    PositionSetpoint,
    Setpoint,
    SetpointFrame,
    VelocitySetpoint,
)
from mkdaemon.telemetry.vision import VisionPose

BRAKING: Final = 0.5
"""Who is to hold its place holds where the reference would be after this time [s]: there it can stand still."""

TURNED: Final = math.radians(8.0)
"""Heading error with which a heading is reached [rad]; within half of it the compass lock holds."""

STANDS: Final = 0.15
"""Who is no higher than this above its standing height is on the ground [m]."""
CARRIES: Final = 0.6
"""Who flies with more throttle may be in the air [share of hover]; a third of the weight is carried."""
REPORTED: Final = 1.0
"""A throttle that was reported longer ago says nothing [s]."""

SHORTEST_PAIR: Final = 0.02
"""Two views closer in time give no velocity [s]."""
LONGEST_PAIR: Final = 0.2
"""Two views farther apart in time give none either [s]."""


@dataclass(frozen=True, slots=True)
class _Anchor:
    """Where the aircraft was when a setpoint that counts from there first arrived.

    Attributes:
        setpoint: what was asked for.
        position: (3,) [m].
        yaw: [rad].
    """

    setpoint: tuple[object, ...]
    position: Array
    yaw: float


class Arrival:
    """Notices that the aircraft has been close to its goal, heading included where one is wanted, for a while."""

    def __init__(self, within: float, settled: float) -> None:
        """Count a place as reached within a distance [m] for a time [s]."""
        self._within, self._settled = within, settled
        self._place: tuple[float, ...] = ()
        self._away_at = 0.0

    def has_arrived(self, goal: Goal, estimate: Estimate, now: float) -> bool:
        """Take where to be and where the aircraft is; whether it has arrived."""
        wanted = _triple(goal.position)
        is_turned = goal.yaw is None or abs(math.remainder(estimate.yaw - goal.yaw, math.tau)) <= TURNED
        is_near = float(np.linalg.norm(estimate.position - goal.position)) <= self._within
        if wanted != self._place or not is_near or not is_turned:
            self._place, self._away_at = wanted, now
        return now - self._away_at >= self._settled


class Goals:
    """Turns setpoints into goals in the frame of the target, inside the fence."""

    def __init__(self, cfg: AutopilotConfig) -> None:
        self._cfg = cfg
        self._anchor: _Anchor | None = None

    def forget(self) -> None:
        """Let the next setpoint that counts from the aircraft's own place begin anew."""
        self._anchor = None

    def goal(self, setpoint: Setpoint, estimate: Estimate, autopilot: Autopilot) -> Goal:
        """Where to go; without a fresh image, where the aircraft is."""
        cfg = self._cfg
        if estimate.age > cfg.freeze_after:
            return Goal(position=np.array([*autopilot.reference.position, float(estimate.position[2])]))
        yaw: float | None = None
        yaw_rate = 0.0
        speed: float | None = None
        if isinstance(setpoint, VelocitySetpoint):
            self._anchor = None
            velocity = np.array(setpoint.velocity)
            if setpoint.frame is SetpointFrame.BODY:
                velocity = _turned(velocity, estimate.yaw)
            # A point ahead that the reference never reaches, flown to no faster than asked.
            speed = float(np.hypot(*velocity[:2]))
            here = np.array([*autopilot.reference.position, *autopilot.height.position])
            wanted, yaw_rate = here + velocity * cfg.velocity_lead, setpoint.yaw_rate
        elif isinstance(setpoint, PositionSetpoint) and setpoint.frame is SetpointFrame.PAD:
            self._anchor = None
            wanted, yaw = np.array(setpoint.position), setpoint.yaw
        elif isinstance(setpoint, PositionSetpoint):
            anchor = self._anchored((setpoint.position, setpoint.yaw), estimate, autopilot)
            wanted = anchor.position + _turned(np.array(setpoint.position), anchor.yaw)
            yaw = None if setpoint.yaw is None else anchor.yaw + setpoint.yaw
        elif isinstance(setpoint, HoldSetpoint):
            wanted = self._anchored((), estimate, autopilot).position
        else:  # landing and take-off before they have begun
            self._anchor = None
            wanted, yaw = estimate.position, getattr(setpoint, "yaw", None)
        return Goal(position=self.inside_fence(wanted), yaw=yaw, yaw_rate=yaw_rate, speed=speed)

    def inside_fence(self, wanted: Array) -> Array:
        """The nearest place inside the fence (3,) [m]."""
        cfg = self._cfg
        level = wanted[:2] * min(1.0, cfg.fence_radius / max(float(np.hypot(*wanted[:2])), 1e-9))
        return np.array([*level, min(max(float(wanted[2]), cfg.fence_floor), cfg.fence_height)])

    def _anchored(self, setpoint: tuple[object, ...], estimate: Estimate, autopilot: Autopilot) -> _Anchor:
        if self._anchor is None or self._anchor.setpoint != setpoint:
            level, height = autopilot.reference, autopilot.height
            here = [*(level.position + BRAKING * level.velocity), *(height.position + BRAKING * height.velocity)]
            self._anchor = _Anchor(setpoint, np.array(here), estimate.yaw)
        return self._anchor


def new_autopilot(cfg: AutopilotConfig, estimator: Estimator, now: float) -> Autopilot:
    """Begin a flight where the aircraft is."""
    return Autopilot(
        estimator,
        costs=HorizontalCosts(steepest=cfg.max_tilt),
        gains=VerticalGains(fastest=cfg.max_climb),
        level_limits=ReferenceLimits(cfg.max_speed, cfg.max_acceleration),
        height_limits=ReferenceLimits(cfg.max_climb, 0.8),
        now=now,
    )


def obstacle(cfg: AutopilotConfig, target: str, estimate: Estimate, clean: float) -> str:
    """What must change before an autonomous flight begins; empty for nothing.

    Args:
        cfg: entry conditions.
        target: its name.
        estimate: now.
        clean: how long images have agreed with the model [s].
    """
    sd, speed = float(estimate.position_sd.max()), float(np.hypot(*estimate.velocity[:2]))
    if estimate.age > cfg.entry_age:
        return f"a fresh image of {target}: the last is {estimate.age:.2f} s old"
    if speed > cfg.entry_speed:
        return f"a slower aircraft: it moves at {speed:.1f} m/s over {target}"
    offset, height = float(np.hypot(*estimate.position[:2])), float(estimate.position[2])
    if offset > cfg.entry_offset * height:
        return f"a place nearer over {target}: it is {offset:.1f} m beside its middle, {height:.1f} m up"
    if sd > cfg.entry_sd:
        return f"a certain position: its standard deviation is {100 * sd:.0f} cm"
    return "" if clean >= cfg.entry_clean else f"images that agree with the model for {cfg.entry_clean:g} s"


def ground_obstacle(facts: VehicleFacts, hover_gas: float, height: float | None, now: float) -> str:
    """What must change before a take-off begins; empty for nothing.

    It begins with the lowest throttle, which would drop an aircraft that a pilot holds in the air.

    Args:
        facts: about the vehicle.
        hover_gas: throttle that carries it [count of 254].
        height: of its feet above the target [m]; None where none is in sight.
        now: [s].
    """
    if facts.motors_running(now) is False:
        return "running motors: the pilot starts them, throttle at its lowest"
    if height is not None and height > STANDS:
        return f"an aircraft on the ground: its feet are {height:.1f} m above the target"
    report = facts.throttle_in_use()
    if report is not None and now - report.at <= REPORTED and report.throttle + GAS_CENTRE > CARRIES * hover_gas:
        return f"the pilot's throttle at its lowest: it is at {report.throttle:+.0f}, which may carry the aircraft"
    return ""


def guide_attitude(setpoint: AttitudeSetpoint, model: AircraftModel, hover_gas: float, neutral_band: float) -> Guided:
    """Tilt and thrust straight to counts; the FlightCtrl's leak is the client's business."""
    gas = hover_gas * math.sqrt(setpoint.thrust)
    pitch, roll = setpoint.pitch / model.rad_per_count, setpoint.roll / model.rad_per_count
    yaw = model.yaw_stick(setpoint.yaw_rate)
    is_neutral = max(abs(pitch), abs(roll), abs(yaw)) <= neutral_band
    return Guided(Sticks(pitch, roll, yaw, gas - GAS_CENTRE), "" if is_neutral else "a level attitude")


def estimate_value(target: str, estimator: Estimator, now: float) -> EstimateValue:
    """What is believed now, as it is published."""
    estimator.advance(now)
    found, spread = estimator.estimate(now), estimator.motion_covariance
    return EstimateValue(
        target=target,
        position=_triple(found.position),
        velocity=_triple(found.velocity),
        tilt=(float(found.tilt[0]), float(found.tilt[1])),
        disturbance=(float(found.disturbance[0]), float(found.disturbance[1])),
        yaw=found.yaw,
        hover_throttle=found.hover_gas - GAS_CENTRE,
        position_sd=_triple(found.position_sd),
        covariance=(_triple(spread[0]), _triple(spread[1]), _triple(spread[2])),
        image_age=found.age,
        innovation=estimator.innovation,
        is_nominal=estimator.is_nominal,
        stick_gain=estimator.stick_gain,
        stick_filter=estimator.model.stick_filter,
        contradicting=estimator.contradicting,
    )


def error_value(kind: str, goal: Goal, estimate: Estimate) -> ErrorValue:
    """How far the aircraft is from where it is to be."""
    error = estimate.position - goal.position
    yaw = None if goal.yaw is None else math.remainder(estimate.yaw - goal.yaw, math.tau)
    return ErrorValue(
        manoeuvre=kind,
        goal=_triple(goal.position),
        error_pad=_triple(error),
        error_body=_triple(_turned(error, -estimate.yaw)),
        error_yaw=yaw,
    )


def view_of(pose: VisionPose) -> TargetView:
    """A pose as the estimator takes it."""
    return TargetView(
        pose.stamp.monotonic,
        np.array(pose.position_flu),
        rotation_from_quaternion(pose.quaternion_target_from_flu),
        np.array(pose.covariance).reshape(6, 6),
        pose.camera,
    )


def velocity_between(before: TargetView | None, view: TargetView) -> Array | None:
    """Velocity against the target from two views of it (3,) [m/s]; None where they are too far apart in time.

    None, too, where they are of two cameras: nobody knows both mountings to the millimetre.

    From where the target lies in the body frame, as if that were level: a small tag close by shows its place to
    millimetres and the tilt to half a radian, which would make tens of metres a second of two places.
    """
    step = math.inf if before is None else view.at - before.at
    if before is None or before.camera != view.camera or not SHORTEST_PAIR <= step <= LONGEST_PAIR:
        return None
    return _turned((before.position_flu - view.position_flu) / step, view.heading)


def floating(sticks: AutopilotSticks) -> Sticks:
    """Whole counts as the limiter takes them."""
    return Sticks(float(sticks.pitch), float(sticks.roll), float(sticks.yaw), float(sticks.throttle))


def level_at(gas: float) -> Sticks:
    """No tilt at a throttle [count of 254]."""
    return Sticks(0.0, 0.0, 0.0, round(gas - GAS_CENTRE))


def _turned(vector: Array, yaw: float) -> Array:
    c, s = math.cos(yaw), math.sin(yaw)
    return np.array([c * vector[0] - s * vector[1], s * vector[0] + c * vector[1], vector[2]])


def _triple(vector: Array) -> tuple[float, float, float]:
    return float(vector[0]), float(vector[1]), float(vector[2])
