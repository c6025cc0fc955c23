"""A path as a curve in time: polynomials one after the other, made of points or of coefficients.

Points are flown through by the curve that has the least integral of squared jerk of all that pass them at their times
(T. Flash and N. Hogan, J. Neuroscience 5, 1985): quintic polynomials whose first four derivatives are continuous,
at rest at both ends. Its velocities and accelerations at the points solve a block tridiagonal system (C. de Boor, "A
Practical Guide to Splines", 1978, on complete splines; here of degree five).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np

from mkdaemon.control.linear import Array
from mkdaemon.telemetry.path import COEFFICIENTS, PathPiece, PathPoint, PathUploadRequest
from mkdaemon.telemetry.refusals import Token, refuse

AXES: Final = 4
"""x, y, z and yaw."""
GENTLE: Final = 0.4
"""Mean acceleration with which points with speeds are left and reached at a stop [m/s2]: the curve needs twice it for a
moment, and vertically `CLIMB_ACCELERATION` is the limit."""
NO_WAY: Final = 1e-3
"""Points nearer together are one [m]."""


@dataclass(frozen=True, slots=True)
class CurveMotion:
    """Where a curve is at some times, and how it moves.

    Attributes:
        position: x, y, z and yaw (m, 4) [m; rad].
        velocity: (m, 4) [m/s; rad/s].
        acceleration: (m, 4) [m/s2; rad/s2].
    """

    position: Array
    velocity: Array
    acceleration: Array


class PathCurve:
    """A path as a function of time.

    Attributes:
        durations: of its pieces (n,) [s].
        starts: when each begins (n,) [s].
        duration: of the whole [s].
        turns: the heading is part of it; else it is kept.
    """

    def __init__(self, durations: Array, coefficients: Array, *, turns: bool) -> None:
        """Take pieces of durations (n,) [s] with coefficients (n, 4, 8), of x, y, z and yaw, from the constant on."""
        self.durations, self._coefficients, self.turns = durations, coefficients, turns
        ends = np.cumsum(durations)
        self.starts, self.duration = ends - durations, float(ends[-1])
        powers = np.arange(1, COEFFICIENTS)
        self._velocity = coefficients[:, :, 1:] * powers
        self._acceleration = self._velocity[:, :, 1:] * powers[:-1]

    @classmethod
    def of(cls, request: PathUploadRequest) -> PathCurve:
        """Make the curve that was asked for.

        Raises:
            CommandRejectedError: `path_refused`: a point takes no time, or some have a heading and others have none.
        """
        return _of_pieces(request.pieces) if request.pieces else _through(request.points)

    def at(self, times: Array) -> CurveMotion:
        """Where it is at times since its beginning (m,) [s]; before it and after it, it rests at its ends."""
        inside = np.clip(times, 0.0, self.duration)
        pieces = np.searchsorted(self.starts, inside, side="right") - 1
        local = (inside - self.starts[pieces])[:, None]
        moves = ((times >= 0.0) & (times < self.duration))[:, None]
        return CurveMotion(
            _value(self._coefficients[pieces], local),
            np.where(moves, _value(self._velocity[pieces], local), 0.0),
            np.where(moves, _value(self._acceleration[pieces], local), 0.0),
        )

    def pieces_at(self, shares: Array) -> CurveMotion:
        """Every piece at shares of its duration (k,): arrays of (n, k, 4)."""
        local = (self.durations[:, None] * shares)[:, :, None]
        of_all = (each[:, None] for each in (self._coefficients, self._velocity, self._acceleration))
        return CurveMotion(*(_value(each, local) for each in of_all))


def _value(coefficients: Array, times: Array) -> Array:
    """Polynomials (..., degree + 1) at times (...), by Horner's scheme."""
    value = coefficients[..., -1] + 0.0 * times
    for power in range(coefficients.shape[-1] - 2, -1, -1):
        value = value * times + coefficients[..., power]
    return value


def _of_pieces(pieces: Sequence[PathPiece]) -> PathCurve:
    """Take polynomials as they are."""
    coefficients = np.zeros((len(pieces), AXES, COEFFICIENTS))
    turns = _all_or_none([bool(piece.yaw) for piece in pieces], "piece")
    for place, piece in zip(coefficients, pieces, strict=True):
        for axis, given in zip(place, (piece.x, piece.y, piece.z, piece.yaw), strict=True):
            axis[: len(given)] = given
    return PathCurve(np.array([piece.duration for piece in pieces]), coefficients, turns=turns)


def _through(points: Sequence[PathPoint]) -> PathCurve:
    """Fly through points, and stop where they say so."""
    turns = _all_or_none([point.yaw is not None for point in points], "point")
    places = np.zeros((len(points), AXES))
    places[:, :3] = [point.position for point in points]
    places[:, 3] = np.unwrap([point.yaw or 0.0 for point in points])
    last = len(points) - 1
    stops = [number for number, point in enumerate(points) if point.stop is not None or number in (0, last)]
    durations: list[Array] = []
    coefficients: list[Array] = []
    for begin, end in pairwise([0, *stops]):
        if end:
            spent = _times(points, places[:, :3], begin, end)
            durations.append(spent)
            coefficients.append(_smooth(places[begin : end + 1], spent))
        rest = points[end].stop or 0.0
        if rest > 0.0:
            standing = np.zeros((1, AXES, COEFFICIENTS))
            standing[0, :, 0] = places[end]
            durations.append(np.array([rest]))
            coefficients.append(standing)
    return PathCurve(np.concatenate(durations), np.concatenate(coefficients), turns=turns)


def _times(points: Sequence[PathPoint], places: Array, begin: int, end: int) -> Array:
    """Time for each way from one point to the next, between two points at which it stops (end - begin,) [s].

    At a speed it is that of the straight lines, with `GENTLE` from the one stop, and to the other.
    """
    ways = np.linalg.norm(places[begin + 1 : end + 1] - places[begin:end], axis=1)
    reached = points[begin + 1 : end + 1]
    if any(point.speed is not None and way < NO_WAY for point, way in zip(reached, ways.tolist(), strict=True)):
        number = begin + 2 + int(np.argmin(ways))
        detail, remedy = f"point {number} is where the one before is", "Give it a time, or leave it out."
        raise refuse(Token.PATH_REFUSED, detail=detail, remedy=remedy)
    speeds = np.array([point.speed or 1.0 for point in reached])
    since = np.concatenate([[0.0], np.cumsum(ways)])
    left = since[-1] - since
    gained = _lost(since[1:], speeds) - _lost(since[:-1], speeds) + _lost(left[:-1], speeds) - _lost(left[1:], speeds)
    given = np.array([point.time or 0.0 for point in reached])
    return np.where(given > 0.0, given, ways / speeds + gained)


def _lost(way: Array, speed: Array) -> Array:
    """Time that is lost over ways from a stop (n,) [m] because a speed (n,) must be reached first [s]."""
    short = np.minimum(way, speed**2 / (2.0 * GENTLE))
    return np.sqrt(2.0 * np.maximum(short, 0.0) / GENTLE) - short / speed


def _all_or_none(have: Sequence[bool], thing: str) -> bool:
    """Whether all have a heading.

    Raises:
        CommandRejectedError: `path_refused`: some do, others do not.
    """
    if any(have) and not all(have):
        detail = f"{thing} {have.index(False) + 1} has no yaw, and others have one"
        raise refuse(Token.PATH_REFUSED, detail=detail, remedy=f"Give every {thing} a yaw, or none.")
    return all(have)


def _smooth(places: Array, durations: Array) -> Array:
    """Coefficients (n, 4, 8) of the curve of least jerk through places (n + 1, 4) in durations (n,) [s].

    The unknowns at each inner point are its velocity and acceleration, so that jerk and snap are continuous there.
    """
    count = len(durations)
    motion = np.zeros((count + 1, 2, AXES))
    before, after = _at_ends(durations[:-1]), _at_starts(durations[1:])
    lower, middle, upper = before[:, :, :2], before[:, :, 2:4] - after[:, :, :2], -after[:, :, 2:4]
    steps = (places[1:] - places[:-1])[:, None]
    right = after[:, :, 4:] * steps[1:] - before[:, :, 4:] * steps[:-1]
    # Thomas' algorithm with blocks of 2 x 2: lower @ (one before) + middle @ here + upper @ (one after) = right.
    reduced = np.zeros((count + 1, 2, 2))
    for k in range(1, count):
        low = lower[k - 1]
        (a, b), (c, d) = (middle[k - 1] - low @ reduced[k - 1]).tolist()
        inverse = np.array([[d, -b], [-c, a]]) / (a * d - b * c)
        reduced[k] = inverse @ upper[k - 1]
        motion[k] = inverse @ (right[k - 1] - low @ motion[k - 1])
    for k in range(count - 1, 0, -1):
        motion[k] -= reduced[k] @ motion[k + 1]
    return _quintics(places, motion, durations)


def _at_ends(h: Array) -> Array:
    """Jerk and snap at the end of quintics of durations h, by velocity and acceleration at both ends, and step.

    Shape (n, 2, 5); derived from the coefficients in `_quintics`.
    """
    jerk = [-24.0 / h**2, -3.0 / h, -36.0 / h**2, 9.0 / h, 60.0 / h**3]
    snap = [-168.0 / h**3, -24.0 / h**2, -192.0 / h**3, 36.0 / h**2, 360.0 / h**4]
    return np.array([jerk, snap]).transpose(2, 0, 1)


def _at_starts(h: Array) -> Array:
    """The same at their starts."""
    jerk = [-36.0 / h**2, -9.0 / h, -24.0 / h**2, 3.0 / h, 60.0 / h**3]
    snap = [192.0 / h**3, 36.0 / h**2, 168.0 / h**3, -24.0 / h**2, -360.0 / h**4]
    return np.array([jerk, snap]).transpose(2, 0, 1)


def _quintics(places: Array, motion: Array, durations: Array) -> Array:
    """Coefficients (n, 4, 8) by places (n + 1, 4), and velocity and acceleration there (n + 1, 2, 4)."""
    h = durations[:, None]
    step = places[1:] - places[:-1]
    v0, v1, a0, a1 = motion[:-1, 0], motion[1:, 0], motion[:-1, 1], motion[1:, 1]
    coefficients = np.zeros((len(durations), AXES, COEFFICIENTS))
    coefficients[:, :, 0], coefficients[:, :, 1], coefficients[:, :, 2] = places[:-1], v0, a0 / 2.0
    coefficients[:, :, 3] = (20.0 * step - (8.0 * v1 + 12.0 * v0) * h - (3.0 * a0 - a1) * h**2) / (2.0 * h**3)
    coefficients[:, :, 4] = (-30.0 * step + (14.0 * v1 + 16.0 * v0) * h + (3.0 * a0 - 2.0 * a1) * h**2) / (2.0 * h**4)
    coefficients[:, :, 5] = (12.0 * step - 6.0 * (v1 + v0) * h - (a0 - a1) * h**2) / (2.0 * h**5)
    return coefficients
