"""Landing decks over flat ground, as something to stand on: one that moves, and one that is tilted."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final

from mkdaemon.frames import Vector

_SAMPLE: Final = 0.02
"""The path is sampled this often and followed straight in between: a step of the flight is ten times shorter [s]."""


class MovingDeck:
    """A round deck on a path; flat ground at height zero around it.

    An aircraft that stands on it is carried along by friction.
    """

    __slots__ = ("_path", "_position", "_radius", "_sampled", "_velocity")

    def __init__(self, path: Callable[[float], Vector], *, radius: float) -> None:
        """Put a deck on a path.

        Args:
            path: centre of its surface `(3,)` at a time [m; ENU]; [s].
            radius: [m].
        """
        self._path = path
        self._radius = radius
        self._sampled = -math.inf
        self._position = (0.0, 0.0, 0.0)
        self._velocity = (0.0, 0.0, 0.0)

    def at(self, east: float, north: float, now: float) -> tuple[float, float, float, float]:
        """Return height [m] and velocity east, north, up [m/s] of the surface below a point."""
        since = now - self._sampled
        if not 0.0 <= since < _SAMPLE:
            self._sample(now)
            since = 0.0
        (x, y, z), (v_x, v_y, v_z) = self._position, self._velocity
        if math.hypot(east - x - v_x * since, north - y - v_y * since) > self._radius:
            return 0.0, 0.0, 0.0, 0.0
        return z + v_z * since, v_x, v_y, v_z

    def _sample(self, now: float) -> None:
        here, there = self._path(now), self._path(now + _SAMPLE)
        self._sampled = now
        self._position = (float(here[0]), float(here[1]), float(here[2]))
        step = (there - here) / _SAMPLE
        self._velocity = (float(step[0]), float(step[1]), float(step[2]))


class TiltedDeck:
    """A round deck at rest that slopes down in one direction; flat ground at height zero around it."""

    __slots__ = ("_centre", "_fall", "_radius")

    def __init__(self, centre: tuple[float, float, float], *, tilt: float, heading: float, radius: float) -> None:
        """Set it up.

        Args:
            centre: of its surface [m; ENU].
            tilt: from level [rad].
            heading: direction in which it slopes down, counter-clockwise from east [rad].
            radius: [m].
        """
        self._centre, self._radius = centre, radius
        self._fall = math.tan(tilt) * math.cos(heading), math.tan(tilt) * math.sin(heading)

    def at(self, east: float, north: float, now: float) -> tuple[float, float, float, float]:
        """Return height [m] and velocity east, north, up [m/s] of the surface below a point."""
        x, y = east - self._centre[0], north - self._centre[1]
        if math.hypot(x, y) > self._radius:
            return 0.0, 0.0, 0.0, 0.0
        return self._centre[2] - self._fall[0] * x - self._fall[1] * y, 0.0, 0.0, 0.0
