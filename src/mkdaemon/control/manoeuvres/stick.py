"""Sticks as the client sends them."""

from __future__ import annotations

from typing import ClassVar

from mkdaemon.config.autopilot import AutopilotConfig
from mkdaemon.control.limiter import Sticks
from mkdaemon.control.manoeuvres.hold import Hold
from mkdaemon.control.manoeuvres.level import Level
from mkdaemon.control.manoeuvres.manoeuvre import Manoeuvre, Step
from mkdaemon.control.sight import Sight
from mkdaemon.telemetry.setpoint import StickSetpoint


class Stick(Level):
    """Sticks are what they are; a flight begins with neutral ones."""

    kind: ClassVar[str] = "stick"

    def __init__(self, sight: Sight, cfg: AutopilotConfig, setpoint: StickSetpoint, neutral_band: float) -> None:
        """Take sticks within `neutral_band` [stick] for neutral."""
        super().__init__(sight)
        self._cfg, self._wanted, self._band = cfg, setpoint, neutral_band

    def follow(self, setpoint: StickSetpoint) -> None:
        """Take the newest setpoint."""
        self._wanted = setpoint

    def enter(self, before: Manoeuvre | None, now: float) -> str:
        """Sticks must be neutral at the beginning of a flight; who takes over in flight moves them as he likes."""
        wanted = self._wanted
        is_neutral = max(abs(wanted.pitch), abs(wanted.roll), abs(wanted.yaw)) <= self._band
        return "" if is_neutral or before is not None else "waiting for neutral sticks"

    def step(self, now: float, *, is_flying: bool) -> Step:
        """The sticks as they are."""
        self.stepped_at, wanted = now, self._wanted
        return Step(Sticks(wanted.pitch, wanted.roll, wanted.yaw, wanted.throttle), self.kind)

    def abort(self, now: float) -> Manoeuvre:
        """Hold where a target is in sight, level where none is."""
        return Hold(self._sight, self._cfg) if self._sight.is_fresh(now) else Level(self._sight)
