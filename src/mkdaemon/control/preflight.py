"""Before a flight: gathers what the checks look at, and refuses what they forbid; the table is `checks`."""

from __future__ import annotations

from typing import Final

from mkdaemon.config.control import ControlConfig
from mkdaemon.control.activeset import UNREAD, ActiveSet
from mkdaemon.control.checks import findings, is_ready, standing
from mkdaemon.control.guidance.autopilot import GAS_CENTRE
from mkdaemon.control.knowledge import Knowledge
from mkdaemon.control.motionmatch import MotionMatch
from mkdaemon.control.vehicle import VehicleFacts
from mkdaemon.errors import CommandRejectedError
from mkdaemon.telemetry.control import ControlLine
from mkdaemon.telemetry.preflight import Blocks, PreflightReport
from mkdaemon.telemetry.setpoint import AttitudeSetpoint, Setpoint, StickSetpoint

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

    def __init__(self, cfg: ControlConfig, facts: VehicleFacts) -> None:
        self._cfg, self._facts = cfg, facts
        self.motion = MotionMatch()
        self.active_set: ActiveSet = UNREAD
        self.line = ControlLine()
        self.has_guard = True
        self._obstacle: CommandRejectedError | None = None
        self._looked_at = float("-inf")

    def report(self, now: float) -> PreflightReport:
        """Every check, at a time [s]."""
        found = findings(self._known(now))
        return PreflightReport(is_ready=is_ready(found), findings=found)

    def require_lease(self, now: float) -> None:
        """Refuse a lease nobody could fly with.

        Raises:
            CommandRejectedError: the first check that stands in the way.
        """
        refusal = next(standing(self._known(now), Blocks.LEASE), None)
        if refusal is not None:
            raise refusal

    def check_setpoint(self, setpoint: Setpoint, now: float) -> None:
        """Refuse what would begin a flight against a target while a check stands in its way.

        Raises:
            CommandRejectedError: the first such check.
        """
        if isinstance(setpoint, StickSetpoint | AttitudeSetpoint):
            return
        if now - self._looked_at >= FRESH:
            self._looked_at = now
            self._obstacle = next(standing(self._known(now), Blocks.AUTONOMY), None)
        if self._obstacle is not None:
            raise self._obstacle

    def _known(self, now: float) -> Knowledge:
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
            eyes=tuple(facts.eyes.values()),
            target_age=facts.pose_age(now),
            stamps=self.motion.match(now),
            free_disk=facts.free_disk,
        )
