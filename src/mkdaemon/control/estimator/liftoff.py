"""The throttle that carries the aircraft, from how it left the ground.

One number is unknown, the hover throttle. The vertical model, driven by the throttle that was sent, rises from standing
once its thrust exceeds the weight; the hover throttle for which it passes through the heights that images showed is the
measured one. The model then also says how fast the aircraft climbs and how far the motors follow at the last of these
images, which late images alone show too late: at 0.5 g of acceleration and an image every 67 ms, two heights give the
climb rate 0.16 m/s too small.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from mkdaemon.control.estimator.model import GRAVITY, AircraftModel, E, F, H, S, ground_effect
from mkdaemon.control.estimator.values import StickCommand
from mkdaemon.control.linear import Array

STEP: Final = 0.01
"""Of the simulated lift-off [s]; half of a stick frame's period."""
CANDIDATES: Final = 65
"""Hover throttles that are tried: a range of 64 counts by single ones; what lies between is interpolated."""


@dataclass(frozen=True, slots=True)
class LiftOff:
    """An aircraft that has just left the ground.

    Attributes:
        hover_gas: throttle that carries it [count of 254].
        climb: climb rate at the newest image [m/s].
        thrust: of the motors then, less the weight [share of the weight].
    """

    hover_gas: float
    climb: float
    thrust: float


def lifted_off(
    sent: Sequence[StickCommand],
    seen: Sequence[tuple[float, float]],
    model: AircraftModel,
    between: tuple[float, float],
) -> LiftOff:
    """Find the hover throttle with which a model that stood rises as images show.

    Args:
        sent: stick frames in the order in which they were written, from before the lift-off on.
        seen: one or more pairs, in the order of time: when an image was taken [s], the height of the feet [m].
        model: of the aircraft.
        between: smallest and largest accepted hover throttle [count of 254].
    """
    hovers = np.linspace(*between, CANDIDATES)
    rises = list(_rises(sent, [at for at, _ in seen], model, hovers))
    # The lower the hover throttle, the higher it flies: the sum has one zero, the least squares of one factor.
    short = sum(height - state[:, H] for state, (_, height) in zip(rises, seen, strict=True))
    climb, thrust = (float(np.interp(0.0, short, rises[-1][:, place])) for place in (S, F))
    return LiftOff(float(np.interp(0.0, short, hovers)), climb, thrust)


def _rises(
    sent: Sequence[StickCommand], times: Sequence[float], model: AircraftModel, hovers: Array
) -> Iterator[Array]:
    """Yield the vertical states (k, 4) at each of the times, for hover throttles (k,) [count of 254].

    From standing, with the throttle that acts `uplink` after it was written. The ground effect k adds
    `e = g (1 + f) (k(h) - 1)`; on the ground `s` is not negative.
    """
    transition, driven = model.vertical(STEP)
    frames = iter(sent)
    coming, asked = next(frames, None), np.full((len(hovers), 1), -1.0)
    states = np.zeros((len(hovers), 4))
    states[:, F] = -1.0
    now = sent[0].at if sent else times[0]
    for time in times:
        while now < time:
            while coming is not None and coming.at + model.uplink <= now:
                asked = (coming.acting_gas / hovers[:, None]) ** 2 - 1.0
                coming = next(frames, None)
            states[:, E] = GRAVITY * (1.0 + states[:, F]) * (ground_effect(states[:, H]) - 1.0)
            states = states @ transition.T + asked * driven
            stands = states[:, H] <= 0.0
            states[stands, H], states[stands, S] = 0.0, np.maximum(states[stands, S], 0.0)
            now += STEP
        yield states
