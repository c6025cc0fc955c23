"""The target that is followed: its name, and the estimate of the aircraft against it."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from typing import Final

import numpy as np

from mkdaemon.config.autopilot import AutopilotConfig
from mkdaemon.control.admission.situation import ASIDE, EntryEstimate
from mkdaemon.control.answers import AnswerWatch
from mkdaemon.control.estimator.estimator import Estimator
from mkdaemon.control.estimator.liftoff import LiftOff, lifted_off
from mkdaemon.control.estimator.model import AircraftModel
from mkdaemon.control.estimator.values import GAS_CENTRE, StickCommand, TargetView, ThrottleUse, ViewFault, fault_of
from mkdaemon.control.limiter import StickCounts
from mkdaemon.control.linear import Array
from mkdaemon.control.path.stored import StoredPaths
from mkdaemon.frames import rotation_from_quaternion
from mkdaemon.telemetry.control import EstimateValue
from mkdaemon.telemetry.link import LinkHealth
from mkdaemon.telemetry.state import AngleScale, Attitude
from mkdaemon.telemetry.vision import VisionPose

CONFIRMED_BY_CABLE: Final = 0.0125
"""By cable, time from writing a stick frame to its confirmation [s], median; docs/lab/genuine.md."""
ECHOED_BY_CABLE: Final = 0.0125
"""By cable, round trip of a link test [s], median; docs/lab/genuine.md."""
SHOWN: Final = 1.13
"""What a FlightCtrl reports over the angle that its sticks ask for; docs/control.md, "The attitude loop"."""
FORGOTTEN: Final = 5.0
"""After a longer time out of sight, the estimate against a target restarts [s]."""
IN_SIGHT: Final = 1.0
"""A target that was seen longer ago is not in sight [s]."""
SENT_KEPT: Final = 100
"""Stick frames that an estimate begun in flight learns of: two seconds of them, a blind lift-off and a late image."""
SHORTEST_PAIR: Final = 0.02
"""Two views closer in time give no velocity [s]."""
LONGEST_PAIR: Final = 0.2
"""Two views farther apart in time give none either [s]."""
FEET: Final = 0.05
"""An aircraft whose feet are no higher above the target may stand [m]."""
FLIES: Final = 0.3
"""How long images must show it higher before it flies again [s]: wrong images are shorter."""


class Sight:
    """Follows one target at a time.

    Attributes:
        target: name of the target that is followed; empty before the first.
        named: name of the target that the newest setpoint asks for; empty where it names none.
        estimator: against it; None before the first pose.
        model: of the aircraft.
        hover_gas: hover throttle until an estimate has one [count of 254].
        attitude: as the boards reported it last.
        is_standing: what is flown knows that the aircraft stands on the ground, where nothing is estimated.
        answer: of the aircraft to its sticks.
        paths: that can be flown along by the target.
    """

    def __init__(self, cfg: AutopilotConfig, hover_throttle: float) -> None:
        """Prepare; nothing is estimated before the first pose.

        Args:
            cfg: when images agree with the model.
            hover_throttle: first guess of the throttle that carries the aircraft [stick from the centre].
        """
        self.target = self.named = ""
        self._seen: dict[str, float] = {}
        self.estimator: Estimator | None = None
        self.model = AircraftModel()
        self.hover_gas = hover_throttle + GAS_CENTRE
        self.attitude: Attitude | None = None
        self.is_standing = False
        self.answer = AnswerWatch(self.model)
        self.paths = StoredPaths(cfg)
        self._is_answer_judged = self._is_others = False
        self._trusted_gas: float | None = None
        self._added: float | None = None
        self._by_line = self.model
        self._cfg = cfg
        self._last_view: TargetView | None = None
        self._last_views: dict[str, TargetView] = {}  # of each camera
        self._discredited = ""  # the source whose poses have made the estimate wrong
        self._apart = 0.0  # between the two newest images [s]
        self._high_since = -math.inf  # all images from then on show it off the ground [s]
        self._sent: deque[StickCommand] = deque(maxlen=SENT_KEPT)
        self._clean_since = math.inf

    def model_known(self, model: AircraftModel) -> None:
        """Take the model from the aircraft's parameter set; the estimate restarts with it."""
        if model != self.model:
            self.model, self.estimator = model, None
            self.answer = AnswerWatch(model)
            self._weigh_line()

    def link_measured(self, health: LinkHealth) -> None:
        """Take round trips of the line: half of what they are longer than a cable's is added to each way."""
        for trips, by_cable in ((health.confirm, CONFIRMED_BY_CABLE), (health.echo, ECHOED_BY_CABLE)):
            if trips.p50_ms is not None:
                self._added = max(0.0, trips.p50_ms / 1000.0 - by_cable) / 2.0
                self._weigh_line()
                return

    def _weigh_line(self) -> None:
        """Recompute the model with the line's delays."""
        self._by_line = self.model if self._added is None else self.model.by_line(self._added)

    @property
    def attitude_age(self) -> float:
        """Estimated age of an attitude at its arrival [s]."""
        return self._known_model().attitude_age

    def _known_model(self) -> AircraftModel:
        """The model that is flown by, or would be."""
        return self._by_line if self.estimator is None else self.estimator.model

    def stand(self, *, is_standing: bool) -> None:
        """Take whether the aircraft stands: the estimate ends on the ground and restarts in the air."""
        self.is_standing = is_standing
        if is_standing:
            self.estimator = None

    def judge_answer(self, *, says_something: bool) -> None:
        """Take whether no answer to the sticks would mean something: it is flown by the target, off the ground."""
        self._is_answer_judged = says_something

    def frame_confirmed(self, number: int, now: float) -> None:
        """Take that the board has confirmed a stick frame; the first one after a break shows since when they act."""
        was_cut = self.answer.is_cut
        self.answer.frame_confirmed(number, now)
        if was_cut and not self.answer.is_cut and self.estimator is not None and not self._is_others:
            arrived = self.answer.arrived_at
            self.estimator.sticks_known(arrived, [command for command in self._sent if command.at >= arrived])

    def leave_to_pilot(self, *, is_his: bool) -> None:
        """Take whether the pilot flies, whatever is sent: what was learnt from sticks that did not act is forgotten."""
        if is_his and not self._is_others:
            self.estimator, self.hover_gas = None, self._trusted_gas or self.hover_gas
        self._is_others = is_his

    def attitude_received(self, attitude: Attitude) -> None:
        """Take the attitude the boards report."""
        self.attitude = attitude
        at = attitude.stamp.monotonic - self.attitude_age
        scale = SHOWN if attitude.scale is AngleScale.FLIGHTCTRL else 1.0
        pitch, roll = attitude.pitch / scale, attitude.roll / scale
        self.answer.attitude_received(at, pitch, roll, says_something=self._is_answer_judged)
        if self.estimator is not None:
            if self.answer.is_cut and not self._is_others:
                # Frames of which nothing is known are taken to act. Without them the regulator would ask for its
                # whole correction again with every frame, and a line that heals in a silence would carry it out.
                arrived = self.answer.arrived_at
                later = (command for command in self._sent if command.at > arrived)
                self.estimator.sticks_lost(arrived, [each for each in later if not self.answer.has_lost(each.at)])
            line_age = self.estimator.line.attitude_age
            self.estimator.attitude_received(attitude.stamp.monotonic - line_age, pitch, roll, attitude.yaw)
            if self.answer.is_sure:
                self._trusted_gas = self.estimator.hover_gas

    def view_received(
        self, target: str, view: TargetView, now: float, *, lifted: LiftOff | None, may_change: bool
    ) -> str:
        """Take a view of a target.

        Another target takes the place of the followed one only when that has been out of sight for long, and never
        while something is flown by it.

        Args:
            target: its name.
            view: what the image shows.
            now: when it arrives [s].
            lifted: how the aircraft left the ground, where this view shows that it has; the estimate restarts.
            may_change: nothing is flown by the followed target.

        Returns:
            The target that was followed before, where this one takes its place; empty otherwise.
        """
        known, before = self.estimator, self.target
        is_other = bool(before) and target != before
        is_forgotten = known is None or view.at - known.seen_at > FORGOTTEN
        if is_other and not ((is_forgotten or target == self.named) and may_change):
            return ""
        if (may_change or self.is_standing) and not self.may_follow(target, view):
            return ""
        if self.is_standing and lifted is None:
            self.target = target
        elif known is None or is_other or is_forgotten or lifted is not None or self._is_astray_for(view):
            # The estimate of an aircraft on the ground contains no information about its hover throttle.
            compass = 0.0 if self.attitude is None else self.attitude.yaw
            before_it = self._last_views.get(view.camera) if self._discredited else self._last_view
            velocity = None if is_other else velocity_between(before_it, view)
            hover_gas, thrust = self.hover_gas, 0.0
            if lifted is not None:
                hover_gas, thrust = lifted.hover_gas, lifted.thrust
                velocity = np.array([*(np.zeros(2) if velocity is None else velocity[:2]), lifted.climb])
            self.estimator = None
            self.estimator = Estimator(
                self._known_model(), view, hover_gas, compass=compass, velocity=velocity, thrust=thrust
            )
            is_wrong = known is not None and (known.is_elsewhere or bool(self._discredited))
            is_flown = is_wrong and not self._is_others and not self.answer.is_cut
            for command in self._sent if lifted is not None or is_flown else ():
                self.estimator.sent(command)
            self.target, self._clean_since, self._last_view, self._discredited = target, view.at, None, ""
        else:
            known.target_seen(view, now)
            if not known.innovation <= self._cfg.clean_innovation:
                self._clean_since = view.at
        if self._last_view is None or view.at >= self._last_view.at:
            self._apart = 0.0 if self._last_view is None else view.at - self._last_view.at
            self._last_view = self._last_views[view.camera] = view
            is_low = view.height <= self._cfg.stand_height + FEET
            if lifted is not None:
                self._high_since = -math.inf
            else:
                self._high_since = math.inf if is_low else min(self._high_since, view.at)
        return before if is_other else ""

    def discredit(self, camera: str) -> bool:
        """Drop an estimate that stands on a source alone which the boards contradict; return whether there was one.

        It cannot be flown on by dead reckoning, as after a silence: what was estimated is wrong too. If another camera
        sees the target, the estimate restarts with its next image; that the two contradicted each other is no longer
        held against it.
        """
        is_dropped = self.estimator is not None and self.estimator.stands_on(camera)
        if is_dropped:
            self.estimator = None
        elif self.estimator is not None and self.estimator.uses(camera):
            self._discredited = camera
        return is_dropped

    def sticks_made(self, counts: StickCounts, use: ThrottleUse, now: float) -> None:
        """Take note of a stick frame that goes out now [s], and of what becomes of its throttle."""
        command = StickCommand(now, counts.pitch, counts.roll, counts.yaw, counts.throttle + GAS_CENTRE, use)
        self._sent.append(command)
        self.answer.model_found(self._known_model())
        self.answer.sent(counts.pitch, counts.roll, now)
        if self.estimator is not None and not self._is_others:
            if self.answer.is_cut:
                self.estimator.under_way(command)
            else:
                self.estimator.sent(command)

    def _is_astray_for(self, view: TargetView) -> bool:
        """Whether the estimate may have left what a view shows.

        By the pilot's sticks, by dead reckoning, or by a source that was wrong.
        """
        known = self.estimator
        if known is None:
            return False
        if self._discredited and view.camera != self._discredited:
            return True
        return known.is_elsewhere or (self._is_others and not known.innovation <= self._cfg.clean_innovation)

    def seen(self, target: str, at: float) -> None:
        """Note that an image taken at a time [s] shows a target, whether it is followed or not."""
        self._seen[target] = max(self._seen.get(target, at), at)

    # -- questions, which change nothing --------------------------------------------------------------------------

    def lift_off(self, seen: Sequence[tuple[float, float]], between: tuple[float, float]) -> LiftOff:
        """Return how the aircraft left the ground by the stick frames that were sent; see `lifted_off`."""
        return lifted_off(self._sent, seen, self._known_model(), between)

    def may_follow(self, target: str, view: TargetView) -> bool:
        """Whether the target of a view is the one that is named; where none is, it must not lie aside of who stands."""
        if self.named:
            return target == self.named
        return not self.is_standing or view.aside <= ASIDE

    def in_sight(self, now: float) -> tuple[str, ...]:
        """Names of all targets that images have shown lately."""
        return tuple(sorted(name for name, at in self._seen.items() if now - at <= IN_SIGHT))

    def is_fresh(self, now: float) -> bool:
        """Whether the target has been seen lately enough to hold or land by it."""
        return self.estimator is not None and now - self.estimator.seen_at <= self._cfg.level_after

    @property
    def has_come_down(self) -> bool:
        """Whether its feet may stand: an image shows it, and none of those since then that agree for `FLIES`.

        One image is enough, also one that the estimate refuses: an aircraft that falls to the ground between two
        images is not where the model expects it. It costs no more than a hover until the next images.
        """
        return self._last_view is not None and self._last_view.at - self._high_since < FLIES

    @property
    def carrying_gas(self) -> float:
        """Throttle that carries the aircraft by the estimate, or as it was known before [count of 254]."""
        return self.hover_gas if self.estimator is None else self.estimator.hover_gas

    def pose_age(self, now: float) -> float | None:
        """Time since the newest image of the target that is followed [s]; None where there was none."""
        return None if self._last_view is None else now - self._last_view.at

    def hover_throttle(self, now: float) -> float | None:
        """Throttle that carries the aircraft by the estimate [stick from the centre]; None where that is too old."""
        return self.estimator.hover_gas - GAS_CENTRE if self.estimator is not None and self.is_fresh(now) else None

    @property
    def contradicting(self) -> tuple[str, ...]:
        """Cameras whose images contradict those of others."""
        return () if self.estimator is None else self.estimator.contradicting

    def entry(self, now: float) -> EntryEstimate | None:
        """Return what admission looks at before something is flown by the target; None without an estimate."""
        if self.estimator is None:
            return None
        estimate = self.estimator.estimate(now)
        return EntryEstimate(
            target=self.target,
            age=estimate.age,
            speed=math.hypot(*estimate.velocity.tolist()),
            offset=float(np.hypot(*estimate.position[:2])),
            height=float(estimate.position[2]),
            sd=math.hypot(float(estimate.position_sd.max()), self._apart * self.estimator.velocity_sd),
            clean=now - self._clean_since,
        )

    def estimate(self, now: float) -> EstimateValue | None:
        """Return the estimate as it is published; None before the first pose, and on the ground.

        The model has no ground. No camera sees a target from behind: an estimate below the target has landed.
        """
        estimator = self.estimator
        if estimator is None:
            return None
        estimator.advance(now)
        believed, spread = estimator.estimate(now), estimator.motion_covariance
        if not believed.position[2] > 0.0:
            return None
        return EstimateValue(
            target=self.target,
            position=triple(believed.position),
            velocity=triple(believed.velocity),
            tilt=(float(believed.tilt[0]), float(believed.tilt[1])),
            disturbance=(float(believed.disturbance[0]), float(believed.disturbance[1])),
            yaw=believed.yaw,
            hover_throttle=believed.hover_gas - GAS_CENTRE,
            position_sd=triple(believed.position_sd),
            covariance=(triple(spread[0]), triple(spread[1]), triple(spread[2])),
            image_age=believed.age,
            innovation=estimator.innovation,
            caution=estimator.caution,
            stick_gain=estimator.stick_gain,
            stick_filter=estimator.model.stick_filter,
            uplink=estimator.model.uplink,
            attitude_age=estimator.model.attitude_age,
            contradicting=estimator.contradicting,
        )


def checked_view(pose: VisionPose, now: float) -> TargetView | ViewFault:
    """A pose that arrives now [s] as the estimator takes it, or why it cannot be used."""
    if not all(math.isfinite(number) for number in pose.quaternion_target_from_flu):
        return ViewFault.NOT_FINITE
    if not math.hypot(*pose.quaternion_target_from_flu) > 0.0:
        return ViewFault.NO_ROTATION
    view = view_of(pose)
    return fault_of(view, now) or view


def view_of(pose: VisionPose) -> TargetView:
    """A pose as the estimator takes it.

    Tilt and place of a camera err together, by its height above the tags. So a pose on a map is taken as one of the
    ground below: from an origin 6 m aside, a tilt that is off by one degree would move the height by 10 cm.
    """
    rotation, seen = rotation_from_quaternion(pose.quaternion_target_from_flu), np.array(pose.position_flu)
    point = (*pose.position_target[:2], 0.0) if pose.is_of_map else (0.0, 0.0, 0.0)
    if pose.is_of_map:
        seen = seen + rotation.T @ point
    return TargetView(
        pose.stamp.monotonic,
        seen,
        rotation,
        np.array(pose.covariance).reshape(6, 6),
        pose.camera,
        pose.calibration_sd,
        pose.is_placed,
        point,
        pose.is_of_map,
    )


def velocity_between(before: TargetView | None, view: TargetView) -> Array | None:
    """Velocity against the target from two views of it (3,) [m/s]; None where they are too far apart in time.

    Also None if they are of two cameras: mountings are not known to the millimetre.

    From where the target lies in the body frame, as if that were level: a small tag close by shows its place to
    millimetres and the tilt to half a radian, which would make tens of metres a second of two places.
    """
    step = math.inf if before is None else view.at - before.at
    if before is None or before.camera != view.camera or not SHORTEST_PAIR <= step <= LONGEST_PAIR:
        return None
    if view.is_placed:
        return (view.place - before.place) / step
    seen = turned((before.position_flu - view.position_flu) / step, view.heading)
    return seen + np.subtract(view.point, before.point) / step


def turned(vector: Array, yaw: float) -> Array:
    """Turn a vector (3,) about the up axis [rad]."""
    c, s = math.cos(yaw), math.sin(yaw)
    return np.array([c * vector[0] - s * vector[1], s * vector[0] + c * vector[1], vector[2]])


def triple(vector: Array) -> tuple[float, float, float]:
    """Plain numbers."""
    x, y, z = vector.tolist()
    return x, y, z
