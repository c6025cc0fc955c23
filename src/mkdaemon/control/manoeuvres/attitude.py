"""Tilt and thrust straight to counts; the FlightCtrl's leak is the client's business."""

from __future__ import annotations

import math
from typing import ClassVar

from mkdaemon.config.autopilot import AutopilotConfig
from mkdaemon.control.estimator.values import GAS_CENTRE
from mkdaemon.control.limiter import Sticks
from mkdaemon.control.manoeuvres.hold import Hold
from mkdaemon.control.manoeuvres.level import Level
from mkdaemon.control.manoeuvres.manoeuvre import Manoeuvre, Step
from mkdaemon.control.sight import Sight
from mkdaemon.telemetry.setpoint import AttitudeSetpoint


class AttitudeFlight(Level):
    """Attitudes as the client streams them; a flight begins with a level one."""

    kind: ClassVar[str] = "attitude"

    def __init__(self, sight: Sight, cfg: AutopilotConfig, setpoint: AttitudeSetpoint) -> None:
        super().__init__(sight)
        self._cfg, self._wanted = cfg, setpoint

    def follow(self, setpoint: AttitudeSetpoint) -> None:
        """Take the newest setpoint."""
        self._wanted = setpoint

    def enter(self, before: Manoeuvre | None, now: float) -> str:
        """The attitude must be level at the beginning of a flight."""
        sticks = self._sticks()
        is_neutral = max(abs(sticks.pitch), abs(sticks.roll), abs(sticks.yaw)) <= self._cfg.neutral_band
        return "" if is_neutral or before is not None else "waiting for a level attitude"

    def step(self, now: float, *, is_flying: bool) -> Step:
        """The sticks that ask for the attitude."""
        self.stepped_at = now
        return Step(self._sticks(), self.kind)

    def abort(self, now: float) -> Manoeuvre:
        """Hold where a target is in sight, level where none is."""
        return Hold(self._sight, self._cfg) if self._sight.is_fresh(now) else Level(self._sight)

    def _sticks(self) -> Sticks:
        sight, wanted = self._sight, self._wanted
        model = sight.model
        hover = sight.hover_gas if sight.estimator is None else sight.estimator.hover_gas
        gas = hover * math.sqrt(wanted.thrust)
        pitch, roll = wanted.pitch / model.rad_per_count, wanted.roll / model.rad_per_count
        return Sticks(pitch, roll, model.yaw_stick(wanted.yaw_rate), gas - GAS_CENTRE)
