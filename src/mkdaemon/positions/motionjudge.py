"""Does a source of poses show the motion of this aircraft? Pure.

A source from outside can be wrong in ways that no single pose shows: its axes are mirrored, it follows another body,
its stamps hide a delay, it repeats its last pose. The aircraft itself contradicts it: its boards report the tilt, and
tilt is acceleration, a = g tan(tilt). Two tests compare the motion of the last seconds: the tilt of the source less
that of the boards, and the acceleration of its positions less that of the boards' tilt. A third one finds steps that
no aircraft flies. Sources of the limits: docs/lab/positions.md.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from enum import Enum
from typing import Final

import numpy as np

from mkdaemon.frames import Matrix, Vector
from mkdaemon.telemetry.vision import PoseRefusal

GRAVITY: Final = 9.81
"""[m/s2]."""
GRID: Final = 0.03
"""Motion is compared on this grid [s]."""
WINDOW: Final = 1.8
"""Length of the compared motion [s]."""
COMPARED: Final = 0.1
"""Time between two comparisons [s]."""
LAGS: Final = (0.0, 0.03, 0.06, 0.09, 0.12, 0.15)
"""Ages of the boards' attitudes that are tried [s]: by cable 0.03, by a slow radio 0.12."""
SPREAD: Final = 0.18
"""Distance in time of the positions whose second difference is an acceleration [s]."""
LEANT: Final = math.radians(8.0)
"""Largest mean difference of the tilts [rad]: crooked bodies are within it, a wrong up is not."""
TILT_LEAST, MOTION_LEAST = math.radians(0.7), math.radians(1.2)
"""Tilts that move less say nothing, root mean square [rad]."""
TILT_DIFFERS: Final = math.radians(0.7)
"""Boards and a right source differ by as much, root mean square [rad]: accelerations mislead the boards."""
WIND: Final = 0.35
"""Acceleration that no tilt explains [m/s2], root mean square: gusts, and the lift-off into the wind."""
TILT_UNLIKE: Final = 0.8
"""Power of the difference over that of the boards' tilt from which on they are different motions: 0.1 where they are
one; 1 of a body that stands, 2 of another aircraft, 4 of a mirrored axis."""
MOTION_UNLIKE: Final = 2.2
"""The same of the accelerations: wind that is leant against has 1."""
ALIKE: Final = 0.35
"""Below this, on both axes, the tilts of a source that was contradicted are right again."""
LASTING: Final = 3
"""Comparisons one after the other that find the same contradiction: a gust at the lift-off is in one or two."""
JUMP: Final = 0.06
"""A pose this far from where the last ones lead is still one of them [m]."""
ACCELERATION: Final = 8.0
"""No aircraft accelerates more [m/s2]."""
STRAYED: Final = 0.5
"""Farther from there than `JUMP` and this, none belongs to the ones before a silence of `LED` [m]."""
REJOINS: Final = 0.15
"""The same after a jump: what jumped is elsewhere [m]."""
DRIFT: Final = 1.0
"""Speed that is added for a longer silence [m/s]."""
LED: Final = 0.3
"""The velocity of the last poses leads no farther [s]."""
RESTART: Final = 5.0
"""After that time without a pose that belongs to the ones before, others are taken [s]: flights end after 3 s."""
FASTEST: Final = 3.0
"""Of an aircraft whose velocity is not known [m/s]."""
KEPT: Final = 400
"""Attitudes that are kept: two seconds at 200 Hz."""


class Contradiction(Enum):
    """What the boards contradict; the value says it, and what to do."""

    LEANT = "it leans against the boards: correct which axis is up (rpy_deg), or how the body is defined (body_rpy_deg)"
    TILT = (
        "it does not tilt as the boards do: mirrored axes, another body, or late by more than it says; correct that, "
        "then start its sender again or tilt the aircraft by hand"
    )
    MOTION = (
        "it does not move as the aircraft tilts: mirrored or swapped axes; correct that, then start its sender again"
    )
    OUTDONE = (
        "another source shows another place, and the motion that the boards report: mirrored axes, another body, or "
        "late by more than it says; correct that, then start its sender again"
    )


LATCHED: Final = (Contradiction.MOTION, Contradiction.OUTDONE)
"""What no later motion refutes: its sender must start again."""


@dataclass(frozen=True, slots=True)
class MotionDifference:
    """How far source and boards differ.

    Attributes:
        leant: mean difference of the tilts [rad].
        tilt: power of the difference of the tilts over that of the boards', the worse axis; None without motion.
        motion: the same of the accelerations; None also where the aircraft is not flown: a hand needs no tilt.
        is_alike: both axes tilted enough to tell, and the tilts are those of one aircraft.
        excess: power of all differences over what boards and a right source differ by.
    """

    leant: float
    tilt: float | None
    motion: float | None
    is_alike: bool
    excess: float

    @property
    def contradiction(self) -> Contradiction | None:
        """What contradicts; None where nothing does."""
        if self.leant > LEANT:
            return Contradiction.LEANT
        if self.tilt is not None and self.tilt > TILT_UNLIKE:
            return Contradiction.TILT
        if self.motion is not None and self.motion > MOTION_UNLIKE:
            return Contradiction.MOTION
        return None


class _Track:
    """The last poses of one motion, and where they lead."""

    def __init__(self) -> None:
        self._poses: deque[tuple[float, Vector]] = deque()

    def __bool__(self) -> bool:
        return bool(self._poses)

    def clear(self) -> None:
        """Know none."""
        self._poses.clear()

    def add(self, at: float, place: Vector) -> None:
        """Take one (3,) [m] of a time [s]."""
        while self._poses and at - self._poses[0][0] > 4 * GRID:
            self._poses.popleft()
        self._poses.append((at, place))

    def age(self, at: float) -> float:
        """Of the last one [s]."""
        return at - self._poses[-1][0]

    @property
    def _span(self) -> float:
        return self._poses[-1][0] - self._poses[0][0]

    def distance(self, at: float, place: Vector) -> float:
        """Of a place from where they lead [m]."""
        last = self._poses[-1][1]
        velocity = (last - self._poses[0][1]) / self._span if self._span >= GRID else np.zeros(3)
        return float(np.linalg.norm(place - last - velocity * min(self.age(at), LED)))

    def reach(self, at: float, farthest: float) -> float:
        """How far from there one of them may be [m]; acceleration adds `farthest` at most [m]."""
        gap = self.age(at)
        unknown = 0.0 if self._span >= GRID else FASTEST * min(gap, LED)
        return JUMP + min(0.5 * ACCELERATION * gap**2, farthest) + unknown


class MotionJudge:
    """Judges the poses of one source, in the order of their times.

    Attributes:
        contradiction: why the source is not used; None where nothing contradicts it.
        motion: of the last `WINDOW`: time [s], pitch, roll, yaw [rad], place [m] of poses on the grid.
        excess: of the newest comparison, see `MotionDifference`; None where the last one was not whole.
        jumped_at: when a pose was last none of the ones before [s]; before all times where it is back with them.
    """

    def __init__(self) -> None:
        self.contradiction: Contradiction | None = None
        self.motion: deque[tuple[float, ...]] = deque(maxlen=round(WINDOW / GRID))
        self.excess: float | None = None
        self.jumped_at = -math.inf
        self._suspected: Contradiction | None = None
        self._lasted = 0
        self._boards: deque[tuple[float, float, float]] = deque(maxlen=KEPT)
        self._track = _Track()
        self._astray = _Track()
        self._compared_at = -math.inf
        self._flown_from = math.inf
        self._last: tuple[Vector, Matrix] | None = None

    def restarted(self) -> MotionJudge:
        """A judge of the same source, whose sender has started again: nothing of it is known."""
        judge = MotionJudge()
        judge._boards = self._boards
        return judge

    def attitude_received(self, at: float, pitch: float, roll: float) -> None:
        """Take an attitude of the boards that arrived at a time [s]; nose down and right side down positive [rad]."""
        if math.isfinite(at + pitch + roll):
            self._boards.append((at, pitch, roll))

    def take(self, at: float, place: Vector, rotation: Matrix, *, is_flown: bool) -> PoseRefusal | None:
        """Take a pose; why it is not to be used, None where it may be.

        Args:
            at: when it was measured [s].
            place: of the vehicle in the target frame (3,) [m].
            rotation: target from FLU (3, 3).
            is_flown: the aircraft is flown, off the ground: neither a hand nor the ground moves it.
        """
        self._flown_from = min(self._flown_from, at) if is_flown else math.inf
        last, self._last = self._last, (place, rotation)
        if last is not None and np.array_equal(last[0], place) and np.array_equal(last[1], rotation):
            return PoseRefusal.REPEATED
        if not self._continues(at, place):
            self.jumped_at = at
            return PoseRefusal.OFF_COURSE
        if self.motion and at - self.motion[-1][0] > 3 * GRID:
            self.motion.clear()
        if not self.motion or at - self.motion[-1][0] >= GRID - 0.002:
            c, s = rotation[0, 0], rotation[1, 0]
            pitch, roll = math.asin(-max(-1.0, min(1.0, rotation[2, 0]))), math.atan2(rotation[2, 1], rotation[2, 2])
            self.motion.append((at, pitch, roll, math.atan2(s, c), *place.tolist()))
        if at - self._compared_at >= COMPARED:
            self._compared_at = at
            found = self.compare()
            self.excess = None if found is None else found.excess
            if found is not None:
                self._conclude(found)
        return PoseRefusal.MOTION if self.contradiction else None

    def _conclude(self, found: MotionDifference) -> None:
        """Contradict the source when the same contradiction has lasted; believe it again when that is refuted."""
        self._lasted = self._lasted + 1 if found.contradiction is self._suspected else 1
        self._suspected = found.contradiction
        if self._lasted < LASTING or self.contradiction in LATCHED:
            return
        if self._suspected is not None:
            self.contradiction = self._suspected
        elif self.contradiction is Contradiction.LEANT or (found.is_alike and self.contradiction is Contradiction.TILT):
            self.contradiction = None

    def outdone(self) -> None:
        """Contradict the source: another one shows another place, and the motion of the boards."""
        self.contradiction = self.contradiction or Contradiction.OUTDONE

    @property
    def has_strayed(self) -> bool:
        """Whether the newest pose that is none of the ones before was the newest of all."""
        return bool(self._astray)

    def _continues(self, at: float, place: Vector) -> bool:
        """Whether a pose goes on from the ones before; then it is one of them.

        What has jumped goes on elsewhere, and may pass where the ones before ended: a pose belongs to those that it is
        nearer to.
        """
        track, astray = self._track, self._astray
        is_taken_up = bool(track) and track.age(at) > RESTART
        if is_taken_up:
            track.clear()
        if track:
            away, gap = track.distance(at, place), track.age(at)
            farthest = REJOINS if astray else STRAYED + DRIFT * max(0.0, gap - LED)
            goes_astray = bool(astray) and astray.distance(at, place) < min(away, astray.reach(at, REJOINS))
            if goes_astray or away > track.reach(at, farthest):
                if astray and not goes_astray:
                    astray.clear()
                astray.add(at, place)
                return False
        if astray and not is_taken_up:
            self.jumped_at = -math.inf  # it is back where it was: single outliers prove nothing
        astray.clear()
        track.add(at, place)
        return True

    def compare(self) -> MotionDifference | None:
        """Compare the motion of the last seconds with that of the boards; None where it is not whole."""
        if len(self.motion) < round(0.6 * WINDOW / GRID) or len(self._boards) < 10:
            return None
        boards, motion = np.array(self._boards), np.array(self.motion)
        motion = motion[motion[:, 0] <= boards[-1, 0] - LAGS[-1]]
        if len(motion) < round(0.5 * WINDOW / GRID) or boards[0, 0] > motion[0, 0]:
            return None
        grid = np.arange(motion[0, 0], motion[-1, 0], GRID)
        tilts = np.array([np.interp(grid, motion[:, 0], motion[:, k]) for k in (1, 2)])
        tried = [np.array([np.interp(grid + lag, boards[:, 0], boards[:, k]) for k in (1, 2)]) for lag in LAGS]
        reported = min(tried, key=lambda each: float(((tilts - each) ** 2).sum()))
        leant = float(np.hypot(*(tilts - reported).mean(axis=1)))
        # After a strong acceleration the boards' tilt is off by degrees and returns slowly: the trend is left out.
        difference, tilted = _less_trend(tilts - reported), _less_trend(reported)
        unlikes = unlike(difference, tilted, TILT_LEAST, 0.0)
        is_alike = len(unlikes) == 2 and max(unlikes) < ALIKE
        flown = grid >= self._flown_from
        moved, wanted = _accelerations(grid[flown], motion, reported[:, flown])
        accelerations = unlike(moved - wanted, wanted, GRAVITY * MOTION_LEAST, WIND)
        worst = max(unlike(difference, tilted, TILT_LEAST, TILT_DIFFERS), default=None)
        excess = _power(difference) / TILT_DIFFERS**2 + _power(moved - wanted) / WIND**2
        return MotionDifference(leant, worst, max(accelerations, default=None), is_alike, excess)


def _power(values: Matrix) -> float:
    """Mean square of rows (2, n); 0 for no columns."""
    return float((values**2).mean()) if values.size else 0.0


def _accelerations(grid: Vector, motion: Matrix, reported: Matrix) -> tuple[Matrix, Matrix]:
    """Accelerations of the positions, and those of the boards' tilt (2, n), less their means, in the target's axes.

    (2, 0) where the time that is compared is too short.
    """
    n = round(SPREAD / GRID)
    if len(grid) < 4 * n:
        return np.zeros((2, 0)), np.zeros((2, 0))
    yaw = np.interp(grid, motion[:, 0], np.unwrap(motion[:, 3]))
    c, s = np.cos(yaw), np.sin(yaw)
    pitch, roll = reported
    # The second difference of positions is the acceleration under a triangle of that width.
    triangle = np.convolve(np.ones(n), np.ones(n)) / n**2
    pushed = [np.convolve(GRAVITY * each, triangle, "valid") for each in (pitch * c + roll * s, pitch * s - roll * c)]
    places = np.array([np.interp(grid, motion[:, 0], motion[:, k]) for k in (4, 5)])
    moved = (places[:, 2 * n :] - 2.0 * places[:, n:-n] + places[:, : -2 * n]) / (n * GRID) ** 2
    width = min(moved.shape[1], len(pushed[0]))
    return _less_mean(moved[:, :width]), _less_mean(np.array(pushed)[:, 1 : width + 1])


def unlike(difference: Matrix, motion: Matrix, least: float, noise: float) -> list[float]:
    """Power of the difference of two motions (2, n) over that of one of them, each without what is not compared.

    Args:
        difference: of the two.
        motion: the one that is right.
        least: an axis of it that moves less says nothing, root mean square.
        noise: difference of two measurements of one motion, root mean square.

    Returns:
        One for each axis that moves enough.
    """
    if not motion.size:
        return []
    powers = (motion**2).mean(axis=1)
    excess = np.maximum((difference**2).mean(axis=1) - noise**2, 0.0)
    return [float(each / power) for each, power in zip(excess, powers, strict=True) if power > least**2]


def _less_mean(values: Matrix) -> Matrix:
    """Rows (2, n) less their means."""
    rest: Matrix = values - values.mean(axis=1, keepdims=True)
    return rest


def _less_trend(values: Matrix) -> Matrix:
    """Rows (2, n) less the straight line through each."""
    line = np.linspace(-1.0, 1.0, values.shape[1])
    line /= np.linalg.norm(line)
    rest = _less_mean(values)
    return rest - np.outer(rest @ line, line)
