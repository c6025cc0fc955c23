"""Sources of poses for one target against each other. Pure.

Two that show different places are both refused, whatever their poses look like by themselves: which one is wrong only
the motion of the aircraft shows. The one whose motion is farther from what the boards report is named by its judge
(`MotionJudge.outdone`); until then nothing is flown by either. Of three, the two that agree are used. One that has
jumped was wrong, and disputes nothing until it has agreed for a while. Sources of the limits: docs/lab/positions.md.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np

from mkdaemon.frames import Vector
from mkdaemon.positions.motionjudge import COMPARED, GRID, MotionJudge

LOOKED_BACK: Final = 4
"""Poses on the grid that are compared: a single one says nothing."""
APART_SDS: Final = 4.0
"""Places that are farther apart are different [standard deviations]."""
APART: Final = 0.05
"""Places that are nearer to each other are one, whatever is said of the frames [m]."""
STAMPED: Final = 0.02
"""Stamps of two right sources differ by as much [s]."""
AGREED: Final = 1.0
"""Two that were apart agree again after this time [s]: a mirrored place passes the right one."""
FRESH: Final = 0.5
"""A source without a pose for longer shows nothing [s]."""
WEIGHED: Final = 3.0
"""Time over which the differences of two sources from the boards are summed up [s]: a dispute lasts no longer."""
CLEARLY: Final = 1.5
"""Least power of the differences of a wrong source, over that of a right one."""
SURELY: Final = 0.5
"""And exceed them by as much, summed up [s] in units of what a right source differs by."""


class MeanPlace(NamedTuple):
    """Where a source shows the vehicle, on average over a moment.

    Attributes:
        place: (3,) [m].
        speed: [m/s].
    """

    place: Vector
    speed: float


@dataclass(eq=False, slots=True)
class Rival:
    """What others need to know of a source.

    Attributes:
        name: of the source.
        spread: standard deviation of a place, what all have in common included [m].
        judge: of its motion.
    """

    name: str
    spread: float
    judge: MotionJudge

    def shows(self, at: float) -> bool:
        """Whether it shows something at a time [s], and is not refused for what it shows."""
        motion = self.judge.motion
        return bool(motion) and at - motion[-1][0] <= FRESH and not self.judge.contradiction

    @property
    def has_jumped(self) -> bool:
        """Whether it showed a jump, and has not agreed with others since."""
        return self.judge.jumped_at > -math.inf

    def place_between(self, start: float, end: float) -> MeanPlace | None:
        """Where it shows the vehicle between two times [s]; None where it does not."""
        motion = np.array(self.judge.motion)
        if not len(motion) or motion[0, 0] > start or motion[-1, 0] < end - 2 * GRID:
            return None
        grid = np.linspace(start, end, LOOKED_BACK)
        places = np.array([np.interp(grid, motion[:, 0], motion[:, k]) for k in (4, 5, 6)])
        return MeanPlace(places.mean(axis=1), float(np.linalg.norm(places[:, -1] - places[:, 0])) / (end - start))


class Rivals:
    """A source, and the others of its target.

    Attributes:
        against: names of those that show another place; empty while the source may be used.
        apart: how far the farthest of them is [m].
    """

    def __init__(self, mine: Rival, others: Sequence[Rival]) -> None:
        """Prepare.

        Args:
            mine: the source that is judged.
            others: sources of the same target.
        """
        self.mine, self._others = mine, tuple(others)
        self.against: tuple[str, ...] = ()
        self.apart = 0.0
        self._apart_at = {each.name: -math.inf for each in others}
        self._compared_at = -math.inf
        self._weighed: deque[tuple[float, str, float, float]] = deque()

    def compare(self, at: float) -> bool:
        """Compare a pose that was taken at a time [s] with the others; return whether it may be used."""
        if at - self._compared_at >= COMPARED:
            self._compared_at = at
            self._look(at)
        return not self.against

    def _look(self, at: float) -> None:
        shown = [each for each in self._others if each.shows(at)]
        distances = {each.name: self._distance(each, at) for each in shown}
        for name, distance in distances.items():
            if distance > 0.0:
                self._apart_at[name] = at
        agreed_since = max((self._apart_at[each.name] for each in shown), default=at)
        if at - max(agreed_since, self.mine.judge.jumped_at) > AGREED:
            self.mine.judge.jumped_at = -math.inf
        apart = [each for each in shown if at - self._apart_at[each.name] <= AGREED]
        opposed = [each for each in apart if self.mine.has_jumped or not each.has_jumped]
        self.apart = max(distances.values(), default=0.0) or self.apart
        # Those that agree with this one, itself among them, must outnumber the others.
        outvoted = len(opposed) >= 1 + len(shown) - len(apart)
        self.against = tuple(each.name for each in opposed) if opposed and outvoted else ()
        self._weigh(shown, at)
        if any(self.is_outdone_by(each.name) for each in apart):
            self.mine.judge.outdone()

    def restart(self) -> None:
        """Forget what was compared: the sender of this source has started again."""
        self.against = ()
        self._apart_at = dict.fromkeys(self._apart_at, -math.inf)
        self._weighed.clear()

    def _distance(self, other: Rival, at: float) -> float:
        """Between the places that both show [m]; 0 where they may be one."""
        end = min(at, other.judge.motion[-1][0])  # one of them may be later by its latency
        start = end - (LOOKED_BACK - 1) * GRID
        here, there = self.mine.place_between(start, end), other.place_between(start, end)
        if here is None or there is None:
            return 0.0
        limit = APART_SDS * math.hypot(self.mine.spread, other.spread) + STAMPED * max(here.speed, there.speed)
        distance = float(np.linalg.norm(here.place - there.place))
        return distance if distance > max(APART, limit) else 0.0

    def _weigh(self, shown: Sequence[Rival], at: float) -> None:
        """Keep how far each source is from the motion of the boards, whether or not places are disputed yet."""
        mine = self.mine.judge.excess
        for each in shown:
            if mine is not None and each.judge.excess is not None:
                self._weighed.append((at, each.name, mine * COMPARED, each.judge.excess * COMPARED))
        while self._weighed and self._weighed[0][0] < at - WEIGHED:
            self._weighed.popleft()

    def is_outdone_by(self, name: str) -> bool:
        """Whether the motion of the boards is that of another source."""
        mine, theirs = self.weights(name)
        return mine > CLEARLY * theirs and mine > theirs + SURELY

    def weights(self, name: str) -> tuple[float, float]:
        """How far this source and another one are from the motion of the boards, summed up [s]."""
        found = [weighed[2:] for weighed in self._weighed if weighed[1] == name]
        return sum(mine for mine, _ in found), sum(theirs for _, theirs in found)
