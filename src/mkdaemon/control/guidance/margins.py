"""How far the aircraft may differ from its model before the horizontal loop is unstable."""

from __future__ import annotations

from typing import Final

import numpy as np

from mkdaemon.control.estimator.model import AircraftModel
from mkdaemon.control.guidance.horizontal import STEP, HorizontalCosts, HorizontalRegulator
from mkdaemon.control.linear import Array, spectral_radius
from mkdaemon.telemetry.control import Gains

NAMES: Final = ("position", "velocity", "tilt", "believed tilt", "integral", "rate", "filtered stick")
"""What each gain acts on, in the order of the model's states."""
FACTORS: Final = tuple(float(factor) for factor in np.geomspace(0.05, 20.0, 241))
"""Stick gains that are tried, over the model's."""
MOST_STEPS: Final = 25
"""Longest extra delay that is tried [control periods]."""


def gains_of(model: AircraftModel, steepest: float) -> Gains:
    """Return model, gains and margins of the horizontal loop, for people to look at.

    The margins are those of the loop with the true state; the estimator's own dynamics take a part of them.

    Args:
        model: of the aircraft.
        steepest: largest wanted tilt [rad].
    """
    regulator = HorizontalRegulator(model, HorizontalCosts(steepest=steepest))
    f, g = model.horizontal(STEP)
    f, g = f[:7, :7], g[:7, None]
    gain = regulator.gain[None]
    stable = [factor for factor in FACTORS if spectral_radius(f - g @ (factor * gain)) < 1.0]
    steps = next((count for count in range(1, MOST_STEPS) if _delayed_radius(f, g, gain, count) >= 1.0), MOST_STEPS)
    return Gains(
        degrees_per_count=float(np.degrees(model.rad_per_count)),
        a1=model.a1,
        a2=model.a2,
        leak=model.leak,
        stick_filter=model.stick_filter,
        uplink=model.uplink,
        gains=dict(zip(NAMES, (float(value) for value in regulator.gain), strict=True)),
        radius=regulator.radius,
        gain_margin=(min(stable, default=1.0), max(stable, default=1.0)),
        delay_margin=(steps - 1) * STEP,
    )


def _delayed_radius(f: Array, g: Array, gain: Array, steps: int) -> float:
    """Spectral radius of the loop whose stick acts some control periods late."""
    n = len(f)
    size = n + steps
    loop = np.zeros((size, size))
    loop[:n, :n] = f
    loop[:n, n : n + 1] = g
    for k in range(steps - 1):
        loop[n + k, n + k + 1] = 1.0
    loop[size - 1, :n] = -gain[0]
    return spectral_radius(loop)
