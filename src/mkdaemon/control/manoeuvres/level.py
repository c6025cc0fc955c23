"""Level at hover throttle: what an aborted flight by hand becomes where no target is in sight."""

from __future__ import annotations

import math
from typing import Any, ClassVar

from mkdaemon.control.manoeuvres.manoeuvre import Manoeuvre, Step, level_at
from mkdaemon.control.sight import Sight


class Level:
    """No tilt; nothing holds the place.

    Attributes:
        stepped_at: when it was asked last [s].
    """

    kind: ClassVar[str] = "level"
    is_by_target: ClassVar[bool] = False
    keeps_place: ClassVar[bool] = False

    def __init__(self, sight: Sight) -> None:
        """Fly at the throttle that carries the aircraft, as far as `sight` knows it."""
        self.stepped_at = -math.inf
        self._sight = sight

    def enter(self, before: Manoeuvre | None, now: float) -> str:
        """It may begin at any time."""
        return ""

    def follow(self, setpoint: Any) -> None:
        """Level is level."""

    def step(self, now: float, *, is_flying: bool) -> Step:
        """Decide the sticks."""
        self.stepped_at = now
        estimator = self._sight.estimator
        gas = self._sight.hover_gas if estimator is None else estimator.hover_gas
        return Step(level_at(gas), self.kind, is_level=True)

    def height_seen(self, height: float, at: float) -> float | None:
        """Nothing follows from it."""
        return None

    def abort(self, now: float) -> Manoeuvre:
        """It is level."""
        return self
