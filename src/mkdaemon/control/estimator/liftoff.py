"""The throttle that carries the aircraft, from how it left the ground.

One number is unknown, the hover throttle. The vertical model, driven by the throttle that was sent, rises from standing
once its thrust exceeds the weight; the hover throttle for which it passes through the heights that images showed is the
measured one. The model then also says how fast the aircraft climbs and how far the motors follow at the last of these
images, which late images alone show too late: at 0.5 g of acceleration and an image every 67 ms, two heights give the
climb rate 0.16 m/s too small.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

from mkdaemon.control.estimator.model import GRAVITY, AircraftModel, ground_effect
from mkdaemon.control.estimator.values import StickCommand

STEP: Final = 0.01
"""Of the simulated lift-off [s]; half of a stick frame's period."""
HALVINGS: Final = 10
"""Of the accepted range of hover throttles: a range of 64 counts to a sixteenth of a count."""


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
    low, high = between
    for _ in range(HALVINGS):
        middle = (low + high) / 2.0
        rises = zip(_rise(sent, [at for at, _ in seen], model, middle), seen, strict=True)
        # The lower the hover throttle, the higher it flies: the sum has one zero, the least squares of one factor.
        is_too_high = sum(height - found for (height, _, _), (_, found) in rises) > 0.0
        low, high = (middle, high) if is_too_high else (low, middle)
    hover = (low + high) / 2.0
    *_, (_, climb, thrust) = _rise(sent, [at for at, _ in seen], model, hover)
    return LiftOff(hover, climb, thrust)


def _rise(
    sent: Sequence[StickCommand], times: Sequence[float], model: AircraftModel, hover: float
) -> Iterator[tuple[float, float, float]]:
    """Yield height of the feet [m], climb rate [m/s] and thrust less the weight [share] at each of the times.

    From standing, with the throttle that acts `uplink` after it was written::

        f' = ((gas / hover)^2 - 1 - f) / thrust_lag;   s' = g ((1 + f) k(h) - 1) - drag s;   h' = s

    with k the ground effect. On the ground `s` is not negative.
    """
    share = 1.0 - math.exp(-STEP / model.thrust_lag)
    frames = iter(sent)
    coming, asked = next(frames, None), -1.0
    height, climb, thrust = 0.0, 0.0, -1.0
    now = sent[0].at if sent else times[0]
    for time in times:
        while now < time:
            while coming is not None and coming.at + model.uplink <= now:
                asked = (coming.acting_gas / hover) ** 2 - 1.0
                coming = next(frames, None)
            thrust += (asked - thrust) * share
            climb += (GRAVITY * ((1.0 + thrust) * ground_effect(height) - 1.0) - model.drag * climb) * STEP
            height += climb * STEP
            if height <= 0.0:
                height, climb = 0.0, max(0.0, climb)
            now += STEP
        yield height, climb, thrust
