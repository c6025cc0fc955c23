"""What to fly, and what happened."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from lab.control.camera import CameraModel
from mkdaemon.control.estimator.model import AircraftModel
from mkdaemon.control.linear import Array
from mkdaemon.control.regulator.autopilot import Goal, at_origin
from mksim.config import ChannelConfig, RadioKind, WindClass
from mksim.physics.attitude_loop import EASY, AttitudeGains

RADIO: Final = ChannelConfig(kind=RadioKind.XBEE)
"""Each way of the line: a radio as the simulator has it."""
STOOD: Final = 1.0
"""An aircraft whose feet have stood for this long without a break has landed [s]."""


@dataclass(frozen=True, slots=True)
class Flight:
    """One flight to fly.

    Attributes:
        seconds: length [s].
        start: height of the feet at the start [m]; zero stands on the ground, the motors at idle.
        place: where that is, east and north of the target [m].
        goal: wanted position at a time of the flight.
        mass: [kg].
        model: what the product believes of the aircraft; None for the truth.
        pad: velocity of the target once it moves [m/s].
        pad_starts: when it begins to move [s].
        attitude_scale: what the boards report over what they believe.
        land_at: when to begin to land [s].
    """

    seed: int
    seconds: float = 40.0
    start: float = 1.9
    place: tuple[float, float] = (0.0, 0.0)
    wind: WindClass = WindClass.INDOOR
    goal: Callable[[float], Goal] = field(default=lambda t: at_origin(2.0))
    gains: AttitudeGains = field(default_factory=lambda: AttitudeGains.from_parameters(**EASY))
    mass: float = 1.25
    model: AircraftModel | None = None
    camera: CameraModel = field(default_factory=CameraModel)
    radio: ChannelConfig = RADIO
    pad: tuple[float, float] = (0.0, 0.0)
    pad_starts: float = 8.0
    attitude_scale: float = 1.0
    land_at: float = math.inf

    def pad_at(self, t: float) -> Array:
        """Where the target is [m]."""
        return np.array([*self.pad, 0.0]) * max(0.0, t - self.pad_starts)


@dataclass(slots=True)
class Record:
    """What happened.

    Attributes:
        times: of the control ticks [s].
        positions: true position in the frame of the target, one a tick (3,) [m].
        errors: true position less goal, one a tick (3,) [m].
        lost: why it ended early; empty when it flew to the end.
        touched: when the feet first stood after `land_at` [s].
        touch_error: horizontal distance from the target's middle then [m]; infinite where they never stood.
        touch_sink: rate of descent then [m/s].
        stands: at the end the feet had stood for `STOOD`, and the throttle on the line did not carry the aircraft.
    """

    times: list[float] = field(default_factory=list)
    positions: list[Array] = field(default_factory=list)
    errors: list[Array] = field(default_factory=list)
    lost: str = ""
    touched: float = math.nan
    touch_error: float = math.inf
    touch_sink: float = math.inf
    stands: bool = False
