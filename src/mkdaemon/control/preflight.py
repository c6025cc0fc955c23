"""Gathers what admission looks at; the table is `admission`."""

from __future__ import annotations

from functools import lru_cache
from typing import Final, NamedTuple

from mkdaemon.config.control import ControlConfig
from mkdaemon.control.activeset import UNREAD, KnownSet
from mkdaemon.control.admission.situation import NO_WORK, Situation
from mkdaemon.control.estimator.model import AircraftModel, Gap, ModelUnknown
from mkdaemon.control.flown import Flown
from mkdaemon.control.motionmatch import Match, MotionMatch
from mkdaemon.control.regulator.margins import gains_of, loop_refusal
from mkdaemon.control.sight import Sight
from mkdaemon.control.vehicle import VehicleFacts
from mkdaemon.errors import CommandRejectedError
from mkdaemon.frames import euler_from_rotation, rotation_from_quaternion
from mkdaemon.telemetry.control import ControlLine, Gains, LeaseState, Phase
from mkdaemon.telemetry.state import Battery, Flight, Gps, Pilot, Position
from mkdaemon.telemetry.vision import VisionPose

MATCHED_FOR: Final = 0.5
"""Camera and boards are compared again after this time [s]; it takes 2 ms a camera."""
REPORTED: Final = 1.0
"""A throttle that was reported longer ago says nothing [s]."""


class Preflight:
    """The newest values that admission checks.

    Attributes:
        motion: as reported by the boards and a camera.
        active_set: of the FlightCtrl, as it was read last.
        line: what the line can take.
        has_guard: the guard is there.
    """

    def __init__(self, cfg: ControlConfig, facts: VehicleFacts) -> None:
        """Gather; nothing is known yet but the configuration."""
        self._cfg, self._facts = cfg, facts
        self.motion = MotionMatch()
        self.active_set: KnownSet = UNREAD
        self.line = ControlLine()
        self.has_guard = True
        self._contradicting: tuple[str, ...] = ()
        self._followed = ""
        self._model = AircraftModel()
        self._unknown: ModelUnknown | None = ModelUnknown(Gap.UNREAD)
        self._loop: _Loop | None = None
        self._match: Match | None = None
        self._matched_at = float("-inf")

    # -- values that arrive ---------------------------------------------------------------------------------------

    def pose_received(self, pose: VisionPose, followed: str, contradicting: tuple[str, ...]) -> None:
        """Take a pose, the target that is followed, and the cameras whose poses contradict those of others."""
        if pose.is_placed:
            roll, pitch, _ = euler_from_rotation(rotation_from_quaternion(pose.quaternion_target_from_flu))
            self.motion.tilt_seen(pose.target, pose.stamp.monotonic, pitch, roll, pose.camera)
        else:
            self.motion.target_seen(pose.target, pose.stamp.monotonic, pose.position_flu, pose.camera)
        self._followed, self._contradicting = followed, contradicting

    def model_known(self, model: AircraftModel, unknown: ModelUnknown | None) -> None:
        """Take the model to fly by.

        Args:
            model: of the aircraft.
            unknown: why it is not that of the aircraft's own parameter set; None where it is.
        """
        self._unknown = unknown
        if model != self._model:
            self._model, self._loop = model, None
        self.compute_loop()

    def compute_loop(self) -> None:
        """Judge the control loop on the present model; 0.06 to 0.12 s for a new one: never in flight."""
        if self._loop is None:
            self._loop = _judge_loop(self._model, self._cfg)

    # -- what is asked --------------------------------------------------------------------------------------------

    def situation(self, now: float, phase: Phase, lease: LeaseState | None, flown: Flown, sight: Sight) -> Situation:
        """All that admission looks at, now [s], in a phase, under a lease; cheap: what images show is added."""
        facts, loop = self._facts, self._loop
        is_flown = phase.is_in_flight and phase is not Phase.UNANSWERED
        return Situation(
            cfg=self._cfg,
            now=now,
            phase=phase,
            holder="" if lease is None else lease.holder,
            lease_left=0.0 if lease is None else lease.left,
            flown=flown.concern if is_flown else None,
            work=NO_WORK,
            line=self.line,
            has_guard=self.has_guard,
            link=facts.link,
            health=facts.health,
            active_set=self.active_set,
            motors_running=facts.motors_running(now),
            is_testing_motors=facts.is_testing_motors(now),
            flight=facts.newest(Flight, now),
            pilot=facts.newest(Pilot, now),
            position=facts.newest(Position, now),
            gps=facts.newest(Gps, now),
            battery=facts.newest(Battery, now),
            cells=facts.cells,
            are_cells_doubtful=facts.are_cells_doubtful,
            hover_gas=sight.hover_gas,
            gas_in_use=self._gas_in_use(now),
            eyes=facts.eyes,
            contradicting=self._contradicting,
            target_age=sight.pose_age(now),
            paths=sight.paths.ids,
            in_sight=sight.in_sight(now),
            entry=None,
            is_touching=flown.may_touch,
            unanswered=sight.answer.missing_words(now),
            stamps=self._match,
            free_disk=facts.free_disk,
            model=self._unknown,
            loop=None if loop is None else loop.refusal,
        )

    def compare(self, now: float) -> Match | None:
        """Compare how camera and boards move, now [s]; again after a while."""
        if now - self._matched_at >= MATCHED_FOR:
            self._match, self._matched_at = self.motion.match(now, self._followed), now
        return self._match

    def _gas_in_use(self, now: float) -> float | None:
        """Throttle in use by the FlightCtrl [count of 254]; None without a recent report."""
        throttle = self._facts.throttle_in_use(self.active_set.low_cell)
        return throttle.stick if throttle is not None and now - throttle.at <= REPORTED else None

    def gains(self) -> Gains:
        """Model, gains and margins of the loop.

        Raises:
            CommandRejectedError: `loop_unstable`: there are none.
        """
        self.compute_loop()
        assert self._loop is not None
        if self._loop.gains is None:
            assert self._loop.refusal is not None
            raise self._loop.refusal
        return self._loop.gains


class _Loop(NamedTuple):
    """What was computed of a control loop: its gains, if it has any, and why it must not be flown."""

    gains: Gains | None
    refusal: CommandRejectedError | None


@lru_cache(maxsize=16)
def _judge_loop(model: AircraftModel, cfg: ControlConfig) -> _Loop:
    """Compute gains and margins of the loop on a model, and judge it."""
    try:
        gains = gains_of(model, cfg)
    except ValueError:
        return _Loop(None, loop_refusal(model, cfg))
    return _Loop(gains, loop_refusal(model, cfg, gains))
