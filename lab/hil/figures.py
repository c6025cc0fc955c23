"""What a flight of the proving ground was worth: its figures, by the physics, the board and the estimate."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Final

import numpy as np
import numpy.typing as npt

from lab.campaign import Row
from mkdaemon.control.estimator.model import STICK_FILTER

Array = npt.NDArray[np.float64]

SETTLED: Final = 5.0
"""Figures of a hold are taken after this [s]."""
STEP: Final = 1.0
"""Length of the step [m]."""
ON_TARGET: Final = 0.3
"""An aircraft this far from the middle of the target, or nearer, has landed on it [m]."""


@dataclass(slots=True)
class Flown:
    """What happened.

    Attributes:
        truth: time [s], true position in the frame of the target (3) [m], 1 on the ground.
        estimates: of every estimate: time [s], position (3) [m], standard deviations (3) [m], stick filter [s].
        warnings: of the daemon, with their times [s].
        parts: begin of each [s].
        unanswered: largest evidence that the aircraft does not answer its sticks [nat].
        end: why the flight ended.
        crashed: why the aircraft broke; empty while whole.
        motors_run: whether the board turned the motors at the end.
    """

    truth: list[tuple[float, ...]] = field(default_factory=list)
    estimates: list[tuple[float, ...]] = field(default_factory=list)
    warnings: list[tuple[float, str]] = field(default_factory=list)
    parts: dict[str, float] = field(default_factory=dict)
    unanswered: float = -math.inf
    end: str = ""
    crashed: str = ""
    motors_run: bool = False

    def rows(self, begin: float = -math.inf, end: float = math.inf) -> Array:
        """The truth of a time [s] (n, 5)."""
        rows = np.array(self.truth).reshape(-1, 5)
        return rows[(rows[:, 0] >= begin) & (rows[:, 0] < end)]

    def began(self, part: str) -> float:
        """When a part began [s]; infinite where it was not flown."""
        return self.parts.get(part, math.inf)


def figures(flown: Flown) -> Row:
    """What a flight, or a copy of one, was worth: errors [cm], times [s], the estimate's honesty, what it warned of.

    A part that was not flown has no figures. `lost` says why an aircraft was lost, or did not do what it was to do.
    """
    parts, began = flown.parts, flown.began
    found: Row = {"lost": _lost(flown), "unanswered_nat": round(flown.unanswered, 3)}
    found["warnings"] = [text for at, text in flown.warnings if at >= parts.get("take-off", 0.0)]
    for part, end in (("hold", "light"), ("light", "follow"), ("moderate", "")):
        rows = flown.rows(began(part) + SETTLED, began(end))
        if len(rows):
            found[f"{part}_cm"] = 100 * math.sqrt(float((rows[:, 1:3] ** 2).sum(axis=1).mean()))
    if "step" in parts:
        rows = flown.rows(began("step"))
        east = rows[:, 1] + STEP / 2
        reached = np.flatnonzero(east > 0.9 * STEP)
        found["step_over_percent"] = 100 * max(0.0, float(east.max(initial=0.0)) / STEP - 1.0)
        if len(reached):
            found["step_t90"] = float(rows[reached[0], 0] - began("step"))
        else:
            found["lost"].append("nine tenths of the step were never reached")
    rows = flown.rows(began("land"))
    if (rows[:, 4] > 0).any():
        first = rows[rows[:, 4] > 0][0]
        found["moving_touch_cm" if "follow" in parts else "touch_cm"] = 100 * math.hypot(first[1], first[2])
    return found | (_honesty(flown) if "hold" in parts else {})


def _lost(flown: Flown) -> list[str]:
    """Why the aircraft was lost, or did not do what it was to do; physics and the board say so, not the daemon."""
    if flown.crashed:
        return [flown.crashed]
    if list(flown.parts)[-1:] != ["land"]:
        return [flown.end] if flown.end else []
    rows = flown.rows(flown.began("land"))
    if not len(rows) or not rows[-1, 4]:
        return [f"it did not land: {flown.end or 'it is in the air at the end'}"]
    off = math.hypot(rows[-1, 1], rows[-1, 2])
    found = [f"it stands {100 * off:.0f} cm from the middle of the target"] if off > ON_TARGET else []
    return found + (["its motors run on the ground"] if flown.motors_run else [])


def _honesty(flown: Flown) -> Row:
    """Normalised squared error of the estimated place, per axis, and what it says of the stick filter."""
    truth, estimates = flown.rows(), np.array(flown.estimates).reshape(-1, 8)
    flies = estimates[(estimates[:, 0] >= flown.began("hold")) & (estimates[:, 0] < flown.began("land"))]
    if not len(flies):
        return {}
    true = np.stack([np.interp(flies[:, 0], truth[:, 0], truth[:, 1 + axis]) for axis in range(3)], axis=1)
    ratio = ((flies[:, 1:4] - true) / flies[:, 4:7]) ** 2
    return {
        "nees_level": float(ratio[:, :2].mean()),
        "nees_height": float(ratio[:, 2].mean()),
        "filter_off_ms": 1000 * abs(float(flies[-1, 7]) - STICK_FILTER),
    }
