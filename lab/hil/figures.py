"""What a flight of the proving ground was worth: its figures, by the physics, the board and the estimate."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
import numpy.typing as npt

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
        truth: time [s], true position in the frame of the target (3) [m], vertical speed [m/s], 1 on the ground.
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


def figures(flown: Flown) -> dict[str, Any]:
    """What a flight, or a copy of one, was worth: errors [cm], times [s], the estimate's honesty, what it warned of.

    A part that was not flown has no figures. `lost` says why an aircraft was lost, or did not do what it was to do.
    """
    truth, parts = np.array(flown.truth).reshape(-1, 6), flown.parts
    found: dict[str, Any] = {"lost": _lost(flown, truth), "unanswered_nat": round(flown.unanswered, 3)}
    found["warnings"] = [text for at, text in flown.warnings if at >= parts.get("take-off", 0.0)]
    if "take-off" in parts:
        rows = _between(truth, parts["take-off"], parts.get("hold", math.inf))
        found["take_off_far_cm"] = 100 * float(np.hypot(rows[:, 1], rows[:, 2]).max(initial=0.0))
    for part, end in (("hold", "light"), ("light", "follow"), ("moderate", ""), ("follow", "land")):
        rows = _between(truth, parts.get(part, math.inf) + SETTLED, parts.get(end, math.inf))
        if len(rows):
            found[f"{part}_cm"] = 100 * math.sqrt(float((rows[:, 1:3] ** 2).sum(axis=1).mean()))
    if "step" in parts:
        found |= _step(_between(truth, parts["step"], math.inf), parts["step"])
        if "step_t90" not in found:
            found["lost"].append("nine tenths of the step were never reached")
    if "land" in parts:
        on = "moving_" if "follow" in parts else ""
        found |= {on + key: value for key, value in _landing(_between(truth, parts["land"], math.inf)).items()}
    if "hold" in parts:
        found |= _honesty(truth, np.array(flown.estimates), parts)
    return found


def _lost(flown: Flown, truth: Array) -> list[str]:
    """Why the aircraft was lost, or did not do what it was to do; physics and the board say so, not the daemon."""
    if flown.crashed:
        return [flown.crashed]
    if list(flown.parts)[-1:] != ["land"]:
        return [flown.end] if flown.end else []
    return not_landed(_between(truth, flown.parts["land"], math.inf), flown.end, motors_run=flown.motors_run)


def not_landed(rows: Array, end: str, *, motors_run: bool) -> list[str]:
    """What is missing of a landing on the target.

    Args:
        rows: truth from the begin of the landing to the end of the flight; see `Flown.truth`.
        end: why the daemon ended the flight.
        motors_run: whether the board turns the motors at the end.

    Returns:
        Reasons; none where the aircraft stands on the target with its motors off.
    """
    if not len(rows) or not rows[-1, 5]:
        return [f"it did not land: {end or 'it is in the air at the end'}"]
    off = float(np.hypot(rows[-1, 1], rows[-1, 2]))
    found = [f"it stands {100 * off:.0f} cm from the middle of the target"] if off > ON_TARGET else []
    return found + (["its motors run on the ground"] if motors_run else [])


def _between(rows: Array, begin: float, end: float) -> Array:
    return rows[(rows[:, 0] >= begin) & (rows[:, 0] < end)]


def _step(rows: Array, began: float) -> dict[str, Any]:
    east = rows[:, 1] + STEP / 2
    reached = np.flatnonzero(east > 0.9 * STEP)
    found = {"step_over_percent": 100 * max(0.0, float(east.max(initial=0.0)) / STEP - 1.0)}
    return found | ({"step_t90": float(rows[reached[0], 0] - began)} if len(reached) else {})


def _landing(rows: Array) -> dict[str, Any]:
    stands = np.flatnonzero(rows[:, 5] > 0)
    if not len(stands):
        return {}
    k = int(stands[0])
    return {
        "touch_cm": 100 * float(np.hypot(rows[k, 1], rows[k, 2])),
        "sink": -float(rows[max(0, k - 2), 4]),
    }


def _honesty(truth: Array, estimates: Array, parts: Mapping[str, float]) -> dict[str, Any]:
    """Normalised squared error of the estimated place, per axis, and what it says of the stick filter."""
    flies = _between(estimates.reshape(-1, 8), parts["hold"], parts.get("land", math.inf))
    if not len(flies):
        return {}
    true = np.stack([np.interp(flies[:, 0], truth[:, 0], truth[:, 1 + axis]) for axis in range(3)], axis=1)
    errors = flies[:, 1:4] - true
    ratio = (errors / flies[:, 4:7]) ** 2
    return {
        "nees_level": float(ratio[:, :2].mean()),
        "nees_height": float(ratio[:, 2].mean()),
        "bias_height_cm": 100 * float(errors[:, 2].mean()),
        "filter_off_ms": 1000 * abs(float(flies[-1, 7]) - STICK_FILTER),
    }
