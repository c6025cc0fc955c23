"""Stays where the aircraft is when the manoeuvre begins."""

from __future__ import annotations

from typing import ClassVar

from mkdaemon.config.autopilot import AutopilotConfig
from mkdaemon.control.estimator.values import Estimate
from mkdaemon.control.linear import Array
from mkdaemon.control.manoeuvres.by_target import ToGoal, resting_place
from mkdaemon.control.manoeuvres.manoeuvre import Manoeuvre
from mkdaemon.control.regulator.autopilot import Autopilot, Goal
from mkdaemon.control.sight import Sight


class Hold(ToGoal):
    """Holds a place."""

    kind: ClassVar[str] = "hold"

    def __init__(self, sight: Sight, cfg: AutopilotConfig) -> None:
        super().__init__(sight, cfg)
        self._place: Array | None = None
        self._of: Autopilot | None = None

    def abort(self, now: float) -> Manoeuvre:
        """It holds."""
        return self

    def _goal(self, estimate: Estimate, autopilot: Autopilot) -> Goal:
        if self._place is None or self._of is not autopilot:
            self._place, self._of = resting_place(autopilot), autopilot
        return Goal(position=self._inside_fence(self._place))
