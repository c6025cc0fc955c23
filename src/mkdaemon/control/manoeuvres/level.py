"""Level at hover throttle: what an aborted flight by hand becomes where no target is in sight; and flight by hand."""

from __future__ import annotations

from abc import abstractmethod
from typing import Any, ClassVar

from mkdaemon.config.autopilot import AutopilotConfig
from mkdaemon.control.limiter import Sticks
from mkdaemon.control.manoeuvres.hold import Hold
from mkdaemon.control.manoeuvres.manoeuvre import Manoeuvre, Step, level_at
from mkdaemon.control.sight import Sight


class Level(Manoeuvre):
    """No tilt at the throttle that carries the aircraft, as far as that is known; nothing holds the place."""

    kind: ClassVar[str] = "level"

    def step(self, now: float, *, is_flying: bool) -> Step:
        """Decide the sticks."""
        self.stepped_at = now
        return Step(level_at(self._sight.carrying_gas), self.kind, is_level=True)

    def abort(self, now: float) -> Manoeuvre:
        """It is level."""
        return self


class ByHand(Level):
    """Sticks that follow from what a client streams alone; a flight begins with neutral ones."""

    waits: ClassVar[str]

    def __init__(self, sight: Sight, cfg: AutopilotConfig, setpoint: Any, neutral_band: float) -> None:
        """Take sticks within `neutral_band` [stick] for neutral."""
        super().__init__(sight, setpoint)
        self._cfg, self._band = cfg, neutral_band

    def enter(self, before: Manoeuvre | None, now: float) -> str:
        """Sticks must be neutral at the start of a flight; a take-over in flight may start with any."""
        sticks = self._sticks()
        is_neutral = max(abs(sticks.pitch), abs(sticks.roll), abs(sticks.yaw)) <= self._band
        return "" if is_neutral or before is not None else self.waits

    def step(self, now: float, *, is_flying: bool) -> Step:
        """The sticks as they are."""
        self.stepped_at = now
        return Step(self._sticks(), self.kind)

    def abort(self, now: float) -> Manoeuvre:
        """Hold where a target is in sight, level where none is."""
        return Hold(self._sight, self._cfg) if self._sight.is_fresh(now) else Level(self._sight)

    @abstractmethod
    def _sticks(self) -> Sticks:
        """What the newest setpoint asks for."""
