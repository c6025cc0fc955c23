"""Tilt and thrust straight to counts; the FlightCtrl's leak is the client's business."""

from __future__ import annotations

import math
from typing import ClassVar

from mkdaemon.control.estimator.values import GAS_CENTRE
from mkdaemon.control.limiter import Sticks
from mkdaemon.control.manoeuvres.level import ByHand


class AttitudeFlight(ByHand):
    """Attitudes as the client streams them; a flight begins with a level one."""

    kind: ClassVar[str] = "attitude"
    waits: ClassVar[str] = "waiting for a level attitude"

    def _sticks(self) -> Sticks:
        sight, wanted = self._sight, self._wanted
        model = sight.model
        gas = sight.carrying_gas * math.sqrt(wanted.thrust)
        pitch, roll = wanted.pitch / model.rad_per_count, wanted.roll / model.rad_per_count
        return Sticks(pitch, roll, model.yaw_stick(wanted.yaw_rate), gas - GAS_CENTRE)
