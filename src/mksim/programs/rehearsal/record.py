"""What happened in a rehearsal: the true flight over the target, and the figures of its parts."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

SETTLING: Final = 2.0
"""Figures of a hold are taken after this [s]."""


@dataclass(frozen=True, slots=True)
class Moment:
    """The aircraft at one moment.

    Attributes:
        at: [s].
        position: true, from the middle of the target (3,) [m].
        target: true, of the target (3,) [m; ENU].
        goal: where it is to be, from the middle of the target; None where nothing is asked for.
        estimate: where it is believed to be; None where nothing is flown by it.
        part: of the flight.
    """

    at: float
    position: tuple[float, float, float]
    target: tuple[float, float, float]
    goal: tuple[float, float, float] | None
    estimate: tuple[float, float, float] | None
    part: str


@dataclass(slots=True)
class Rehearsed:
    """A whole flight.

    Attributes:
        moments: twenty a second.
        parts: begin of each part of the flight [s].
        outcome: why the flight ended.
        motors_stand: whether the motors stood still at the end.
        crashed: why the aircraft broke; empty while it is whole.
        images: looked at.
        posed: of those, with a pose.
    """

    moments: list[Moment] = field(default_factory=list)
    parts: dict[str, float] = field(default_factory=dict)
    outcome: str = ""
    motors_stand: bool = False
    crashed: str = ""
    images: int = 0
    posed: int = 0

    @property
    def landing(self) -> Moment | None:
        """The aircraft when it was let go after the landing; None where it never began to land."""
        return next((moment for moment in reversed(self.moments) if moment.part == "land"), None)

    @property
    def touch_error(self) -> float:
        """Horizontal distance from the middle of the target then [m]: what the pilot does afterwards is his."""
        return math.hypot(*self.landing.position[:2]) if self.landing is not None else math.nan

    @property
    def has_landed(self) -> bool:
        """Whether it stands on the target, whole, and its motors stand still."""
        landing = self.landing
        on_pad = landing is not None and self.touch_error < 0.3 and landing.position[2] < 0.2
        return on_pad and self.outcome.startswith("landed on") and self.motors_stand and not self.crashed

    def errors(self, part: str) -> Array:
        """True position less goal in a part, after it settled (n, 3) [m]."""
        began = self.parts.get(part, math.inf) + SETTLING
        found = [
            np.subtract(moment.position, moment.goal)
            for moment in self.moments
            if moment.part == part and moment.goal is not None and moment.at >= began
        ]
        return np.array(found).reshape(-1, 3)

    def figures(self) -> Mapping[str, Any]:
        """The errors, in centimetres, and how it ended."""
        found: dict[str, Any] = {"landed": self.has_landed, "outcome": self.outcome or "not landed"}
        if self.crashed:
            found["crashed"] = self.crashed
        for part in ("hold", "follow"):
            errors = self.errors(part)
            if len(errors):
                level = np.hypot(errors[:, 0], errors[:, 1])
                found[f"{part}_rms_cm"] = _cm(math.sqrt(float((level**2).mean())))
                found[f"{part}_max_cm"] = _cm(float(level.max()))
                found[f"{part}_height_rms_cm"] = _cm(math.sqrt(float((errors[:, 2] ** 2).mean())))
        found |= self._step()
        found["touch_cm"] = None if self.landing is None else _cm(self.touch_error)
        found["motors_stand"] = self.motors_stand
        found["seconds"] = round(self.moments[-1].at, 1) if self.moments else 0.0
        found["images"], found["posed"] = self.images, self.posed
        return found

    def _step(self) -> dict[str, float]:
        """Time to nine tenths and overshoot of the step of 1 m."""
        began = self.parts.get("step")
        if began is None:
            return {}
        way = [(m.at - began, m.position[0] + 0.5) for m in self.moments if m.part == "step"]
        reached = next((at for at, east in way if east >= 0.9), math.nan)
        return {
            "step_t90_s": round(reached, 2),
            "step_overshoot_percent": round(100 * max(0.0, max((east for _, east in way), default=0.0) - 1.0), 1),
        }


def _cm(metres: float) -> float:
    return round(100.0 * metres, 1)
