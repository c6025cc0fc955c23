"""Height to throttle: a cascade over climb rate and thrust, with the tilt compensated."""

from __future__ import annotations

import math
from dataclasses import dataclass

from mkdaemon.control.estimator.model import GRAVITY, E, F, H, S
from mkdaemon.control.estimator.values import Estimate, upright


@dataclass(frozen=True, slots=True)
class VerticalGains:
    """The cascade.

    Attributes:
        height: climb rate per height error [1/s].
        climb: acceleration per climb rate error [1/s].
        lead: how much of the motors' lag is inverted.
        fastest: largest climb rate asked for by a height error [m/s].
        least: smallest thrust [share of the weight]; attitude control fades with it.
        most: largest thrust [share of the weight].
    """

    height: float = 2.0
    climb: float = 2.7
    lead: float = 1.5
    fastest: float = 0.6
    least: float = 0.6
    most: float = 1.5


def gas(estimate: Estimate, height: float, climb: float, gains: VerticalGains) -> float:
    """Return the throttle to ask for [count of 254].

    Args:
        estimate: at the moment when the stick will act.
        height: wanted [m].
        climb: of the wanted height [m/s].
        gains: the cascade.
    """
    state = estimate.vertical
    rise = min(max(gains.height * (height - float(state[H])), -gains.fastest), gains.fastest) + climb
    acceleration = gains.climb * (rise - float(state[S])) - float(state[E])
    thrust = min(max(1.0 + acceleration / GRAVITY, gains.least), gains.most)
    lag = 1.0 + float(state[F])
    driven = (lag + (thrust - lag) * gains.lead) / upright(estimate.tilt)
    return estimate.hover_gas * math.sqrt(min(max(driven, 0.3), 1.9))
