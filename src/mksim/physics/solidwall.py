"""Walls as something to fly into."""

from __future__ import annotations

import math
from typing import Final

from mksim.config import AirframeConfig, WallConfig
from mksim.physics.airframe import Airframe

PROPELLER_RADIUS: Final = 0.127
"""Of the propellers, 10 inches across [m]."""


class SolidWall:
    """Stops the aircraft, which its rotors do not survive.

    The aircraft is a disc as wide as its rotors reach, level at its centre of gravity: at 30 degrees of tilt its rotors
    are 4 cm farther from the wall than that.
    """

    __slots__ = ("_along", "_bottom", "_leg", "_length", "_reach", "_start", "_top")

    def __init__(self, wall: WallConfig, airframe: AirframeConfig) -> None:
        (x, y), (to_x, to_y) = wall.start, wall.end
        self._length = math.dist(wall.start, wall.end)
        self._start = x, y
        self._along = (to_x - x) / self._length, (to_y - y) / self._length
        self._bottom, self._top = wall.bottom, wall.bottom + wall.height
        self._reach, self._leg = airframe.arm + PROPELLER_RADIUS, airframe.leg_height

    def stop(self, airframe: Airframe) -> None:
        """Break the aircraft if it touches the wall on its way, and put what is left of it beside the wall."""
        if not self._bottom < airframe.up < self._top + self._leg:
            return
        east, north = airframe.east - self._start[0], airframe.north - self._start[1]
        along = min(max(east * self._along[0] + north * self._along[1], 0.0), self._length)
        east, north = east - along * self._along[0], north - along * self._along[1]
        away = math.hypot(east, north)
        if away >= self._reach:
            return
        speed = math.hypot(airframe.v_east, airframe.v_north)
        airframe.collide(f"hit a wall at {speed:.1f} m/s")
        if away > 0.0:
            airframe.east += east * (self._reach / away - 1.0)
            airframe.north += north * (self._reach / away - 1.0)
