"""A flight on the model itself: do the regulators, behind the configured limits, come to rest?

Everything linear about the loop is in `margins`. Limits of tilt, sticks, their rates of change and the control rate are
not linear: with a value that is too small the aircraft swings or drifts away, though every eigenvalue is stable.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from mkdaemon.config.control import ControlConfig
from mkdaemon.control.estimator.model import GRAVITY, LEVEL_STATES, AircraftModel, D, E, H, P
from mkdaemon.control.estimator.values import GAS_CENTRE, Estimate
from mkdaemon.control.linear import Array
from mkdaemon.control.regulator.horizontal import HorizontalCosts, HorizontalRegulator
from mkdaemon.control.regulator.reference import Reference
from mkdaemon.control.regulator.shaping import CountShaper
from mkdaemon.control.regulator.vertical import VerticalGains, gas

LENGTH: Final = 12.0
"""Of the flight [s]."""
LATE: Final = 3.0
"""What counts is the end of it [s]."""
OFFSET: Final = 0.5
"""Where it begins, from its goal [m]."""
WIND: Final = 2.0
"""That it has to bear: the light wind of docs/control.md [m/s]."""
HOVER_DOUBT: Final = 0.1
"""Thrust it must make up for, either way: an aircraft heavier or lighter than believed [share of the weight]."""


@dataclass(frozen=True, slots=True)
class Rest:
    """How far from its goal the model is at the end.

    Attributes:
        level: largest horizontal distance along one axis [m].
        height: largest vertical distance [m].
    """

    level: float
    height: float


def fly_model(model: AircraftModel, cfg: ControlConfig) -> Rest:
    """Fly the model from beside and below its goal, in light wind, too heavy and too light, with the true state known.

    Args:
        model: of the aircraft.
        cfg: rate and limits.

    Raises:
        ValueError: the regulator stabilises nothing on this model.
    """
    return Rest(_level(model, cfg), max(_height(model, cfg, sign * HOVER_DOUBT) for sign in (-1.0, 1.0)))


def _level(model: AircraftModel, cfg: ControlConfig) -> float:
    regulator = HorizontalRegulator(model, HorizontalCosts(steepest=cfg.autopilot.max_tilt))
    most = min(cfg.limiter.max_pitch, cfg.limiter.max_roll)
    period = 1.0 / cfg.rate
    f, g = model.horizontal(period)
    state = np.zeros(LEVEL_STATES)
    state[P], state[D] = OFFSET, model.drag * WIND
    goal, shaper, sent, worst = Reference(np.zeros(2)), CountShaper(-127, 127), 0.0, 0.0
    for k in range(round(LENGTH * cfg.rate)):
        believed = _estimate(np.array([state, np.zeros(LEVEL_STATES)]), np.zeros(4))
        wanted = shaper.count(float(regulator.tilt(believed, goal)[0]) / model.rad_per_count)
        sent = _moved(sent, wanted, cfg.limiter.slew * min(period, 0.1), most)
        state = f @ state + g * (round(sent) * model.rad_per_count)
        if k / cfg.rate >= LENGTH - LATE:
            worst = max(worst, abs(float(state[P])))
    return worst


def _height(model: AircraftModel, cfg: ControlConfig, doubt: float) -> float:
    limits, period = cfg.limiter, 1.0 / cfg.rate
    hover = limits.hover_throttle + GAS_CENTRE
    f, g = model.vertical(period)
    state = np.zeros(4)
    state[H], state[E] = -OFFSET, GRAVITY * doubt
    shaper, sent, worst = CountShaper(-127, 127), limits.hover_throttle, 0.0
    gains = VerticalGains(fastest=cfg.autopilot.max_climb)
    for k in range(round(LENGTH * cfg.rate)):
        believed = _estimate(np.zeros((2, LEVEL_STATES)), state, hover)
        wanted = shaper.count(gas(believed, 0.0, 0.0, gains) - GAS_CENTRE)
        step = limits.throttle_slew * min(period, 0.1)
        sent = min(max(sent + min(max(wanted - sent, -step), step), limits.min_throttle), limits.max_throttle)
        state = f @ state + g * (((round(sent) + GAS_CENTRE) / hover) ** 2 - 1.0)
        if k / cfg.rate >= LENGTH - LATE:
            worst = max(worst, abs(float(state[H])))
    return worst


def _moved(last: float, wanted: float, step: float, most: float) -> float:
    moved = last + min(max(wanted - last, -step), step)
    return min(max(moved, -most), most)


def _estimate(axes: Array, vertical: Array, hover: float = 0.0) -> Estimate:
    """The true state, as the regulators take it."""
    nothing = np.zeros(3)
    return Estimate(
        at=0.0,
        position=nothing,
        velocity=nothing,
        tilt=np.zeros(2),
        disturbance=axes[:, D],
        yaw=0.0,
        hover_gas=hover,
        axes=axes,
        vertical=vertical,
        position_sd=nothing,
        age=0.0,
    )
