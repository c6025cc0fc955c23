"""Flies at a velocity against the target."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from mkdaemon.control.estimator.values import Estimate
from mkdaemon.control.manoeuvres.by_target import ToGoal
from mkdaemon.control.manoeuvres.hold import Hold
from mkdaemon.control.manoeuvres.manoeuvre import Manoeuvre
from mkdaemon.control.regulator.autopilot import Autopilot, Goal
from mkdaemon.control.sight import turned
from mkdaemon.telemetry.setpoint import SetpointFrame


class FlyVelocity(ToGoal):
    """Flies towards a point ahead that the reference never reaches, no faster than asked."""

    kind: ClassVar[str] = "velocity"
    keeps_place: ClassVar[bool] = False

    def abort(self, now: float) -> Manoeuvre:
        """Hold where it comes to rest."""
        return Hold(self._sight, self._cfg)

    def _goal(self, estimate: Estimate, autopilot: Autopilot) -> Goal:
        velocity = np.array(self._wanted.velocity)
        if self._wanted.frame is SetpointFrame.BODY:
            velocity = turned(velocity, estimate.yaw)
        here = np.array([*autopilot.reference.position, *autopilot.height.position])
        ahead = self._inside_fence(here + velocity * self._cfg.velocity_lead)
        return Goal(position=ahead, yaw_rate=self._wanted.yaw_rate, speed=float(np.hypot(*velocity[:2])))
