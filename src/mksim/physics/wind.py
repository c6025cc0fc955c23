"""Wind as the aircraft meets it: a mean and turbulence with a correlation time of a few seconds."""

from __future__ import annotations

import math
import random
from dataclasses import dataclass
from typing import Final

from mksim.config import WindClass


@dataclass(frozen=True, slots=True)
class WindFigure:
    """Mean speed and turbulence of a wind class [m/s]."""

    mean: float
    sd: float


WIND_FIGURES: Final[dict[WindClass, WindFigure]] = {
    WindClass.NONE: WindFigure(0.0, 0.0),
    WindClass.INDOOR: WindFigure(0.0, 0.15),
    WindClass.LIGHT: WindFigure(2.0, 0.5),
    WindClass.MODERATE: WindFigure(3.6, 1.0),
}
"""Mean and standard deviation per horizontal axis (docs/simulator.md, wind classes)."""

CORRELATION_TIME: Final = 3.0
"""Correlation time of the turbulence [s]."""
VERTICAL_SHARE: Final = 0.5
"""Vertical turbulence over horizontal: the ground damps it at the heights flown here."""


class Wind:
    """An Ornstein-Uhlenbeck process around a mean, plus one gust at a time.

    Attributes:
        east: wind velocity towards east [m/s].
        north: wind velocity towards north [m/s].
        up: wind velocity upwards [m/s].
    """

    __slots__ = ("_decay", "_gust", "_kick", "_mean", "_rng", "_sd", "_toward", "_turbulence", "east", "north", "up")

    def __init__(
        self, wind_class: WindClass, *, rng: random.Random, period: float, from_deg: float | None = None
    ) -> None:
        """Draw the direction and start in the stationary distribution.

        Args:
            wind_class: strength.
            rng: owned by this wind alone.
            period: time between two calls of `update` [s].
            from_deg: where the mean wind comes from, clockwise from north [deg]; drawn when absent.
        """
        drawn = rng.uniform(0.0, 360.0)
        self._toward = math.radians((drawn if from_deg is None else from_deg) + 180.0)
        self._rng = rng
        # exact discretisation of the process (Gillespie, Phys. Rev. E 54, 1996)
        self._decay = math.exp(-period / CORRELATION_TIME)
        self.change(wind_class)
        self._turbulence = [rng.gauss(0.0, self._sd), rng.gauss(0.0, self._sd), rng.gauss(0.0, self._sd)]
        self._gust: tuple[float, float, float, float] | None = None
        self.east = self.north = self.up = 0.0
        self.update(0.0)

    def change(self, wind_class: WindClass) -> None:
        """Blow with another strength from now on, from where it came before."""
        figure = WIND_FIGURES[wind_class]
        self._mean = (figure.mean * math.sin(self._toward), figure.mean * math.cos(self._toward))
        self._sd = figure.sd
        self._kick = figure.sd * math.sqrt(1.0 - self._decay * self._decay)

    def start_gust(self, now: float, *, speed: float, from_deg: float, duration: float) -> None:
        """Add a 1-cosine gust (MIL-F-8785C) of `speed` [m/s] for `duration` [s] from `from_deg` [deg]."""
        toward = math.radians(from_deg + 180.0)
        self._gust = (now, duration, speed * math.sin(toward), speed * math.cos(toward))

    def stop_gust(self) -> None:
        """End the gust at once."""
        self._gust = None

    def update(self, now: float) -> None:
        """Advance by one period to `now` [s]."""
        east, north = self._mean
        up = 0.0
        if self._sd:
            # Gauss-Markov process of each axis: x' = x e^(-T/tau) + N(0, sd^2 (1 - e^(-2 T/tau))), exact for a step T.
            turbulence, decay, kick, gauss = self._turbulence, self._decay, self._kick, self._rng.gauss
            turbulence[0] = turbulence[0] * decay + gauss(0.0, kick)
            turbulence[1] = turbulence[1] * decay + gauss(0.0, kick)
            turbulence[2] = turbulence[2] * decay + gauss(0.0, kick)
            east += turbulence[0]
            north += turbulence[1]
            up += turbulence[2] * VERTICAL_SHARE
        if self._gust is not None:
            began, duration, gust_east, gust_north = self._gust
            phase = (now - began) / duration
            if phase >= 1.0:
                self._gust = None
            else:
                share = 0.5 * (1.0 - math.cos(2.0 * math.pi * phase))
                east += share * gust_east
                north += share * gust_north
        self.east, self.north, self.up = east, north, up
