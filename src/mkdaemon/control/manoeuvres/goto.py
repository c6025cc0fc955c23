"""Flies to a position and holds it."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from mkdaemon.config.autopilot import AutopilotConfig
from mkdaemon.control.estimator.values import Estimate
from mkdaemon.control.linear import Array
from mkdaemon.control.manoeuvres.by_target import ToGoal, resting_place
from mkdaemon.control.manoeuvres.hold import Hold
from mkdaemon.control.manoeuvres.manoeuvre import Manoeuvre
from mkdaemon.control.regulator.autopilot import Autopilot, Goal
from mkdaemon.control.sight import Sight, turned
from mkdaemon.telemetry.setpoint import PositionSetpoint, SetpointFrame


class Goto(ToGoal):
    """Flies to positions against the target, or from where the aircraft was when a position first arrived."""

    kind: ClassVar[str] = "position"

    def __init__(self, sight: Sight, cfg: AutopilotConfig, setpoint: PositionSetpoint) -> None:
        super().__init__(sight, cfg, setpoint)
        self._origin: tuple[Autopilot, Array, float] | None = None

    def follow(self, setpoint: PositionSetpoint) -> None:
        """Take the newest setpoint; another place counts from where the aircraft is then."""
        is_same = (setpoint.position, setpoint.yaw, setpoint.frame) == (
            self._wanted.position,
            self._wanted.yaw,
            self._wanted.frame,
        )
        self._wanted = setpoint
        if not is_same:
            self._origin = None

    def abort(self, now: float) -> Manoeuvre:
        """Hold where it comes to rest."""
        return Hold(self._sight, self._cfg)

    def _goal(self, estimate: Estimate, autopilot: Autopilot) -> Goal:
        wanted, place = self._wanted, np.array(self._wanted.position)
        if wanted.frame is SetpointFrame.PAD:
            return Goal(position=self._inside_fence(place), yaw=wanted.yaw)
        if self._origin is None or self._origin[0] is not autopilot:
            self._origin = (autopilot, resting_place(autopilot), estimate.yaw)
        _, origin, heading = self._origin
        yaw = None if wanted.yaw is None else heading + wanted.yaw
        return Goal(position=self._inside_fence(origin + turned(place, heading)), yaw=yaw)
