"""Before a flight: gathers what the checks look at, and refuses what they forbid; the table is `checks`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Final

from mkdaemon.config.control import ControlConfig
from mkdaemon.control.activeset import UNREAD, ActiveSet
from mkdaemon.control.checks import findings, is_ready, standing
from mkdaemon.control.estimator.model import AircraftModel, Gap, ModelUnknown
from mkdaemon.control.estimator.values import GAS_CENTRE
from mkdaemon.control.knowledge import Knowledge
from mkdaemon.control.manoeuvres.manoeuvre import Step
from mkdaemon.control.motionmatch import MotionMatch
from mkdaemon.control.regulator.margins import gains_of, loop_refusal
from mkdaemon.control.vehicle import VehicleFacts
from mkdaemon.errors import CommandRejectedError
from mkdaemon.telemetry.control import ControlLine, Gains, Obstacle
from mkdaemon.telemetry.preflight import Blocks, PreflightReport
from mkdaemon.telemetry.refusals import Token, refuse
from mkdaemon.telemetry.setpoint import AttitudeSetpoint, Setpoint, StickSetpoint
from mkdaemon.telemetry.vision import VisionPose

FRESH: Final = 0.5
"""What stood in the way of autonomous flight is looked at again after this time [s]."""


class Preflight:
    """The checks before a flight.

    Attributes:
        motion: as the boards and a camera told it.
        active_set: of the FlightCtrl, as it was read last.
        line: what the line can take.
        has_guard: the guard is there.
    """

    def __init__(
        self, cfg: ControlConfig, facts: VehicleFacts, target_age: Callable[[float], float | None] = lambda now: None
    ) -> None:
        """Check; `target_age` tells the age of the newest image of the target at a time [s]."""
        self._cfg, self._facts, self._target_age = cfg, facts, target_age
        self.motion = MotionMatch()
        self.active_set: ActiveSet = UNREAD
        self.line = ControlLine()
        self.has_guard = True
        self._contradicting: tuple[str, ...] = ()
        self._model = AircraftModel()
        self._unknown: ModelUnknown | None = ModelUnknown(Gap.UNREAD)
        self._gains: Gains | None = None
        self._loop: CommandRejectedError | None = None
        self._is_loop_known = False
        self._obstacle: CommandRejectedError | None = None
        self._looked_at = float("-inf")

    def report(self, now: float, *, is_flying: bool = False) -> PreflightReport:
        """Every check, at a time [s]; in flight nothing that takes long is computed anew."""
        found = findings(self._known(now, is_quick=is_flying))
        return PreflightReport(is_ready=is_ready(found), findings=found)

    def require_lease(self, now: float) -> None:
        """Refuse a lease nobody could fly with.

        Raises:
            CommandRejectedError: the first check that stands in the way.
        """
        refusal = next(standing(self._known(now, is_quick=True), Blocks.LEASE), None)
        if refusal is not None:
            raise refusal

    def refusal(self, kind: type[Setpoint], now: float) -> CommandRejectedError | None:
        """Why a flight against a target may not begin; None where it may, and for flights by hand."""
        if kind in (StickSetpoint, AttitudeSetpoint):
            return None
        if now - self._looked_at >= FRESH:
            self._looked_at = now
            self._obstacle = next(standing(self._known(now), Blocks.AUTONOMY), None)
        return self._obstacle

    def gains(self, *, is_flying: bool = False) -> Gains:
        """Model, gains and margins of the loop; computed once for a model, which takes too long in flight.

        Raises:
            CommandRejectedError: `loop_unstable`: there are none; `busy`: in flight nothing is computed.
        """
        if self._gains is None and is_flying:
            raise refuse(Token.BUSY, detail="the loop is not computed in flight")
        if self._gains is None:
            try:
                self._gains = gains_of(self._model, self._cfg)
            except ValueError:
                refusal = loop_refusal(self._model, self._cfg)
                assert refusal is not None
                raise refusal from None
        return self._gains

    def pose_received(self, pose: VisionPose, contradicting: tuple[str, ...]) -> None:
        """Take a pose, and the cameras whose poses contradict those of others."""
        self.motion.target_seen(pose.stamp.monotonic, pose.position_flu, pose.camera)
        self._contradicting = contradicting

    def model_known(self, model: AircraftModel, unknown: ModelUnknown | None) -> None:
        """Take the model to fly by, and why it is not that of the aircraft's own parameter set; None where it is."""
        self._unknown = unknown
        if model != self._model:
            self._model, self._gains, self._loop, self._is_loop_known = model, None, None, False

    def _loop_refusal(self) -> CommandRejectedError | None:
        if not self._is_loop_known:
            self._loop, self._is_loop_known = loop_refusal(self._model, self._cfg, self._gains), True
        return self._loop

    def wait_for_board(self, step: Step) -> Step:
        """Begin no flight while a board does not listen: the first frame it hears must be one of neutral sticks."""
        return replace(step, obstacle=self.line.reason) if self.line.obstacle is Obstacle.DEAF else step

    def _known(self, now: float, *, is_quick: bool = False) -> Knowledge:
        """What the checks look at; `is_quick` leaves out what takes long to compute: the loop would stand still."""
        loop = self._loop if is_quick else self._loop_refusal()
        facts = self._facts
        return Knowledge(
            now=now,
            lease=self._cfg.lease,
            hover_gas=self._cfg.limiter.hover_throttle + GAS_CENTRE,
            has_guard=self.has_guard,
            line=self.line,
            link=facts.link,
            health=facts.health,
            active_set=self.active_set,
            flight=facts.flight(now),
            pilot=facts.pilot(now),
            battery=facts.battery(now),
            highest_voltage=facts.highest_voltage,
            eyes=facts.eyes,
            contradicting=self._contradicting,
            target_age=self._target_age(now),
            stamps=None if is_quick else self.motion.match(now),
            free_disk=facts.free_disk,
            model=self._unknown,
            loop=loop,
            is_loop_known=self._is_loop_known,
        )
